"""`sacha framewise`: frames, a report that adds up, nothing done twice, and one line for each mistake."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
from PIL import Image

from sacha_core.interchange.splat_ply import read_world_ply

SHORT = ("--frames", 2, "--first", 1, "--iterations", 20, "--sh-degree", 0)


def test_frames_and_their_report_add_up_and_are_made_once(done, capture: Path, tmp_path: Path) -> None:
    outcome = done("framewise", capture, *SHORT, "-o", tmp_path / "frames")
    report = json.loads((tmp_path / "frames" / "report.json").read_text())
    assert report["frames"] == outcome.report["frames"]
    assert [frame["timestep"] for frame in report["frames"]] == [1, 2]
    for frame in report["frames"]:
        path = tmp_path / "frames" / frame["file"]
        assert len(read_world_ply(path)) == frame["n"]
        assert frame["bytes"] == 248 * frame["n"]
        assert 0 <= path.stat().st_size - frame["bytes"] < 2000  # the header
        with Image.open(path.with_name("held_out.png")) as picture:
            assert picture.size == (2 * 64, 94)
    assert report["mean"]["psnr"] == np.mean([frame["psnr"] for frame in report["frames"]])
    assert report["bytes"] == sum(frame["bytes"] for frame in report["frames"])
    before = {path: path.stat().st_mtime_ns for path in tmp_path.rglob("*.ply")}
    again = done("framewise", capture, *SHORT, "-o", tmp_path / "frames")
    assert again.report["frames"] == outcome.report["frames"]
    assert {path: path.stat().st_mtime_ns for path in tmp_path.rglob("*.ply")} == before
    assert "mean" in again.out


def test_what_makes_no_sense_is_refused(refused, capture: Path, sacha_file: Path, tmp_path: Path) -> None:
    out = ("-o", tmp_path / "frames")
    assert "--frames is 0" in refused("framewise", capture, "--frames", 0, *out)
    assert "--first is -1" in refused("framewise", capture, "--first", -1, *out)
    assert "--iterations is 5" in refused("framewise", capture, "--iterations", 5, *out)
    assert "timestep 3 has no training view; timesteps 0 to 2 have some" in refused(
        "framewise", capture, "--frames", 4, *out
    )
    assert "--height" in refused("framewise", capture, "--width", 32, *out)
    assert "not a folder" in refused("framewise", sacha_file, *out)
    assert "no such file" in refused("framewise", tmp_path / "none", *out)
    assert not (tmp_path / "frames").exists()
    (tmp_path / "file").write_text("")
    assert "not a directory" in refused("framewise", capture, *SHORT, "-o", tmp_path / "file")
