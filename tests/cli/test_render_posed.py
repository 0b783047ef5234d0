"""Pictures of any pose from any camera, and their error. Oracles: the same picture by other options, and the engine's own functions."""

from __future__ import annotations

import json
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
from PIL import Image

import sacha_core
from sacha_core.flame.open import open_head
from sacha_core.flame.posing import pose_vertices
from sacha_core.perception.psnr import psnr
from sacha_core.raster.camera import Camera

ROUNDING = 1  # of 255: the rasteriser adds up the same numbers in another order where a crop begins elsewhere
SEEN = 32  # of 255: lighter than black on any screen
BRIGHT_PART = 0.005  # of the avatar's pixels: more would be told apart no longer


def image(path: Path) -> np.ndarray:
    return np.asarray(Image.open(path).convert("RGB"))


def write_camera(path: Path, camera: Camera, **other: float) -> Path:
    pose = np.eye(4)
    pose[:3, :3], pose[:3, 3] = camera.rotation, camera.translation
    intrinsics = [[camera.fx, 0, camera.cx], [0, camera.fy, camera.cy], [0, 0, 1]]
    told = {"width": camera.width, "height": camera.height, "K": intrinsics, "world_to_camera": pose.tolist()}
    path.write_text(json.dumps(told | other))
    return path


@pytest.fixture
def camera(tmp_path: Path) -> tuple[Path, Camera]:
    """A camera from the front left, with its principal point off the centre."""
    looking = Camera.look_at(np.array([0.3, 0.05, 0.8]), np.zeros(3), 60, 80, 150)
    moved = Camera(60, 80, 150, 160, 25.5, 44.25, looking.rotation, looking.translation)
    return write_camera(tmp_path / "camera.json", moved), moved


def test_a_cameras_file_gives_the_very_view(
    sacha_file: Path, camera: tuple[Path, Camera], done, tmp_path: Path
) -> None:
    done("render", sacha_file, "--frame", 1, "--camera-file", camera[0], "-o", tmp_path / "a.png")
    avatar, head = sacha_core.decode(sacha_file), open_head("synthetic:small")
    frames = sacha_core.triangle_frames(pose_vertices(head, avatar.motion, 1), head.faces)
    picture = sacha_core.render_avatar(avatar.gaussians, frames, camera[1]).colour
    assert np.array_equal(image(tmp_path / "a.png"), np.rint(255 * np.clip(picture, 0, 1)))


def test_a_posed_mesh_takes_the_place_of_a_frame(
    sacha_file: Path, camera: tuple[Path, Camera], done, tmp_path: Path
) -> None:
    avatar, head = sacha_core.decode(sacha_file), open_head("synthetic:small")
    np.save(tmp_path / "v.npy", pose_vertices(head, avatar.motion, 2))
    given = ("--camera-file", camera[0])
    done("render", sacha_file, "--vertices", tmp_path / "v.npy", *given, "-o", tmp_path / "mesh.png")
    done("render", sacha_file, "--frame", 2, *given, "-o", tmp_path / "frame.png")
    assert np.array_equal(image(tmp_path / "mesh.png"), image(tmp_path / "frame.png"))
    done(
        "render",
        sacha_file,
        "--vertices",
        tmp_path / "v.npy",
        "--width",
        60,
        "--height",
        80,
        "-o",
        tmp_path / "usual.png",
    )
    done("render", sacha_file, "--frame", 2, "--width", 60, "--height", 80, "-o", tmp_path / "player.png")
    usual, player = image(tmp_path / "usual.png").astype(int), image(tmp_path / "player.png").astype(int)
    assert np.abs(usual - player).max() <= ROUNDING


def test_what_is_nearer_than_near_is_not_drawn(
    sacha_file: Path, camera: tuple[Path, Camera], done, tmp_path: Path
) -> None:
    beyond = write_camera(tmp_path / "far.json", camera[1], near=5.0)
    done("render", sacha_file, "--camera-file", beyond, "-o", tmp_path / "nothing.png")
    assert (image(tmp_path / "nothing.png") == 255).all()


def test_a_level_shows_what_encode_would_write(model: Path, camera: tuple[Path, Camera], done, tmp_path: Path) -> None:
    files = {name: tmp_path / f"{name}.png" for name in ("picture", "truth", "error")}
    level = ("--level", 1, "--encoded", tmp_path / "kept.sacha", "--camera-file", camera[0], "--frame", 1)
    report = done(
        *("render", model, *level, "-o", files["picture"], "--truth", files["truth"], "--error", files["error"])
    ).report
    done("encode", model, "--level", 1, "-o", tmp_path / "encoded.sacha")
    assert (tmp_path / "kept.sacha").read_bytes() == (tmp_path / "encoded.sacha").read_bytes()
    assert report["bytes"] == (tmp_path / "encoded.sacha").stat().st_size
    done("render", model, "--frame", 1, "--camera-file", camera[0], "-o", tmp_path / "plain.png")
    assert files["truth"].read_bytes() == (tmp_path / "plain.png").read_bytes()
    picture, truth = image(files["picture"]), image(files["truth"])
    assert report["psnr_db"] == pytest.approx(psnr(picture, truth))
    assert report["own_psnr_db"] < report["psnr_db"]
    differs = (picture != truth).any(axis=2)
    assert differs.any()
    assert np.array_equal(image(files["error"]).any(axis=2), differs)


