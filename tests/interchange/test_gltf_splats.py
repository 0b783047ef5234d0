"""Oracles: the Khronos Group's validator; the text of KHR_gaussian_splatting; PlayCanvas' splat-transform, which writes it too."""

from __future__ import annotations

import os
import subprocess
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from glb_reading import Glb, validated

from sacha_core.avatar.gaussians import Gaussians
from sacha_core.errors import FormatError
from sacha_core.evaluate.peers.splat_transform import PROGRAM, VARIABLE, lacking
from sacha_core.geometry.quaternion import normalise, to_matrix
from sacha_core.interchange.gltf_splats import EXTENSION, write_gltf_splats
from sacha_core.interchange.splat_ply import write_world_ply
from sacha_core.interchange.y_down import turned_over
from sacha_core.programs import find_program
from sacha_core.raster.harmonics import sh_colours

FLOAT32 = 2e-6  # relative; two ways to add a few products
COUNTS = (0, 3, 8, 15)


def world(n: int, degree: int, seed: int = 0) -> Gaussians:
    rng = np.random.default_rng(seed)

    def normal(*shape: int) -> np.ndarray:
        return rng.normal(size=shape).astype(np.float32)

    return Gaussians(
        normal(n, 3), normal(n, 3) - 5, normal(n, 4), normal(n) * 3, normal(n, 3), normal(n, COUNTS[degree], 3) / 4,
        np.zeros(n, np.int32),
    )  # fmt: skip


def attributes(glb: Glb) -> dict[str, np.ndarray]:
    (mesh,) = glb.document["meshes"]
    (primitive,) = mesh["primitives"]
    return {name: glb.array(index) for name, index in primitive["attributes"].items()}


@pytest.mark.parametrize("degree", range(4))
def test_khronos_validator_knows_but_the_names_of_the_extension(tmp_path: Path, degree: int) -> None:
    write_gltf_splats(tmp_path / "a.glb", world(50, degree))
    known = {"MESH_PRIMITIVE_INVALID_ATTRIBUTE", "UNSUPPORTED_EXTENSION"}
    for message in validated(tmp_path / "a.glb"):
        assert message["code"] in known, message
        assert f"/{EXTENSION}:" in message["pointer"] or message["pointer"] == "/extensionsUsed/0"


def check_against_the_text(glb: Glb) -> None:
    """Hold a file to every "must" of the extension for the ellipse kernel."""
    assert EXTENSION in glb.document["extensionsUsed"]
    (primitive,) = glb.document["meshes"][0]["primitives"]
    assert primitive["mode"] == 0
    facts = primitive["extensions"][EXTENSION]
    assert facts["kernel"] == "ellipse"
    assert facts["colorSpace"] in {"srgb_rec709_display", "lin_rec709_display"}
    assert facts.get("projection", "perspective") == "perspective"
    assert facts.get("sortingMethod", "cameraDistance") == "cameraDistance"
    names = primitive["attributes"]
    kinds = {"POSITION": "VEC3", "ROTATION": "VEC4", "SCALE": "VEC3", "OPACITY": "SCALAR", "SH_DEGREE_0_COEF_0": "VEC3"}
    degrees = 1 + max(int(name.split("_")[-3]) for name in names if "SH_DEGREE" in name)
    for degree in range(degrees):  # none of a degree and all below it may lack
        kinds |= {f"SH_DEGREE_{degree}_COEF_{n}": "VEC3" for n in range(2 * degree + 1)}
    expected = {name if name == "POSITION" else f"{EXTENSION}:{name}": kind for name, kind in kinds.items()}
    assert set(names) == {*expected, "COLOR_0"}
    accessors = {name: glb.document["accessors"][index] for name, index in names.items()}
    assert len({accessor["count"] for accessor in accessors.values()}) == 1
    for name, kind in expected.items():
        assert (accessors[name]["type"], accessors[name]["componentType"]) == (kind, 5126), name
    held = attributes(glb)
    np.testing.assert_allclose(np.linalg.norm(held[f"{EXTENSION}:ROTATION"], axis=1), 1, atol=FLOAT32)
    assert (held[f"{EXTENSION}:SCALE"] >= 0).all()
    opacity = held[f"{EXTENSION}:OPACITY"]
    assert ((opacity >= 0) & (opacity <= 1)).all()
    diffuse = np.clip(held[f"{EXTENSION}:SH_DEGREE_0_COEF_0"] * 0.282095 + 0.5, 0, 1)
    linear = held["COLOR_0"][:, :3].astype(np.float64)
    encoded = np.where(linear <= 0.0031308, 12.92 * linear, 1.055 * linear ** (1 / 2.4) - 0.055)
    np.testing.assert_allclose(encoded, diffuse, atol=1e-5)
    np.testing.assert_array_equal(held["COLOR_0"][:, 3], opacity)


@pytest.mark.parametrize("degree", range(4))
def test_the_text_of_the_extension(tmp_path: Path, degree: int) -> None:
    write_gltf_splats(tmp_path / "a.glb", world(50, degree))
    check_against_the_text(Glb(tmp_path / "a.glb"))


