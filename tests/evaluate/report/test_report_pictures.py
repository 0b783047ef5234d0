"""Densities on a head, crops and levels of a report; oracles: hand counts, naive loops."""

from __future__ import annotations

from itertools import product
from pathlib import Path

import numpy as np
import pytest
from fabricated import fabricated_results
from hypothesis import given
from hypothesis import strategies as st

from sacha_core.avatar.avatar import Avatar
from sacha_core.codec import encode
from sacha_core.evaluate.ablation.plan import level_file
from sacha_core.evaluate.report import Subject, write_report
from sacha_core.evaluate.report.crops import box_around, closest_levels
from sacha_core.evaluate.report.surface_density import portrait_camera, smooth_density, triangle_picture
from sacha_core.flame.synthetic import synthetic_head
from sacha_core.interchange.gaussian_avatars import write_model

ROUNDING = 1e-9  # relative; sums in another order


def strip(n: int, side_m: float) -> tuple[np.ndarray, np.ndarray]:
    """Give n squares in a row, two triangles each."""
    x = np.arange(n + 1) * side_m
    low = np.stack([x, np.zeros(n + 1), np.zeros(n + 1)], axis=1)
    vertices = np.concatenate([low, low + np.array([0, side_m, 0])])
    a = np.arange(n)
    faces = np.stack([[a, a + 1, a + n + 2], [a, a + n + 2, a + n + 1]], axis=1).transpose(2, 1, 0).reshape(-1, 3)
    return vertices, faces


def test_even_counts_on_even_triangles_have_the_density_of_each() -> None:
    vertices, faces = strip(20, 0.01)
    found = smooth_density(vertices, faces, np.full((1, len(faces)), 3.0), 0.025)
    assert found == pytest.approx(
        np.full((1, len(faces)), 3 / 0.5), rel=ROUNDING
    )  # a triangle has half a square centimetre


def test_density_is_what_a_naive_loop_counts() -> None:
    head, rng = synthetic_head("small"), np.random.default_rng(0)
    counts = rng.integers(0, 4, (2, head.n_faces)).astype(float)
    vertices = head.v_template.astype(np.float64)
    radius = 0.02
    found = smooth_density(vertices, head.faces, counts, radius)
    corners = vertices[head.faces]
    normals = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    areas = np.linalg.norm(normals, axis=1) / 2
    units, centres = normals / (2 * areas[:, None]), corners.mean(axis=1)
    for face in rng.choice(head.n_faces, 25, replace=False):
        near = (np.linalg.norm(centres - centres[face], axis=1) <= radius) & (units @ units[face] > 0.5)
        assert found[:, face] == pytest.approx(counts[:, near].sum(axis=1) / (1e4 * areas[near].sum()), rel=1e-6)


def test_a_portrait_shows_the_whole_head_in_its_colours() -> None:
    head = synthetic_head("small")
    vertices = head.v_template
    colours = np.tile([0.2, 0.4, 0.6], (head.n_faces, 1))
    for direction in ((0.0, 0.0, 1.0), (1.0, 0.0, 0.3)):
        camera = portrait_camera(vertices, direction, 60, 80)
        picture = triangle_picture(vertices, head.faces, colours, camera)
        inked = (picture < 1).any(axis=2)
        assert 0.15 < inked.mean() < 0.9
        assert not np.concatenate([inked[0], inked[-1], inked[:, 0], inked[:, -1]]).any()
        assert picture[~inked] == pytest.approx(1.0)
        ratio = picture[40, 30] / picture[40, 30, 2]
        assert ratio == pytest.approx([1 / 3, 2 / 3, 1], rel=1e-6)  # shading keeps the hue


@given(
    st.integers(12, 60),
    st.integers(12, 60),
    st.floats(0, 1),
    st.floats(0, 1),
    st.floats(0.05, 0.6),
    st.floats(0.05, 0.6),
)
def test_boxes_lie_within_the_image_and_hold_the_region(
    h: int, w: int, y: float, x: float, tall: float, wide: float
) -> None:
    inside = np.zeros((h, w), bool)
    top, left = int(y * (h - 1)), int(x * (w - 1))
    inside[top : top + max(int(tall * h), 1), left : left + max(int(wide * w), 1)] = True
    rows, columns = box_around(inside)
    assert 0 <= rows.start < rows.stop <= h
    assert 0 <= columns.start < columns.stop <= w
    if rows.stop - rows.start < h and columns.stop - columns.start < w:
        assert inside[rows, columns].sum() >= 0.9 * inside.sum()


@given(
    st.lists(st.dictionaries(st.integers(1, 4), st.integers(1, 10_000), min_size=1, max_size=4), min_size=1, max_size=3)
)
def test_levels_are_the_closest_that_trying_all_finds(sizes: list[dict[int, int]]) -> None:
    named = {str(place): some for place, some in enumerate(sizes)}
    chosen = closest_levels(named)

    def ratio(levels: tuple[int, ...]) -> float:
        bytes_taken = [some[level] for some, level in zip(sizes, levels, strict=True)]
        return max(bytes_taken) / min(bytes_taken)

    best = min(ratio(levels) for levels in product(*sizes))
    assert ratio(tuple(chosen[name] for name in named)) == pytest.approx(best, rel=1e-8)


def test_a_report_shows_heads_where_models_and_files_are_there(subject, tmp_path: Path) -> None:  # type: ignore[no-untyped-def]
    names = ("default", "sacha")
    results = fabricated_results(("one",), names, seeds=2, levels=(0, 1, 2))
    avatar = Avatar(subject.gaussians, subject.head.reference, subject.motion)
    for name in names:
        run = tmp_path / "one" / "seed-0" / name
        write_model(run / "model", 7, subject.gaussians)
        for level in (1, 2):
            level_file(run, level).write_bytes(encode(avatar, level, head=subject.head, drop_invisible=False))
    shown = {"one": Subject(subject.capture, subject.head, 48, 70)}
    paths = write_report(results, tmp_path / "report", tmp_path, shown)
    names_drawn = {figure.stem for figure in paths.figures}
    assert {"heat-one", "crops-one"} <= names_drawn
    nothing = write_report(results, tmp_path / "other", tmp_path / "nowhere", shown)
    text = nothing.html.read_text(encoding="utf-8")
    assert "none of the runs&#x27; models was found" in text
    assert "none of the runs&#x27; coded avatars was found" in text
