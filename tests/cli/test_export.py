"""Oracles: plyfile, and the avatar carried into the world by the library's own other way."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from plyfile import PlyData

from sacha_core.avatar.binding import to_world
from sacha_core.codec import decode
from sacha_core.flame.posing import Poser
from sacha_core.flame.synthetic import synthetic_head
from sacha_core.geometry.triangle import triangle_frames

LOG_ERROR = 1e-5  # float32: the logarithm of a product against the sum of logarithms of about 5
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
