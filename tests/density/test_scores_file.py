"""The scores file and the event log: round trips, and refusal of anything else."""

from __future__ import annotations

import json
from dataclasses import fields, replace
from pathlib import Path

import numpy as np
import pytest

from sacha_core.avatar.gaussians import Gaussians
from sacha_core.density.events import (
    Calibration,
    Densification,
    HiddenRemoval,
    OpacityReset,
    Pruning,
    dump_events,
    parse_events,
)
from sacha_core.density.scores_file import BlendingSums, Scores, read_scores, write_scores
from sacha_core.errors import FormatError
from sacha_core.npz import read_npz, write_npz

EVENTS = (
    OpacityReset(10, 0.01, 7),
    Densification(20, (3, 4), (1, 0), (0, 2), (0, 0), (4, 6)),
    Calibration(30, (4, 6), (2, 0), (0.1, 0.2), (0.3, None), (0.2, None), 0.16, 0.3, 0.2, (1.6, 0.8), (3e-4, 2e-4), (0.2, 0.1), "plain"),
    HiddenRemoval(30, "after", 120, 1 / 12, (5, 7), (2, 1), (1, 1), (4, 6)),
    Pruning(30, "pis", "off", (4, 6), (1, 1), (1, 0), (3, 6)),
)  # fmt: skip


@pytest.fixture
def scores() -> Scores:
    rng = np.random.default_rng(0)
    n = 9
    shapes = {
        "position": (3,), "log_scale": (3,), "quaternion": (4,), "opacity_logit": (), "sh_dc": (3,), "sh_rest": (15, 3),
        "sensitivity_logit": (),
    }  # fmt: skip
    attributes = {name: rng.normal(size=(n, *shape)).astype(np.float32) for name, shape in shapes.items()}
    gaussians = Gaussians(**attributes, binding=np.arange(n, dtype=np.int32) // 2)
    sums = BlendingSums(rng.exponential(size=n), rng.random(n), 12)
    return Scores(gaussians, rng.exponential(size=n), 5, "paper", EVENTS, sums)


def test_scores_come_back_to_the_bit(scores, tmp_path: Path) -> None:
    write_scores(tmp_path / "a.scores.npz", scores)
    back = read_scores(tmp_path / "a.scores.npz")
    for f in fields(Gaussians):
        ours, theirs = getattr(scores.gaussians, f.name), getattr(back.gaussians, f.name)
        assert ours.dtype == theirs.dtype
        assert np.array_equal(ours, theirs)
    assert np.array_equal(back.score, scores.score)
    assert (back.n_faces, back.scheme, back.events) == (5, "paper", EVENTS)
    assert back.sums is not None
    assert back.sums.n_views == 12
    assert np.array_equal(back.sums.weight, scores.sums.weight)
    assert np.array_equal(back.sums.sensitive_weight, scores.sums.sensitive_weight)


def test_files_without_blending_sums_are_read_too(scores, tmp_path: Path) -> None:
    write_scores(tmp_path / "a.npz", replace(scores, sums=None))
    assert read_scores(tmp_path / "a.npz").sums is None


def test_visible_is_what_has_more_than_so_many_pixels_a_view() -> None:
    sums = BlendingSums(np.array([0.0, 1.0, 1.001]), np.zeros(3), 10)
    assert sums.visible(0.1).tolist() == [False, False, True]


def test_equal_scores_make_equal_bytes(scores, tmp_path: Path) -> None:
    for name in ("a", "b"):
        write_scores(tmp_path / f"{name}.npz", scores)
    assert (tmp_path / "a.npz").read_bytes() == (tmp_path / "b.npz").read_bytes()


def test_gaussians_without_sensitivity_are_no_scores(scores, tmp_path: Path) -> None:
    bare = replace(scores, gaussians=replace(scores.gaussians, sensitivity_logit=None))
    with pytest.raises(ValueError, match="sensitivities"):
        write_scores(tmp_path / "a.npz", bare)


@pytest.mark.parametrize(
    ("name", "value", "message"),
    [
        ("position", None, "missing"),
        ("version", np.array(2), "version 2"),
        ("version", np.array("1"), "one integer"),
        ("position", np.zeros((8, 3), np.float32), "expected"),
        ("position", np.zeros((9, 3), np.int32), "expected"),
        ("binding", np.zeros(9, np.float32), "expected"),
        ("binding", np.full(9, 5, np.int32), "triangle 5"),
        ("log_scale", np.full((9, 3), np.nan, np.float32), "not finite"),
        ("score", np.full(9, -1.0), "negative"),
        ("score", np.full(9, np.inf), "not finite"),
        ("sh_rest", np.zeros((9, 2, 3), np.float32), "sh_rest"),
        ("scheme", np.array(3), "one text"),
        ("weight", np.full(9, np.nan), "negative"),
        ("weight", np.zeros(8), "expected"),
        ("sensitive_weight", None, "all or none"),
        ("n_views", np.array(-1), "0 or more"),
        ("events", np.array("{}"), "event 1"),
    ],
)
def test_what_is_wrong_is_named(scores, tmp_path: Path, name, value, message) -> None:
    path = tmp_path / "a.npz"
    write_scores(path, scores)
    arrays = read_npz(path)
    arrays = {key: array for key, array in arrays.items() if key != name} | ({} if value is None else {name: value})
    write_npz(path, arrays)
    with pytest.raises(FormatError, match=message):
        read_scores(path)


def test_events_come_back_and_are_one_json_object_a_line() -> None:
    text = dump_events(EVENTS)
    assert parse_events(text) == EVENTS
    records = [json.loads(line) for line in text.splitlines()]
    kinds = [record["event"] for record in records]
    assert kinds == ["opacity_reset", "densification", "calibration", "hidden_removal", "pruning"]
    assert parse_events("") == ()


@pytest.mark.parametrize(
    "line", ["x", "[]", "3", "{}", '{"event": "party"}', '{"event": "opacity_reset", "iteration": 1}', "[" * 100_000]
)
def test_other_lines_are_refused_with_their_number(line) -> None:
    with pytest.raises(FormatError, match="event 2"):
        parse_events(dump_events(EVENTS[:1]) + line)
