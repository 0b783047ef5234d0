"""A real avatar through the shell: into a small file, back, and onto the screen."""

from __future__ import annotations

from pathlib import Path

import av
import numpy as np
import pytest
from PIL import Image

from sacha_core.interchange.motion_file import read_motion
from sacha_core.interchange.splat_ply import read_bound_ply

pytestmark = pytest.mark.real_data

LARGEST = 110_000  # bytes at level 2 with 973 frames of motion; measured 90,800
LIKENESS = 38.0  # dB between whole pictures before and after level 2: measured 42.4; level 1 gives 33.7, a picture of another moment 34.6


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
    assert 0.85 * len(before) < len(after) <= len(before)
    counts = np.bincount(before.binding, minlength=9976) - np.bincount(after.binding, minlength=9976)
    assert counts.min() >= 0  # Gaussians that never show are gone, none has changed its triangle
    weights = read_motion(real_data / "motion_arkit_a.npz").expression
    assert np.abs(read_motion(tmp_path / "m.npz").expression - weights).max() < 0.05


def test_render_shows_the_same_face_after_compression(
    done, real_data: Path, source, file: Path, tmp_path: Path
) -> None:
    view = ("--frame", 300, "--width", 275, "--height", 401, "--focal", 600)
    done("render", real_data / "avatar_a_bound.ply", *source, *view, "-o", tmp_path / "before.png")
    done("render", file, *view, "-o", tmp_path / "after.png")  # finds the rig that encode used
    before, after = pixels(tmp_path / "before.png"), pixels(tmp_path / "after.png")
    assert after.shape == (401, 275, 3)
    error = np.mean(np.square(before - after)) / 255**2
    assert -10 * np.log10(error) > LIKENESS
    assert 0.1 < (after.min(axis=2) < 200).mean() < 0.8


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
