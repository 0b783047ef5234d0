"""What was painted, as factors of triangles: means of corners by hand, and geometric strength by its definition."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from sacha_core.density.painting import painted_importance, read_painting
from sacha_core.errors import FormatError, TopologyError
from sacha_core.flame.synthetic import synthetic_head

HEAD = synthetic_head("small")
ROUNDING = 1e-12  # float64, sums of three


def test_triangles_vertices_and_corners_say_the_same() -> None:
    of_vertex = np.random.default_rng(1).random(HEAD.n_vertices)
    corners = of_vertex[HEAD.faces]
    expected = np.array([(a + b + c) / 3 for a, b, c in corners])
    for painting in (expected, of_vertex, corners.ravel()):
        assert painted_importance(painting, HEAD) == pytest.approx(expected, rel=ROUNDING)


def test_of_colours_the_luminance_counts() -> None:
    colours = np.random.default_rng(2).random((HEAD.n_faces, 4))
    expected = [0.2126 * red + 0.7152 * green + 0.0722 * blue for red, green, blue, _ in colours.tolist()]
    assert painted_importance(colours, HEAD) == pytest.approx(expected, rel=ROUNDING)
    assert painted_importance(colours[:, :3], HEAD) == pytest.approx(expected, rel=ROUNDING)


def test_a_strength_is_reached_at_one_and_half_its_octaves_half_way() -> None:
    painting = np.zeros(HEAD.n_faces)
    painting[:3] = (0.5, 1.0, 1 + 5e-7)  # floats of a painting program may stick out a little
    found = painted_importance(painting, HEAD, 4.0)
    assert found[:4] == pytest.approx([2, 4, 4, 1], rel=1e-6)
    assert painted_importance(painting, HEAD, 0.25)[1] == 0.25


def test_what_is_no_painting_of_this_head_is_refused(tmp_path: Path) -> None:
    with pytest.raises(TopologyError, match=r"\(7,\) numbers, but head"):
        painted_importance(np.ones(7), HEAD)
    with pytest.raises(TopologyError, match="numbers, but head"):
        painted_importance(np.ones((HEAD.n_faces, 2)), HEAD)
    with pytest.raises(FormatError, match=r"up to 1\.5, expected 0 to 1"):
        painted_importance(np.full(HEAD.n_faces, 1.5), HEAD, 4.0)
    files = {
        "text.npy": b"painted",
        "cut.npy": None,
        "negative.npy": np.array([-1.0]),
        "nan.npy": np.array([np.nan]),
        "words.npy": np.array(["a"]),
    }
    for name, held in files.items():
        path = tmp_path / name
        if isinstance(held, np.ndarray):
            np.save(path, held)
        elif held is not None:
            path.write_bytes(held)
        else:
            np.save(path, np.ones(100))
            path.write_bytes(path.read_bytes()[:-8])
        with pytest.raises(FormatError, match=name):
            read_painting(path)
    np.save(tmp_path / "fine.npy", np.ones((5, 4), np.float32))
    assert read_painting(tmp_path / "fine.npy").tolist() == np.ones((5, 4)).tolist()
