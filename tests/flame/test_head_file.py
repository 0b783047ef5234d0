"""Round trips are exact; anything else is refused with the name of what is wrong."""

from __future__ import annotations

import contextlib
from dataclasses import fields, replace
from pathlib import Path

import numpy as np
import pytest

from sacha_core.errors import FormatError, HeadError, SachaError
from sacha_core.flame.head_file import load_head, save_head
from sacha_core.flame.model import HeadModel
from sacha_core.npz import write_npz


def assert_same_head(a: HeadModel, b: HeadModel) -> None:
    for f in fields(HeadModel):
        one, other = getattr(a, f.name), getattr(b, f.name)
        if isinstance(one, np.ndarray):
            assert one.dtype == other.dtype
            np.testing.assert_array_equal(one, other)
        elif isinstance(one, dict):
            assert one.keys() == other.keys()
            for key in one:
                np.testing.assert_array_equal(one[key], other[key])
        else:
            assert one == other


def test_round_trip(random_head: HeadModel, tmp_path: Path) -> None:
    head = replace(
        random_head,
        uv=np.random.default_rng(0).random((9, 2)).astype(np.float32),
        uv_faces=np.full((40, 3), 8, np.int32),
        n_teeth_faces=3,
    )
    save_head(head, tmp_path / "a.npz")
    assert_same_head(load_head(tmp_path / "a.npz"), head)
    assert load_head(tmp_path / "a.npz").reference == head.reference


def test_round_trip_of_a_head_with_the_least(make_head, tmp_path: Path) -> None:
    head = replace(make_head(1, correctives=False), masks={}, shapedirs=np.zeros((30, 3, 0), np.float32))
    save_head(head, tmp_path / "a.npz")
    assert_same_head(load_head(tmp_path / "a.npz"), head)


def test_equal_heads_give_equal_bytes(random_head: HeadModel, tmp_path: Path) -> None:
    for name in "ab":
        save_head(random_head, tmp_path / f"{name}.npz")
    assert (tmp_path / "a.npz").read_bytes() == (tmp_path / "b.npz").read_bytes()


def test_wider_numbers_are_narrowed(random_head: HeadModel, tmp_path: Path) -> None:
    arrays = file_arrays(random_head, tmp_path)
    wide = {
        k: a.astype(np.float64 if a.dtype == np.float32 else np.int64) if a.dtype.kind in "fi" else a
        for k, a in arrays.items()
    }
    write_npz(tmp_path / "wide.npz", wide)
    assert_same_head(load_head(tmp_path / "wide.npz"), random_head)


def file_arrays(head: HeadModel, folder: Path) -> dict[str, np.ndarray]:
    save_head(head, folder / "source.npz")
    with np.load(folder / "source.npz") as archive:
        return dict(archive)


def poisoned(array: np.ndarray, value: float) -> np.ndarray:
    out = array.copy()
    out.flat[0] = value
    return out


@pytest.mark.wrong_shapes
@pytest.mark.parametrize(
    ("name", "change", "message"),
    [
        ("v_template", lambda a: a[:-1], "faces .* has index 29|shape"),
        ("v_template", lambda a: poisoned(a, np.nan), "v_template of head 'random' is not finite at row 0"),
        ("shapedirs", lambda a: a[:, :2], r"shapedirs of head 'random' has shape \(30, 2, 6\), expected \(30, 3, any\)"),
        ("exprdirs", lambda a: a.astype(complex), "'exprdirs' of the head is of complex128, expected real numbers"),
        ("faces", lambda a: poisoned(a, 30), "faces of head 'random' has index 30 in row 0, expected 0 to 29"),
        ("faces", lambda a: poisoned(a, -1), "faces of head 'random' has index -1"),
        ("faces", lambda a: a.astype(np.float32), "'faces' of the head is of float32, expected whole numbers"),
        ("faces", lambda a: a.astype(np.int64) + 2**40, "beyond 32 bits"),
        ("faces", lambda a: a[:0], "at least one triangle"),
        ("weights", lambda a: a * 2, "skinning weights of vertex 0 of head 'random' sum to 2, expected 1"),
        ("parents", lambda a: np.array([-1, 0, 1, 1, 4], a.dtype), "parents of head 'random' are .* expected -1 first"),
        ("parents", lambda a: np.array([0, 0, 1, 1, 1], a.dtype), "expected -1 first"),
        ("parents", lambda a: a[:4], "J_regressor of head 'random' has shape"),
        ("parents", lambda a: np.r_[a, a], "10 joints, expected 1 to 5: root, neck"),
        ("posedirs", lambda a: a[:, :, :9], r"posedirs .* expected \(30, 3, 36\)"),
        ("mask_lips", lambda a: a + 30, "mask 'lips' of head 'random' has index 30"),
        ("mask_lips", lambda a: a.reshape(2, 2), "mask 'lips' of head 'random' is not a list"),
        ("mask_lips", lambda a: a * 0.5, "'mask_lips' of the head is of float64"),
        ("n_teeth_faces", lambda a: a + 41, "41 teeth triangles of 40"),
        ("name", lambda a: a, None),
    ],
)  # fmt: skip
def test_what_does_not_fit_is_named(random_head: HeadModel, tmp_path: Path, name, change, message) -> None:
    arrays = file_arrays(random_head, tmp_path)
    arrays[name] = change(arrays[name])
    write_npz(tmp_path / "changed.npz", arrays)
    if message is None:
        load_head(tmp_path / "changed.npz")
        return
    with pytest.raises((HeadError, FormatError), match=message):
        load_head(tmp_path / "changed.npz")


def test_missing_arrays_are_all_named(random_head: HeadModel, tmp_path: Path) -> None:
    arrays = file_arrays(random_head, tmp_path)
    del arrays["weights"], arrays["faces"]
    write_npz(tmp_path / "changed.npz", arrays)
    with pytest.raises(FormatError, match="lacks faces, weights"):
        load_head(tmp_path / "changed.npz")


def test_saving_what_contradicts_itself_writes_nothing(random_head: HeadModel, tmp_path: Path) -> None:
    with pytest.raises(HeadError):
        save_head(replace(random_head, weights=random_head.weights * 2), tmp_path / "a.npz")
    assert not list(tmp_path.iterdir())


def test_cut_and_flipped_files_never_get_past_the_reader_as_anything_else(
    random_head: HeadModel, tmp_path: Path
) -> None:
    save_head(random_head, tmp_path / "a.npz")
    whole = (tmp_path / "a.npz").read_bytes()
    rng = np.random.default_rng(0)
    target = tmp_path / "b.npz"
    for trial in range(150):
        data = bytearray(whole[: rng.integers(len(whole))] if trial % 3 == 0 else whole)
        for _ in range(trial % 4):
            if data:
                data[rng.integers(len(data))] ^= 1 << rng.integers(8)
        target.write_bytes(data)
        with contextlib.suppress(SachaError):  # anything else escapes and fails the test
            load_head(target).validate()


def test_reference_changes_with_what_poses_and_not_with_names(random_head: HeadModel) -> None:
    assert replace(random_head, masks={}, name="other").reference.sha256 == random_head.reference.sha256
    assert replace(random_head, v_template=random_head.v_template + 1).reference.sha256 != random_head.reference.sha256
    assert replace(random_head, posedirs=None).reference.sha256 != random_head.reference.sha256
