"""Oracles: plyfile, and the avatar carried into the world by the library's own other way."""

from __future__ import annotations

import io
import json
import os
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from PIL import Image
from plyfile import PlyData

from sacha_core.avatar.binding import to_world
from sacha_core.codec import decode, encode
from sacha_core.evaluate.peers.splat_transform import lacking, transform
from sacha_core.flame.posing import Poser
from sacha_core.flame.synthetic import synthetic_head
from sacha_core.geometry.triangle import triangle_frames
from sacha_core.interchange.gaussian_avatars import read_model
from sacha_core.regions.partition import partition_by
from sacha_core.regions.scheme import PAPER
from sacha_core.regions.scheme_file import write_scheme_file

LOG_ERROR = 1e-5  # float32: the logarithm of a product against the sum of logarithms of about 5
REST = ("--format", "ply", "--head", "synthetic:small")
PLY_BYTES = 248  # 62 float32: what viewers and engines insist on, whatever the degree


def columns(path: Path, *names: str) -> np.ndarray:
    rows = PlyData.read(path)["vertex"].data
    return np.stack([rows[name] for name in names], axis=1)


def test_ply_frames_are_the_avatar_in_the_world(done, sacha_file: Path, tmp_path: Path) -> None:
    report = done("export", sacha_file, "--format", "ply", "--frames", "0:5:2", "-o", tmp_path / "frames").report
    assert [Path(file).name for file in report["files"]] == ["00000.ply", "00002.ply", "00004.ply"]
    head = synthetic_head("small")
    avatar = decode(sacha_file, head=head)
    for file in map(Path, report["files"]):
        rows = PlyData.read(file)["vertex"]
        assert len(rows.properties) == 62
        vertices = Poser(head, avatar.motion)(int(file.stem))
        world = to_world(avatar.gaussians, triangle_frames(vertices, head.faces))
        np.testing.assert_array_equal(columns(file, "x", "y", "z"), world.means)
        np.testing.assert_array_equal(columns(file, "rot_0", "rot_1", "rot_2", "rot_3"), world.quaternions)
        scale = columns(file, "scale_0", "scale_1", "scale_2")
        np.testing.assert_allclose(scale, np.log(world.scales), atol=LOG_ERROR)
        np.testing.assert_array_equal(rows["opacity"], avatar.gaussians.opacity_logit)
        np.testing.assert_array_equal(rows["f_rest_1"], avatar.gaussians.sh_rest[:, 1, 0])
        np.testing.assert_array_equal(rows["f_rest_44"], 0)  # degree 3, which the avatar lacks
        assert len(file.read_bytes().partition(b"end_header\n")[2]) == PLY_BYTES * report["n_gaussians"]


def test_one_frame_is_one_file(done, sacha_file: Path, tmp_path: Path) -> None:
    report = done("export", sacha_file, "--frames", 3, "-o", tmp_path / "a.ply").report
    assert report["files"] == [str(tmp_path / "a.ply")]
    assert report["bytes"] == (tmp_path / "a.ply").stat().st_size


@pytest.mark.parametrize(
    ("arguments", "said"),
    [
        (("--frames", "5"), "expected a frame from 0 to 4"),
        (("--frames", "x"), "expected a frame from 0 to 4"),
        (("--frames", "9:"), "names none of the 5 frames"),
        (("--frames", ":"), "expected a folder"),
    ],
)
def test_frames_that_are_not_there(refused, sacha_file: Path, tmp_path: Path, arguments, said: str) -> None:
    assert said in refused("export", sacha_file, *arguments, "-o", tmp_path / "a.ply")
    assert not list(tmp_path.iterdir())


@pytest.fixture
def resting(sacha_file: Path, tmp_path: Path) -> Path:
    """Give the file without its motion."""
    head, path = synthetic_head("small"), tmp_path / "resting.sacha"
    path.write_bytes(encode(replace(decode(sacha_file.read_bytes(), head=head), motion=None), head=head))
    return path


@pytest.mark.parametrize("frames", ["0:3", "1", "1:", ":2:2"])
def test_frames_of_an_avatar_without_motion_are_told_to_be_one(refused, resting: Path, tmp_path: Path, frames) -> None:
    said = refused("export", resting, *REST, "--frames", frames, "-o", tmp_path / "out")
    assert f"--frames {frames}: the avatar has no motion, and so 1 frame" in said
    assert not (tmp_path / "out").exists()


@pytest.mark.parametrize("frames", ["0", ":", "0:1", "::2"])
def test_the_one_frame_of_an_avatar_without_motion_can_be_named(done, resting: Path, tmp_path: Path, frames) -> None:
    done("export", resting, *REST, "-o", tmp_path / "a.ply")
    done("export", resting, *REST, "--frames", frames, "-o", tmp_path / "out")
    assert [path.name for path in (tmp_path / "out").iterdir()] == ["00000.ply"]
    assert (tmp_path / "out" / "00000.ply").read_bytes() == (tmp_path / "a.ply").read_bytes()


