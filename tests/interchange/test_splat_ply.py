"""Oracle: plyfile, another's reader and writer. Then exact round trips, and every kind of wrong file."""

from __future__ import annotations

from dataclasses import fields, replace
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from plyfile import PlyData, PlyElement

from sacha_core.avatar.gaussians import PLY_BYTES_PER_GAUSSIAN, Gaussians
from sacha_core.errors import FormatError, OptionError
from sacha_core.interchange.splat_ply import read_bound_ply, write_bound_ply

COEFFICIENTS = (0, 3, 8, 15)


def random_gaussians(n: int = 20, degree: int = 3, sensitivity: bool = False, seed: int = 0) -> Gaussians:
    rng = np.random.default_rng(seed)

    def normal(*shape: int) -> np.ndarray:
        return rng.normal(size=shape).astype(np.float32)

    return Gaussians(
        position=normal(n, 3),
        log_scale=normal(n, 3),
        quaternion=normal(n, 4),
        opacity_logit=normal(n),
        sh_dc=normal(n, 3),
        sh_rest=normal(n, COEFFICIENTS[degree], 3),
        binding=rng.integers(10144, size=n).astype(np.int32),
        sensitivity_logit=normal(n) if sensitivity else None,
    )


def assert_same(a: Gaussians, b: Gaussians) -> None:
    for f in fields(Gaussians):
        one, other = getattr(a, f.name), getattr(b, f.name)
        assert (one is None) == (other is None), f.name
        if one is not None:
            assert one.dtype == other.dtype, f.name
            np.testing.assert_array_equal(one, other)


@given(st.integers(0, 30), st.integers(0, 3), st.booleans(), st.integers(0, 999))
def test_round_trip_is_exact(tmp_path_factory, n: int, degree: int, sensitivity: bool, seed: int) -> None:
    path = tmp_path_factory.mktemp("ply") / "a.ply"
    gaussians = random_gaussians(n, degree, sensitivity, seed)
    write_bound_ply(path, gaussians, degree)
    assert_same(read_bound_ply(path), gaussians)


def test_plyfile_reads_what_is_written(tmp_path: Path) -> None:
    gaussians = random_gaussians(sensitivity=True)
    write_bound_ply(tmp_path / "a.ply", gaussians)
    data = PlyData.read(tmp_path / "a.ply")["vertex"].data
    expected = [
        "x",
        "y",
        "z",
        "nx",
        "ny",
        "nz",
        *(f"f_dc_{i}" for i in range(3)),
        *(f"f_rest_{i}" for i in range(45)),
        "opacity",
    ]
    expected += [*(f"scale_{i}" for i in range(3)), *(f"rot_{i}" for i in range(4)), "binding_0", "sensitivity_0"]
    assert list(data.dtype.names) == expected
    assert {data.dtype[name] for name in expected} == {np.dtype("<f4")}
    np.testing.assert_array_equal(data["z"], gaussians.position[:, 2])
    np.testing.assert_array_equal(data["f_rest_0"], gaussians.sh_rest[:, 0, 0])
    np.testing.assert_array_equal(data["f_rest_14"], gaussians.sh_rest[:, 14, 0])  # red coefficients first, all of them
    np.testing.assert_array_equal(data["f_rest_15"], gaussians.sh_rest[:, 0, 1])
    np.testing.assert_array_equal(data["f_rest_44"], gaussians.sh_rest[:, 14, 2])
    np.testing.assert_array_equal(data["rot_0"], gaussians.quaternion[:, 0])
    np.testing.assert_array_equal(data["binding_0"], gaussians.binding)
    assert not data["nx"].any()


def as_rows(gaussians: Gaussians, path: Path, **kinds: str) -> np.ndarray:
    """Rows as plyfile gives them, some properties of another type."""
    write_bound_ply(path, gaussians, gaussians.sh_degree)
    rows = PlyData.read(path)["vertex"].data
    return rows.astype([(name, kinds.get(name, "<f4")) for name in rows.dtype.names])


def save_rows(
    rows: np.ndarray, path: Path, byte_order: str = "<", text: bool = False, comments: tuple[str, ...] = ()
) -> None:
    PlyData([PlyElement.describe(rows, "vertex")], byte_order=byte_order, text=text, comments=list(comments)).write(
        path
    )


@pytest.mark.parametrize("degree", range(4))
@pytest.mark.parametrize("byte_order", ["<", ">"])
def test_reads_what_plyfile_writes(tmp_path: Path, degree: int, byte_order: str) -> None:
    gaussians = random_gaussians(degree=degree)
    save_rows(
        as_rows(gaussians, tmp_path / "a.ply", binding_0="<i4"),
        tmp_path / "b.ply",
        byte_order,
        comments=("made by hand",),
    )
    assert_same(read_bound_ply(tmp_path / "b.ply"), gaussians)


