"""Oracle: numpy.load for what is sound; every hostile archive is a FormatError."""

from __future__ import annotations

import zipfile
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra import numpy as arrays_of

from sacha_core.errors import FormatError
from sacha_core.npz import read_npz, write_npz

KINDS = st.sampled_from([np.dtype(t) for t in ("<f4", ">f8", "<i4", ">i2", "u1", "?", "<U3", "<c8")])


@given(
    arrays=st.dictionaries(
        st.text("abc_", min_size=1, max_size=4),
        arrays_of.arrays(KINDS, arrays_of.array_shapes(min_dims=0, min_side=0)),
        max_size=3,
    ),
    packed=st.booleans(),
)
def test_reads_what_numpy_writes_and_numpy_reads_what_it_writes(
    tmp_path_factory, arrays: dict[str, np.ndarray], packed: bool
) -> None:
    folder = tmp_path_factory.mktemp("npz")
    (np.savez_compressed if packed else np.savez)(folder / "theirs.npz", **arrays)
    write_npz(folder / "ours.npz", arrays)
    read = read_npz(folder / "theirs.npz")
    with np.load(folder / "ours.npz") as back:
        assert set(back.files) == read.keys() == arrays.keys()
        for name, array in arrays.items():
            for other in (read[name], back[name]):
                assert other.dtype == array.dtype
                np.testing.assert_array_equal(other, array)


def test_fortran_order_is_understood(tmp_path: Path) -> None:
    array = np.asfortranarray(np.arange(24.0).reshape(2, 3, 4))
    np.savez(tmp_path / "a.npz", a=array)
    np.testing.assert_array_equal(read_npz(tmp_path / "a.npz")["a"], array)


def test_skipped_arrays_are_not_read(tmp_path: Path) -> None:
    np.savez(tmp_path / "a.npz", a=np.array([{}], object), b=np.arange(3))
    assert list(read_npz(tmp_path / "a.npz", skip=("a",))) == ["b"]


def test_objects_are_refused_unread(tmp_path: Path) -> None:
    np.savez(tmp_path / "a.npz", a=np.array([{}], object))
    with pytest.raises(FormatError, match="'a' holds Python objects"):
        read_npz(tmp_path / "a.npz")


def raw_member(path: Path, shape: str, payload: bytes, dtype: str = "'<f4'") -> None:
    header = f"{{'descr': {dtype}, 'fortran_order': False, 'shape': {shape}}}\n".encode()
    with zipfile.ZipFile(path, "w") as archive:
        archive.writestr("a.npy", b"\x93NUMPY\x01\x00" + len(header).to_bytes(2, "little") + header + payload)


@pytest.mark.parametrize(
    "shape", ["(4,)", "(2,)", "(-3,)", "(2**70,)", "(10**12, 10**12)", "(1.5,)", "'x'", "((((", "(3,) * 9"]
)
def test_a_shape_that_is_not_its_bytes(tmp_path: Path, shape: str) -> None:
    raw_member(tmp_path / "a.npz", shape, bytes(12))
    with pytest.raises(FormatError, match=r"a\.npz: "):
        read_npz(tmp_path / "a.npz")


@pytest.mark.parametrize("dtype", ["'O'", "'V0'", "'nonsense'", "[('a', 'O')]", "5"])
def test_a_dtype_that_is_none(tmp_path: Path, dtype: str) -> None:
    raw_member(tmp_path / "a.npz", "(3,)", bytes(12), dtype)
    with pytest.raises(FormatError):
        read_npz(tmp_path / "a.npz")


def test_a_bomb_is_refused_before_it_goes_off(tmp_path: Path) -> None:
    np.savez_compressed(tmp_path / "a.npz", a=np.zeros(10**6))
    with pytest.raises(FormatError, match="more than 1000000 bytes"):
        read_npz(tmp_path / "a.npz", max_bytes=10**6)


@pytest.mark.filterwarnings("ignore:Duplicate name")
def test_members_twice(tmp_path: Path) -> None:
    with zipfile.ZipFile(tmp_path / "a.npz", "w") as archive:
        for _ in range(2):
            with archive.open("a.npy", "w") as member:
                np.save(member, np.arange(3))
    with pytest.raises(FormatError, match="'a' occurs twice"):
        read_npz(tmp_path / "a.npz")


@pytest.mark.parametrize("data", [b"", b"PK", b"PK\x05\x06", b"\x93NUMPY", b"PK\x03\x04" + bytes(100)])
def test_no_archive_at_all(tmp_path: Path, data: bytes) -> None:
    (tmp_path / "a.npz").write_bytes(data)
    with pytest.raises(FormatError, match=r"a\.npz"):
        read_npz(tmp_path / "a.npz")