def test_gltf_takes_frames_too_and_can_be_larger(done, sacha_file: Path, tmp_path: Path) -> None:
    report = done("export", sacha_file, "--format", "gltf-splats", "--frames", ":2", "-o", tmp_path / "frames").report
    assert [Path(file).name for file in report["files"]] == ["00000.glb", "00001.glb"]
    done("export", sacha_file, "-o", tmp_path / "a.ply")
    done("export", sacha_file, "--enlarge", 10, "--y-down", "-o", tmp_path / "b.ply")
    small, large = (columns(tmp_path / name, "x", "y", "z") for name in ("a.ply", "b.ply"))
    np.testing.assert_allclose(large, small * [-10, -10, 10], rtol=1e-6)
    for scale in ("scale_0", "scale_2"):
        difference = columns(tmp_path / "b.ply", scale) - columns(tmp_path / "a.ply", scale)
        np.testing.assert_allclose(difference, np.log(10), atol=LOG_ERROR)


@pytest.mark.parametrize(
    ("format_", "name", "said"),
    [
        ("ply", "a.glb", "expected a name that ends in .ply"),
        ("gltf-splats", "a.PLY", "expected a name that ends in .glb"),
        ("gltf-head", "a.gltf", "expected a name that ends in .glb"),
        ("spz", "a.ply", "expected a name that ends in .spz"),
        ("gaussian-avatars", "a.ply", "expected the name of a folder"),
    ],
)
def test_names_that_say_another_format(refused, sacha_file: Path, tmp_path: Path, format_, name, said: str) -> None:
    """What such a name would become: a folder called a.glb, or a .gltf that no program opens."""
    assert said in refused("export", sacha_file, "--format", format_, "-o", tmp_path / name)
    assert not list(tmp_path.iterdir())


@pytest.mark.parametrize(
    ("arguments", "said"),
    [
        (("--format", "gltf-splats", "--y-down"), "--y-down is for ply; --format gltf-splats has no use for it"),
        (("--enlarge", "nan"), "--enlarge is nan, expected a factor"),
        (("--enlarge", "-1"), "--enlarge is -1, expected a factor"),
    ],
)
def test_options_without_a_use(refused, sacha_file: Path, tmp_path: Path, arguments, said: str) -> None:
    assert said in refused("export", sacha_file, *arguments, "-o", tmp_path / "a.ply")
    assert not list(tmp_path.iterdir())


def test_spz_comes_back_through_its_own_program(call, done, sacha_file: Path, tmp_path: Path) -> None:
    """Oracle: the same frame as PLY; SPZ rounds places to 1/4096 and opacities and colours to 8 bits."""
    outcome = call("export", sacha_file, "--format", "spz", "-o", tmp_path / "a.spz")
    if lacking():
        assert outcome.status == 2
        assert "needs the program splat-transform" in outcome.err
        assert not list(tmp_path.iterdir())
        if {"spz", "all"} & set(os.environ.get("SACHA_REQUIRE_PEERS", "").split(",")):
            pytest.fail(lacking() or "")
        return
    assert outcome.status == 0, outcome.err
    transform(tmp_path, "a.spz", "back.ply")
    done("export", sacha_file, "--enlarge", 16, "--y-down", "-o", tmp_path / "a.ply")
    back, given = (columns(tmp_path / name, "x", "y", "z") for name in ("back.ply", "a.ply"))
    near = np.abs(back[:, None] - given[None]).max(axis=2).min(axis=0)  # it may reorder them
    assert len(back) == len(given)
    assert near.max() < 0.75 / 4096


def test_a_model_for_gaussian_avatars_comes_back(done, sacha_file: Path, tmp_path: Path) -> None:
    outcome = done("export", sacha_file, "--format", "gaussian-avatars", "-o", tmp_path / "model")
    assert "GaussianAvatars' programs pose FLAME alone" in outcome.out  # the tests' head is not FLAME
    there = {path for path in (tmp_path / "model").rglob("*") if path.is_file()}
    assert set(map(Path, outcome.report["files"])) == there
    assert outcome.report["bytes"] == sum(path.stat().st_size for path in there)
    gaussians, motion = read_model(tmp_path / "model")
    avatar = decode(sacha_file, head=synthetic_head("small"))
    for name in ("position", "sh_dc", "quaternion", "binding"):
        np.testing.assert_array_equal(getattr(gaussians, name), getattr(avatar.gaussians, name))
    np.testing.assert_array_equal(motion.expression, avatar.motion.expression)
    assert done("inspect", sacha_file).status == 0
    again = tmp_path / "again.sacha"
    assert done("encode", tmp_path / "model", "--level", "archive", "-o", again).report["n_frames"] == len(motion)


