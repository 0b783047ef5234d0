"""A real avatar through the shell: into a small file, back, and onto the screen."""

from __future__ import annotations

from pathlib import Path

import av
import numpy as np
import pytest
from PIL import Image

from sacha_core.codec import decode
from sacha_core.flame.open import open_head
from sacha_core.flame.posing import Poser
from sacha_core.geometry.triangle import triangle_frames
from sacha_core.interchange.motion_file import read_motion
from sacha_core.interchange.splat_ply import read_bound_ply
from sacha_core.perception.psnr import psnr
from sacha_core.raster.camera import Camera
from sacha_core.raster.scene import render_avatar

pytestmark = pytest.mark.real_data

LARGEST = 62_000  # bytes at level 2 with 973 frames of motion; measured 55,700
VERTEX_ERROR_M = 1e-4  # root mean square, of all vertices
LIKENESS = 37.0  # dB between whole pictures before and after level 2


@pytest.fixture(scope="module")
def source(real_data: Path) -> tuple[object, ...]:
    """Give the options that name the avatar."""
    return "--head", real_data / "avatar_a_rig.npz", "--motion", real_data / "motion_arkit_a.npz"


@pytest.fixture(scope="module")
def file(done, real_data: Path, source, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Give the avatar as a `.sacha` file of level 2."""
    path = tmp_path_factory.mktemp("real") / "a.sacha"
    report = done("encode", "--ply", real_data / "avatar_a_bound.ply", *source, "--level", 2, "-o", path).report
    assert report["n_frames"] == 973
    assert report["bytes"]["total"] == path.stat().st_size < LARGEST
    return path


def pixels(path: Path) -> np.ndarray:
    with Image.open(path) as picture:
        return np.asarray(picture).astype(float)


def test_decode_gives_it_back(done, real_data: Path, file: Path, tmp_path: Path) -> None:
    done("decode", file, "--ply", tmp_path / "back.ply", "--flame-param", tmp_path / "m.npz")
    before, after = read_bound_ply(real_data / "avatar_a_bound.ply"), read_bound_ply(tmp_path / "back.ply", 9976)
    assert 0.5 * len(before) < len(after) <= len(before)  # two fifths are not worth their bits at this level
    counts = np.bincount(before.binding, minlength=9976) - np.bincount(after.binding, minlength=9976)
    assert counts.min() >= 0  # none has changed its triangle
    head = open_head(real_data / "avatar_a_rig.npz")
    poses = [Poser(head, read_motion(path)) for path in (real_data / "motion_arkit_a.npz", tmp_path / "m.npz")]
    off = [np.linalg.norm(poses[0](frame) - poses[1](frame), axis=1) for frame in range(0, 973, 50)]
    assert np.sqrt(np.mean(np.square(off))) < VERTEX_ERROR_M


def test_render_shows_the_same_face_after_compression(
    done, real_data: Path, source, file: Path, tmp_path: Path
) -> None:
    view = ("--frame", 300, "--width", 275, "--height", 401, "--focal", 600)
    done("render", real_data / "avatar_a_bound.ply", *source, *view, "-o", tmp_path / "before.png")
    done("render", file, *view, "-o", tmp_path / "after.png")  # finds the rig that encode used
    before, after = pixels(tmp_path / "before.png"), pixels(tmp_path / "after.png")
    assert after.shape == before.shape == (401, 275, 3)
    # the middle that the camera looks at moves by a fraction of a pixel with what was left out: shares of the picture, not pixels
    shown = [(picture.min(axis=2) < 200).mean() for picture in (before, after)]
    assert 0.1 < shown[0] < 0.8
    assert abs(shown[1] - shown[0]) < 0.01


def test_one_camera_sees_the_same_face_after_compression(real_data: Path, file: Path) -> None:
    head = open_head(real_data / "avatar_a_rig.npz")
    avatar = decode(file, head=head)
    motion = read_motion(real_data / "motion_arkit_a.npz")
    camera = Camera.look_at(np.array([0, 0, 0.9]), np.zeros(3), 275, 401, 600.0)
    gaussians = {"before": read_bound_ply(real_data / "avatar_a_bound.ply"), "after": avatar.gaussians}
    motions = {"before": motion, "after": avatar.motion}
    drawn = {
        name: np.clip(
            render_avatar(gaussians[name], triangle_frames(Poser(head, motions[name])(300), head.faces), camera).colour,
            0,
            1,
        )
        for name in gaussians
    }
    assert psnr(drawn["before"], drawn["after"]) > LIKENESS


def test_regions_are_drawn_with_masks(done, real_data: Path, file: Path, tmp_path: Path) -> None:
    size = ("--width", 55, "--height", 80)
    done(
        "render", file, "-o", tmp_path / "r.png", "--colour", "region", "--masks", real_data / "FLAME_masks.npz", *size
    )
    assert len(np.unique(pixels(tmp_path / "r.png").reshape(-1, 3), axis=0)) > 100


def test_a_head_that_moves(done, file: Path, tmp_path: Path) -> None:
    path = tmp_path / "a.mp4"
    done("render", file, "--video", path, "--frames", "0:50:10", "--azimuth", -30, 30, "--width", 80, "--height", 120)
    with av.open(str(path)) as container:
        frames = [frame.to_ndarray(format="rgb24").astype(float) for frame in container.decode(video=0)]
    assert len(frames) == 5
    assert frames[0].shape == (120, 160, 3)
    assert np.abs(frames[0] - frames[4]).max() > 30
