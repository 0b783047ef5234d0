"""Schemes of one's own: what is written is read again, and whatever is wrong with a file is said in one line."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from sacha_core.errors import FormatError, HeadError, OptionError
from sacha_core.flame.synthetic import synthetic_head
from sacha_core.npz import read_npz, write_npz
from sacha_core.regions.labels import label_triangles
from sacha_core.regions.partition import Partition, partition_by
from sacha_core.regions.scheme import PAPER
from sacha_core.regions.scheme_file import read_scheme_file, write_scheme_file

HEAD = synthetic_head("small")


def halves() -> Partition:
    """Give two regions of the head."""
    labels = (np.arange(HEAD.n_faces) % 2).astype(np.uint8)
    return Partition("halves", ("left half", "right.001"), ((1, 2, 3), (250, 251, 252)), labels)


def test_the_masks_scheme_is_a_partition_like_any_other() -> None:
    found = partition_by(HEAD)
    assert (found.name, found.regions, found.colours) == (PAPER.name, PAPER.regions, PAPER.colours)
    assert np.array_equal(found.labels, label_triangles(HEAD, PAPER))
    for colour, label in zip(found.triangle_colours, found.labels, strict=True):
        assert tuple(colour) == PAPER.colours[label]


@given(st.integers(0, 99))
def test_what_is_written_is_read_again(tmp_path_factory, seed) -> None:
    rng = np.random.default_rng(seed)
    n = int(rng.integers(1, 20))
    colours = tuple(tuple(int(c) for c in rng.integers(0, 256, 3)) for _ in range(n))
    made = Partition(
        "mine", tuple(f"part {i}" for i in range(n)), colours, rng.integers(0, n, HEAD.n_faces).astype(np.uint8)
    )
    path = tmp_path_factory.mktemp("scheme") / "mine.scheme.npz"
    write_scheme_file(path, made)
    found = read_scheme_file(path, HEAD)
    assert (found.name, found.regions, found.colours) == (made.name, made.regions, made.colours)
    assert np.array_equal(found.labels, made.labels)


def test_regions_without_colours_get_those_of_the_papers_scheme_in_turn(tmp_path: Path) -> None:
    path = tmp_path / "nine.scheme.npz"
    names = [f"r{i}" for i in range(9)]
    labels = np.zeros(HEAD.n_faces, np.int64)
    write_npz(path, {"version": np.array(1), "name": np.array("nine"), "regions": np.array(names), "labels": labels})
    assert read_scheme_file(path, HEAD).colours == (*PAPER.colours, PAPER.colours[0])


def test_an_unknown_region_is_refused_with_those_that_there_are() -> None:
    assert halves().label("right.001") == 1
    with pytest.raises(OptionError, match=r"no region 'mouth'; it has left half, right\.001"):
        halves().label("mouth")


@pytest.mark.parametrize(
    ("change", "error", "message"),
    [
        ({"labels": None}, FormatError, "'labels' is missing"),
        ({"version": np.array(2)}, FormatError, "version 1"),
        ({"version": np.array("1")}, FormatError, "version 1"),
        ({"name": np.array(7)}, FormatError, "name"),
        ({"name": np.array("")}, FormatError, "name"),
        ({"regions": np.array(["a", "a"])}, FormatError, "different names"),
        ({"regions": np.array(["a=b", "c"])}, FormatError, "without = and :"),
        ({"regions": np.array(["a\n", "c"])}, FormatError, "printable"),
        ({"regions": np.array([1, 2])}, FormatError, "expected texts"),
        ({"regions": np.array([f"r{i}" for i in range(65)])}, FormatError, "1 to 64 regions"),
        ({"labels": np.zeros(HEAD.n_faces)}, FormatError, "one integer"),
        ({"labels": np.zeros(HEAD.n_faces - 1, int)}, HeadError, "triangles, but head"),
        ({"labels": np.full(HEAD.n_faces, 2)}, FormatError, "outside 0 to 1"),
        ({"labels": np.full(HEAD.n_faces, -1)}, FormatError, "outside 0 to 1"),
        ({"colours": np.zeros((3, 3), np.uint8)}, FormatError, "colours are"),
    ],
)
def test_files_that_make_no_sense_are_refused(tmp_path: Path, change, error, message) -> None:
    path = tmp_path / "x.scheme.npz"
    write_scheme_file(path, halves())
    arrays = read_npz(path) | change
    write_npz(path, {name: value for name, value in arrays.items() if value is not None})
    with pytest.raises(error, match=message):
        read_scheme_file(path, HEAD)