def test_a_folder_whose_model_would_be_opened_instead(done, refused, sacha_file: Path, tmp_path: Path) -> None:
    """Oracle: their viewer opens the last iteration, and so do we."""
    given = ("export", sacha_file, "--format", "gaussian-avatars", "-o", tmp_path / "model")
    done(*given)
    done(*given)  # the same again is no obstacle
    place = tmp_path / "model" / "point_cloud"
    (place / "iteration_1").rename(place / "iteration_30000")
    assert "holds iteration 30000 of a model" in refused(*given)
    assert "holds iteration 30000 of a model" in refused("decode", sacha_file, "--model", tmp_path / "model")
    assert [path.name for path in place.iterdir()] == ["iteration_30000"]


def test_the_motion_of_another_avatar_is_not_left_beside_one_that_has_none(
    done, refused, sacha_file: Path, tmp_path: Path
) -> None:
    bare = tmp_path / "bare.ply"
    done("decode", sacha_file, "--ply", bare)
    done("export", sacha_file, "--format", "gaussian-avatars", "-o", tmp_path / "model")
    head = ("--head", "synthetic:small")
    given = ("export", bare, *head, "--format", "gaussian-avatars", "-o", tmp_path / "model")
    assert "holds the motion of a model" in refused(*given)
    assert len(done(*given[:-1], tmp_path / "other").report["files"]) == 3
    frames = ("--format", "gltf-head", "--frames", 0, "-o", tmp_path / "a.glb")
    assert "the avatar has no motion to take frames from" in refused("export", bare, *head, *frames)


def check_region_map(path: Path, colours: np.ndarray) -> None:
    """Hold the texel in the middle of each triangle, found as glTF says, to the colour that it should have."""
    data = path.read_bytes()
    n_json = int.from_bytes(data[12:16], "little")
    document, binary = json.loads(data[20 : 20 + n_json]), data[28 + n_json :]

    def part(view: int) -> bytes:
        held = document["bufferViews"][view]
        return binary[held["byteOffset"] :][: held["byteLength"]]

    def array(accessor: int, kind: str) -> np.ndarray:
        return np.frombuffer(part(document["accessors"][accessor]["bufferView"]), kind)

    (primitive,) = document["meshes"][0]["primitives"]
    faces = array(primitive["indices"], "<u4").reshape(-1, 3)
    uv = array(primitive["attributes"]["TEXCOORD_0"], "<f4").reshape(-1, 2)
    with Image.open(io.BytesIO(part(document["images"][0]["bufferView"]))) as picture:
        texels = np.asarray(picture)
    middle = uv[faces].mean(axis=1) * [texels.shape[1], texels.shape[0]]
    column, row = np.floor(middle).astype(int).T
    right = (texels[row, column] == colours).all(axis=1)
    assert right.mean() > 0.99  # triangles smaller than a texel may miss its middle


def test_a_head_as_gltf(done, refused, sacha_file: Path, tmp_path: Path) -> None:
    report = done("export", sacha_file, "--format", "gltf-head", "-o", tmp_path / "a.glb").report
    assert report["bytes"] == (tmp_path / "a.glb").stat().st_size
    regions = partition_by(synthetic_head("small"))
    check_region_map(tmp_path / "a.glb", np.array(PAPER.colours)[regions.labels])
    own = replace(regions, name="halves", regions=("low", "high"), colours=((9, 90, 200), (250, 20, 30)))
    own = replace(own, labels=(np.arange(len(regions.labels)) % 2).astype(np.uint8))
    write_scheme_file(tmp_path / "own.scheme.npz", own)
    named = ("--format", "gltf-head", "--scheme", tmp_path / "own.scheme.npz", "-o", tmp_path / "d.glb")
    done("export", sacha_file, *named)
    check_region_map(tmp_path / "d.glb", np.array(own.colours)[own.labels])
    assert "both say" in refused(
        "export", sacha_file, *named[:-1], tmp_path / "b.glb", "--texture", tmp_path / "own.scheme.npz"
    )
    picture = io.BytesIO()
    Image.fromarray(np.zeros((40, 40), np.uint8)).save(picture, "PNG")
    (tmp_path / "a.png").write_bytes(picture.getvalue())
    done("export", sacha_file, "--format", "gltf-head", "--texture", tmp_path / "a.png", "-o", tmp_path / "c.glb")
    assert picture.getvalue() in (tmp_path / "c.glb").read_bytes()
    for wrong in (b"no picture", picture.getvalue()[:50], picture.getvalue()[:60].replace(b"IDAT", b"XDAT")):
        (tmp_path / "a.txt").write_bytes(wrong)
        with_text = ("--format", "gltf-head", "--texture", tmp_path / "a.txt", "-o", tmp_path / "b.glb")
        assert "a.txt is no PNG" in refused("export", sacha_file, *with_text)
    with_nothing = ("--format", "gltf-head", "--texture", tmp_path / "nowhere.png", "-o", tmp_path / "b.glb")
    assert "nowhere.png" in refused("export", sacha_file, *with_nothing)
    assert not (tmp_path / "b.glb").exists()