def test_properties_in_another_order_with_others_between_and_an_element_after(tmp_path: Path) -> None:
    gaussians = random_gaussians(degree=1)
    rows = as_rows(gaussians, tmp_path / "a.ply")
    names = list(
        np.random.default_rng(0).permutation([name for name in rows.dtype.names if name not in {"nx", "ny", "nz"}])
    )
    mixed = np.zeros(len(rows), [("flag", "u1"), *((name, "<f4") for name in names), ("weight", "<f8")])
    for name in names:
        mixed[name] = rows[name]
    after = np.zeros(3, [("vertex_indices", "i4")])
    PlyData([PlyElement.describe(mixed, "vertex"), PlyElement.describe(after, "face")], byte_order="<").write(
        tmp_path / "b.ply"
    )
    assert_same(read_bound_ply(tmp_path / "b.ply"), gaussians)


def test_size_of_a_record(tmp_path: Path) -> None:
    sizes = []
    for n in (10, 11):
        write_bound_ply(tmp_path / "a.ply", random_gaussians(n))
        sizes.append((tmp_path / "a.ply").stat().st_size)
    assert sizes[1] - sizes[0] == PLY_BYTES_PER_GAUSSIAN == 252


def test_missing_coefficients_are_padded_with_zeros(tmp_path: Path) -> None:
    gaussians = random_gaussians(degree=1)
    write_bound_ply(tmp_path / "a.ply", gaussians)
    back = read_bound_ply(tmp_path / "a.ply")
    np.testing.assert_array_equal(back.sh_rest[:, :3], gaussians.sh_rest)
    assert not back.sh_rest[:, 3:].any()
    with pytest.raises(OptionError, match="sh_degree 0 of the PLY is not between 1"):
        write_bound_ply(tmp_path / "a.ply", gaussians, 0)


def test_bindings_up_to_the_last_exact_float(tmp_path: Path) -> None:
    gaussians = replace(random_gaussians(4), binding=np.array([0, 1, 2**24 - 2, 2**24 - 1], np.int32))
    write_bound_ply(tmp_path / "a.ply", gaussians)
    np.testing.assert_array_equal(read_bound_ply(tmp_path / "a.ply").binding, gaussians.binding)


@pytest.mark.parametrize(
    ("binding", "n_faces", "message"),
    [
        (np.array([0.0, 1.5]), None, r"binding_0 of Gaussian 1 is 1.5, expected the index of a triangle"),
        (np.array([0.0, np.nan]), None, "binding_0 of Gaussian 1 is nan"),
        (np.array([0.0, 3e38]), None, "binding_0 of Gaussian 1 is 3.0000000"),
        (np.array([0.0, -1.0]), None, "binding_0 of Gaussian 1 is -1, expected the index of a triangle"),
        (np.array([0.0, 12.0]), 12, "Gaussian 1 is bound to triangle 12; the head has triangles 0 to 11"),
    ],
)
def test_bindings_that_are_none(tmp_path: Path, binding: np.ndarray, n_faces: int | None, message: str) -> None:
    rows = as_rows(random_gaussians(2), tmp_path / "a.ply")
    rows["binding_0"] = binding
    save_rows(rows, tmp_path / "b.ply")
    with pytest.raises(FormatError, match=rf"b\.ply: {message}"):
        read_bound_ply(tmp_path / "b.ply", n_faces)


@pytest.mark.parametrize("name", ["x", "opacity", "scale_2", "rot_3", "f_dc_1", "f_rest_7", "binding_0"])
def test_missing_properties_are_named(tmp_path: Path, name: str) -> None:
    rows = as_rows(random_gaussians(), tmp_path / "a.ply")
    kept = [other for other in rows.dtype.names if other != name]
    save_rows(np.array(rows[kept].tolist(), [(other, "<f4") for other in kept]), tmp_path / "b.ply")
    with pytest.raises(FormatError, match="44 f_rest properties" if name == "f_rest_7" else f"no property {name}"):
        read_bound_ply(tmp_path / "b.ply")


@pytest.mark.parametrize("name", ["x", "opacity", "f_rest_44", "rot_0"])
def test_properties_of_a_wrong_type_are_named(tmp_path: Path, name: str) -> None:
    save_rows(as_rows(random_gaussians(), tmp_path / "a.ply", **{name: "<f8"}), tmp_path / "b.ply")
    with pytest.raises(FormatError, match=f"property {name} is of type float64, expected float"):
        read_bound_ply(tmp_path / "b.ply")


@pytest.mark.parametrize(
    ("name", "attribute"), [("x", "position"), ("opacity", "opacity_logit"), ("f_rest_3", "sh_rest")]
)
@pytest.mark.parametrize("poison", [np.nan, np.inf])
def test_numbers_that_are_not_finite_are_named(tmp_path: Path, name: str, attribute: str, poison: float) -> None:
    rows = as_rows(random_gaussians(), tmp_path / "a.ply")
    rows[name][13] = poison
    save_rows(rows, tmp_path / "b.ply")
    with pytest.raises(FormatError, match=f"{attribute} of Gaussian 13 is not finite"):
        read_bound_ply(tmp_path / "b.ply")


