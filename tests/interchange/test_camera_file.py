"""Cameras of other programs, as JSON. Oracle: the numbers that were written, and pinhole projection by hand."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from sacha_core.errors import FormatError
from sacha_core.interchange.camera_file import MAX_BYTES, read_camera_file
from sacha_core.raster.camera import Camera
from sacha_core.raster.rasteriser import NEAR


def told(**other: Any) -> dict[str, Any]:
    camera = Camera.look_at(np.array([0.2, 0.1, 1.0]), np.zeros(3), 320, 200, 500)
    pose = np.eye(4)
    pose[:3, :3], pose[:3, 3] = camera.rotation, camera.translation
    usual = {
        "width": 320,
        "height": 200,
        "K": [[500, 0, 161.5], [0, 510.25, 99]],
        "world_to_camera": pose.tolist(),
    }
    usual["K"].append([0, 0, 1])
    return usual | other


def written(folder: Path, content: object) -> Path:
    path = folder / "camera.json"
    path.write_text(json.dumps(content))
    return path


def test_every_number_arrives(tmp_path: Path) -> None:
    given = told(near=0.02)
    placed = read_camera_file(written(tmp_path, given))
    camera = placed.camera
    assert (camera.width, camera.height, placed.near) == (320, 200, 0.02)
    assert (camera.fx, camera.fy, camera.cx, camera.cy) == (500, 510.25, 161.5, 99)
    np.testing.assert_array_equal(camera.rotation, np.array(given["world_to_camera"])[:3, :3])
    np.testing.assert_array_equal(camera.translation, np.array(given["world_to_camera"])[:3, 3])
    assert read_camera_file(written(tmp_path, told())).near == NEAR


WRONG = {
    "no object": [1, 2],
    "width is 0": told(width=0),
    "width is 320.5": told(width=320.5),
    "height is True": told(height=True),
    "height is 16385": told(height=16385),
    "K is missing": told(K=None),
    "K is not": told(K=[[500, 1, 160], [0, 500, 100], [0, 0, 1]]),
    "with focal lengths above 0": told(K=[[-500, 0, 160], [0, 500, 100], [0, 0, 1]]),
    "world_to_camera is missing": told(world_to_camera=[[1, 0], [0, 1]]),
    "it scales": told(world_to_camera=np.diag([2.0, 2, 2, 1]).tolist()),
    "mirrors": told(world_to_camera=np.diag([1.0, 1, -1, 1]).tolist()),
    "rows of 4 finite": told(world_to_camera=np.full((4, 4), np.nan).tolist()),
    "near is 0": told(near=0),
    "near is 'close'": told(near="close"),
}


@pytest.mark.parametrize("fault", WRONG)
def test_what_is_no_camera_is_named(tmp_path: Path, fault: str) -> None:
    expected = "expected a JSON object" if fault == "no object" else fault
    with pytest.raises(FormatError, match=expected):
        read_camera_file(written(tmp_path, WRONG[fault]))


@pytest.mark.parametrize("content", [b"", b"{", b"\xff\xfe\x00", b"[" * 20_000, b" " * (MAX_BYTES + 1)])
def test_bytes_that_are_no_json_are_one_error(tmp_path: Path, content: bytes) -> None:
    path = tmp_path / "camera.json"
    path.write_bytes(content)
    with pytest.raises(FormatError, match=r"camera\.json"):
        read_camera_file(path)