def test_shape_and_place_by_the_formula_of_the_text(tmp_path: Path) -> None:
    gaussians = world(50, 0)
    write_gltf_splats(tmp_path / "a.glb", gaussians)
    held = attributes(Glb(tmp_path / "a.glb"))
    np.testing.assert_array_equal(held["POSITION"], gaussians.position)
    x, y, z, w = held[f"{EXTENSION}:ROTATION"].T.astype(np.float64)
    rotation = [
        [1 - 2 * (y * y + z * z), 2 * (x * y - w * z), 2 * (x * z + w * y)],
        [2 * (x * y + w * z), 1 - 2 * (x * x + z * z), 2 * (y * z - w * x)],
        [2 * (x * z - w * y), 2 * (y * z + w * x), 1 - 2 * (x * x + y * y)],
    ]
    c = np.moveaxis(np.array(rotation), -1, 0) * held[f"{EXTENSION}:SCALE"][:, None, :]
    turn = to_matrix(normalise(gaussians.quaternion.astype(np.float64)))
    ours = turn * np.exp(gaussians.log_scale.astype(np.float64))[:, None, :]
    np.testing.assert_allclose(c @ c.swapaxes(1, 2), ours @ ours.swapaxes(1, 2), rtol=1e-4, atol=1e-9)


def colour_of_the_text(held: dict[str, np.ndarray], direction: np.ndarray) -> np.ndarray:
    """Give the colours by the extension's own formula, unclamped."""
    x, y, z = direction.astype(np.float64).T
    basis = [
        0.2820947917738781 + 0 * x,
        -0.4886025119029199 * y, 0.4886025119029199 * z, -0.4886025119029199 * x,
        1.092548430592079 * x * y, -1.092548430592079 * y * z, 0.3153915652525200 * (2 * z * z - x * x - y * y),
        -1.092548430592079 * x * z, 0.5462742152960395 * (x * x - y * y),
        -0.5900435899266435 * y * (3 * x * x - y * y), 2.890611442640554 * x * y * z,
        -0.4570457994644657 * y * (4 * z * z - x * x - y * y), 0.3731763325901154 * z * (2 * z * z - 3 * x * x - 3 * y * y),
        -0.4570457994644657 * x * (4 * z * z - x * x - y * y), 1.445305721320277 * z * (x * x - y * y),
        -0.5900435899266435 * x * (x * x - 3 * y * y),
    ]  # fmt: skip
    names = [f"{EXTENSION}:SH_DEGREE_{degree}_COEF_{n}" for degree in range(4) for n in range(2 * degree + 1)]
    return 0.5 + sum(held[name] * weight[:, None] for name, weight in zip(names, basis, strict=True))


def test_colours_by_the_formula_of_the_text(tmp_path: Path) -> None:
    gaussians = world(50, 3)
    write_gltf_splats(tmp_path / "a.glb", gaussians)
    centre = np.array([0.3, -0.2, 9.0])
    direction = gaussians.position - centre
    direction /= np.linalg.norm(direction, axis=1, keepdims=True)
    expected = np.maximum(colour_of_the_text(attributes(Glb(tmp_path / "a.glb")), direction), 0)
    ours = sh_colours(gaussians.sh_dc, gaussians.sh_rest, gaussians.position, centre, 3)
    np.testing.assert_allclose(ours, expected, atol=1e-5)


def test_turned_over_looks_the_same_from_the_turned_side() -> None:
    gaussians = world(50, 3)
    turned, centre = turned_over(gaussians), np.array([0.3, -0.2, 9.0])
    half = np.array([-1, -1, 1.0])
    np.testing.assert_array_equal(turned.position, gaussians.position * half)
    seen = [
        sh_colours(one.sh_dc, one.sh_rest, one.position, place, 3)
        for one, place in ((gaussians, centre), (turned, centre * half))
    ]
    np.testing.assert_allclose(seen[0], seen[1], atol=1e-6)
    turn, back = (to_matrix(normalise(one.quaternion.astype(np.float64))) for one in (gaussians, turned))
    np.testing.assert_allclose(half[:, None] * turn, back, atol=1e-12)
    again = turned_over(turned)
    np.testing.assert_array_equal(again.sh_rest, gaussians.sh_rest)
    np.testing.assert_array_equal(again.quaternion, -gaussians.quaternion)


def test_playcanvas_makes_the_same_of_a_ply_turned_over(tmp_path: Path) -> None:
    """Another's writer of the extension, given our other format: it turns a PLY over, since glTF's y is up."""
    if lacking():
        if {"spz", "all"} & set(os.environ.get("SACHA_REQUIRE_PEERS", "").split(",")):
            pytest.fail(lacking() or "")
        pytest.skip(lacking() or "")
    gaussians = world(50, 3)
    gaussians = replace(gaussians, quaternion=normalise(gaussians.quaternion))
    write_gltf_splats(tmp_path / "ours.glb", gaussians)
    write_world_ply(tmp_path / "a.ply", turned_over(gaussians))
    program = find_program(VARIABLE, PROGRAM)
    subprocess.run([str(program), "-w", "-q", "-g", "cpu", "a.ply", "theirs.glb"], cwd=tmp_path, check=True)
    check = Glb(tmp_path / "theirs.glb")
    ours, theirs = attributes(Glb(tmp_path / "ours.glb")), attributes(check)
    assert list(ours) == list(theirs)
    for name in ours.keys() - {"COLOR_0", f"{EXTENSION}:ROTATION"}:
        np.testing.assert_allclose(theirs[name], ours[name], rtol=1e-5, atol=1e-6, err_msg=name)
    rotation = f"{EXTENSION}:ROTATION"
    agree = np.abs((ours[rotation].astype(np.float64) * theirs[rotation]).sum(axis=1))
    np.testing.assert_allclose(agree, 1, atol=1e-5)  # q and -q are one rotation


def test_what_gltf_cannot_hold(tmp_path: Path) -> None:
    with pytest.raises(FormatError, match="there are no Gaussians"):
        write_gltf_splats(tmp_path / "a.glb", world(0, 0))
    huge = world(3, 0)
    huge.log_scale[1, 2] = 100
    with pytest.raises(FormatError, match="Gaussian 1 is larger than float32 can hold"):
        write_gltf_splats(tmp_path / "a.glb", huge)
    assert not list(tmp_path.iterdir())