def test_text_is_refused_clearly(tmp_path: Path) -> None:
    save_rows(as_rows(random_gaussians(3), tmp_path / "a.ply"), tmp_path / "b.ply", text=True)
    with pytest.raises(
        FormatError, match="PLY format 'ascii' is not read; expected binary_little_endian or binary_big_endian"
    ):
        read_bound_ply(tmp_path / "b.ply")


@pytest.mark.parametrize("cut", [0, 3, 4, 100, 1000, -1])
def test_truncated_files(tmp_path: Path, cut: int) -> None:
    write_bound_ply(tmp_path / "a.ply", random_gaussians())
    (tmp_path / "b.ply").write_bytes((tmp_path / "a.ply").read_bytes()[:cut])
    with pytest.raises(FormatError):
        read_bound_ply(tmp_path / "b.ply")


def test_trailing_bytes(tmp_path: Path) -> None:
    write_bound_ply(tmp_path / "a.ply", random_gaussians(3))
    with (tmp_path / "a.ply").open("ab") as stream:
        stream.write(b"x")
    with pytest.raises(FormatError, match="3 Gaussians of 252 bytes after a header of"):
        read_bound_ply(tmp_path / "a.ply")


HEADER = "ply\nformat binary_little_endian 1.0\nelement vertex 1\nproperty float x\nend_header\n"


@pytest.mark.parametrize(
    ("old", "new", "message"),
    [
        ("ply\n", "plx\n", "not a PLY file"),
        ("vertex 1", "vertex 99999999999", "make [0-9]+ bytes, but the file has"),
        ("vertex 1", "vertex -1", "not understood: 'element vertex -1'"),
        ("vertex 1", "vertex 1e3", "not understood"),
        ("vertex 1", "face 1", "first element must be 'vertex'"),
        ("property float x", "property list uchar int x", "not understood: 'property list"),
        ("property float x", "property float x\nproperty float x", "no property twice"),
        ("property float x", "property half x", "not understood"),
        ("property float x\n", "", "lacks a format"),
        ("format binary_little_endian 1.0\n", "", "lacks a format"),
        ("format binary_little_endian 1.0", "format binary_little_endian 2.0", "not understood"),
        ("end_header", "end_heador", "no end_header line"),
        ("property float x", "\xff\xfe", "not understood"),
    ],
)
def test_headers_that_are_none(tmp_path: Path, old: str, new: str, message: str) -> None:
    text = HEADER.replace(
        "property float x",
        "\n".join(
            f"property float {name}"
            for name in (
                *"xyz",
                *(f"f_dc_{i}" for i in range(3)),
                "opacity",
                *(f"scale_{i}" for i in range(3)),
                *(f"rot_{i}" for i in range(4)),
                "binding_0",
            )
        )
        if not old.startswith("property")
        else "property float x",
    )
    assert old in text
    (tmp_path / "a.ply").write_bytes(text.replace(old, new).encode("latin1") + bytes(60))
    with pytest.raises(FormatError, match=message):
        read_bound_ply(tmp_path / "a.ply")


def test_any_bytes_are_gaussians_or_a_format_error(tmp_path: Path) -> None:
    write_bound_ply(tmp_path / "a.ply", random_gaussians(5, 1), 1)
    whole, rng, read = (tmp_path / "a.ply").read_bytes(), np.random.default_rng(0), 0
    for _ in range(300):
        data = bytearray(whole)
        for at in rng.integers(min(len(whole), 700), size=rng.integers(1, 4)):
            data[at] = rng.integers(256)
        (tmp_path / "b.ply").write_bytes(data)
        try:
            read_bound_ply(tmp_path / "b.ply").validate(2**24)
            read += 1
        except FormatError:
            pass
    assert 0 < read < 300


@pytest.mark.wrong_shapes
def test_nothing_is_left_when_writing_fails(tmp_path: Path) -> None:
    broken = replace(random_gaussians(3), position=np.zeros((2, 3), np.float32))
    with pytest.raises(ValueError, match="dimension"):
        write_bound_ply(tmp_path / "a.ply", broken)
    assert not list(tmp_path.iterdir())


@pytest.mark.real_data
def test_a_real_avatar_goes_round(real_data: Path, tmp_path: Path) -> None:
    gaussians = read_bound_ply(real_data / "avatar_a_bound.ply", 9976)
    assert (len(gaussians), gaussians.sh_degree) == (20018, 0)
    data = PlyData.read(real_data / "avatar_a_bound.ply")["vertex"].data
    np.testing.assert_array_equal(gaussians.log_scale[:, 1], data["scale_1"])
    np.testing.assert_array_equal(gaussians.binding, data["binding_0"])
    write_bound_ply(tmp_path / "a.ply", gaussians, 0)
    assert_same(read_bound_ply(tmp_path / "a.ply"), gaussians)
    assert (tmp_path / "a.ply").read_bytes()[-72 * 20018 :] == (real_data / "avatar_a_bound.ply").read_bytes()[
        -72 * 20018 :
    ]