def test_a_kept_file_is_drawn_and_an_old_one_made_anew(model: Path, sacha_file: Path, done, tmp_path: Path) -> None:
    kept = tmp_path / "kept.sacha"
    kept.write_bytes(sacha_file.read_bytes())  # of level 4, so that it is told from one of level 1
    given = ("render", model, "--level", 1, "--encoded", kept, "--width", 40, "--height", 60, "-o", tmp_path / "a.png")
    assert done(*given).report["bytes"] == sacha_file.stat().st_size
    import os  # noqa: PLC0415

    os.utime(kept, (0, 0))
    assert done(*given).report["bytes"] < sacha_file.stat().st_size


def test_an_avatar_against_itself_is_the_same(sacha_file: Path, done, tmp_path: Path) -> None:
    size = ("--width", 40, "--height", 60)
    report = done(
        *("render", sacha_file, "--against", sacha_file, *size, "-o", tmp_path / "a.png", "--error", tmp_path / "e.png")
    ).report
    assert report["identical"]
    assert report["psnr_db"] is None  # infinite
    assert not image(tmp_path / "e.png").any()


def test_flip_paints_what_is_visible(model: Path, sacha_file: Path, done, tmp_path: Path) -> None:
    pytest.importorskip("flip_evaluator", reason="FLIP is an extra: judge")
    error, size = tmp_path / "e.png", ("--width", 40, "--height", 60)
    options = ("--against", sacha_file, "--error", error, "--error-kind", "flip", "--brightest", 1)
    report = done("render", model, *size, "-o", tmp_path / "a.png", *options).report
    assert report["error_kind"] == "flip"
    assert 0 < report["mean_error"] < 1
    assert image(error).any()
    assert report["legend"][-1]["error"] == report["brightest"] == 1


@pytest.mark.parametrize("kind", ["difference", "flip"])
def test_an_error_of_forty_decibels_is_seen_and_not_all_of_it_brightest(
    model: Path, done, tmp_path: Path, kind: str
) -> None:
    if kind == "flip":
        pytest.importorskip("flip_evaluator", reason="FLIP is an extra: judge")
    error, truth = tmp_path / "e.png", tmp_path / "t.png"
    options = ("-o", tmp_path / "a.png", "--truth", truth, "--error", error, "--error-kind", kind, "--level", 4)
    report = done("render", model, "--width", 120, "--height", 160, *options).report
    assert 39 < report["own_psnr_db"] < 42
    painted = image(error)[(image(truth) != 255).any(axis=2)]
    assert np.median(painted.max(axis=1)) > SEEN
    assert (painted == report["legend"][-1]["colour"]).all(axis=1).mean() < BRIGHT_PART


REFUSED = {
    "needs something to compare with": ("--error", "e.png"),
    "expected --level LEVEL beside it": ("--encoded", "k.sacha"),
    "--level is 5": ("--level", 5),
    "--brightest is 0": ("--level", 2, "--brightest", 0),
    "expected the name of an image": ("--level", 2, "-o", "a.txt"),
}


@pytest.mark.parametrize("said", REFUSED)
def test_options_without_a_part_are_refused(
    sacha_file: Path, refused: Callable[..., str], tmp_path: Path, said: str
) -> None:
    options = [tmp_path / x if isinstance(x, str) and "." in x else x for x in REFUSED[said]]
    assert said in refused("render", sacha_file, "-o", tmp_path / "a.png", *options)
    assert not list(tmp_path.iterdir())


def test_vertices_of_another_head_are_refused(sacha_file: Path, refused: Callable[..., str], tmp_path: Path) -> None:
    np.save(tmp_path / "few.npy", np.zeros((7, 3), np.float32))
    (tmp_path / "text.npy").write_text("no array")
    given = ("-o", tmp_path / "a.png", "--vertices")
    assert "has 7 vertices, head" in refused("render", sacha_file, *given, tmp_path / "few.npy")
    assert "is no .npy file" in refused("render", sacha_file, *given, tmp_path / "text.npy")
    assert not (tmp_path / "a.png").exists()


def test_a_camera_is_given_once_and_for_pictures(
    sacha_file: Path, camera: tuple[Path, Camera], refused, tmp_path: Path
) -> None:
    given = ("render", sacha_file, "--camera-file", camera[0])
    assert "the whole camera" in refused(*given, "-o", tmp_path / "a.png", "--azimuth", 20)
    assert "how large" in refused(*given, "-o", tmp_path / "a.png", "--width", 20)
    assert "is for a picture" in refused(*given, "--video", tmp_path / "a.mp4")
