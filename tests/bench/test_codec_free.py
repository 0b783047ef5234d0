"""Splats without a head among the codecs: nothing about them changes but place and size, and what needs a head says so."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from PIL import Image

from sacha_core.animation.standing import Standing
from sacha_core.bench.codec_compare import compare_codecs
from sacha_core.bench.codec_free import REACH_M, free_shots, free_subject
from sacha_core.bench.preset import Comparison, Preset
from sacha_core.bench.scenes import made_avatar
from sacha_core.errors import FormatError, OptionError
from sacha_core.evaluate.peers.peer import visible
from sacha_core.evaluate.peers.registry import PEERS
from sacha_core.progress import silent
from sacha_core.raster.rasteriser import Rasteriser
from sacha_core.raster.scene import render_avatar

AVATAR, HEAD = made_avatar(400, 1, 1)
SCENE = Standing(AVATAR.gaussians, HEAD, None)(0)
ROUNDED = 2e-6  # metres: float32 at half a metre, and the middle of a scene that is not exact
PATH = Path("rooms/scene.ply")


def test_a_scene_is_moved_and_scaled_as_one() -> None:
    """Oracle: a similarity keeps ratios of distances and of sizes; nine tenths of what shows lie within the reach."""
    far = replace(
        SCENE, position=SCENE.position * 40 + np.float32(7), log_scale=SCENE.log_scale + np.float32(np.log(40))
    )
    near, same = (free_subject(one, PATH).avatar.gaussians for one in (SCENE, far))
    assert np.abs(near.position - same.position).max() < ROUNDED * 40
    assert np.abs(near.log_scale - same.log_scale).max() < 1e-5
    seen = np.linalg.norm(visible(near).position, axis=1)
    assert (seen <= REACH_M * 1.001).mean() == pytest.approx(0.9, abs=0.01)
    before, after = (np.linalg.norm(g.position[1:] - g.position[:1], axis=1) for g in (SCENE, near))
    assert after / before == pytest.approx(np.full(len(before), after[0] / before[0]), rel=1e-3)


def test_all_cameras_see_the_scene() -> None:
    """Oracle: the rasteriser; the middle of every picture is covered somewhere near."""
    subject = free_subject(SCENE, PATH)
    (shot,) = free_shots(subject, 0.2)
    assert len(shot.cameras) == 16
    for camera in shot.cameras:
        alpha = render_avatar(subject.avatar.gaussians, shot.frames, camera, rasteriser=Rasteriser(1)).alpha
        assert 0.05 < (alpha > 0.01).mean() < 0.9


@pytest.mark.parametrize("hidden", [False, True])
def test_nothing_to_look_at_is_refused(hidden: bool) -> None:
    logits = np.full(len(SCENE), -20 if hidden else 2, np.float32)
    with pytest.raises(FormatError, match="no Gaussian shows" if hidden else "lie on one point"):
        free_subject(replace(SCENE, opacity_logit=logits, position=np.zeros_like(SCENE.position)), PATH)


def test_what_takes_splats_is_measured_and_what_needs_a_head_says_so() -> None:
    names = ("sacha", "ply", "xz", "draco", "hevc")
    bench = compare_codecs(Comparison((free_subject(SCENE, PATH),), names), Preset("tiny", threads=1), silent)
    points = [row for row in bench.rows if row["table"] == "points"]
    there = {name for name in names[1:] if PEERS[name].lacking() is None}
    assert {row["codec"] for row in points if row.get("kb")} == there
    assert [row["codec"] for row in points if row.get("failure")] == ["sacha"]
    assert "--head HEAD" in points[-1]["failure"]
    assert not [row for row in points if row.get("binding_kb")]
    assert not [row for row in bench.rows if row["table"] == "sequence"]
    assert any("bound to no head" in note for note in bench.notes)
    best = {row["codec"]: row["psnr"] for row in points if row.get("psnr")}
    assert all(psnr > 35 for psnr in best.values()), best
    assert {row["avatar"] for row in points} == {"scene"}


def test_a_sheet_is_drawn_without_ours_and_without_any_picture_to_show(tmp_path: Path) -> None:
    """Oracle: more codecs make a taller picture, and lossless ones have nothing to show."""
    heights = []
    for number, names in enumerate((("ply",), ("ply", "draco"))):
        sheet = tmp_path / f"{number}.png"
        compare_codecs(Comparison((free_subject(SCENE, PATH),), names, sheet=sheet), Preset("tiny", threads=1), silent)
        with Image.open(sheet) as picture:
            heights.append(picture.height)
    assert (heights[0] < heights[1]) == (PEERS["draco"].lacking() is None)


def test_nothing_but_codecs_for_avatars_is_refused_at_once() -> None:
    with pytest.raises(OptionError, match="takes only Gaussians that are bound to a head"):
        compare_codecs(Comparison((free_subject(SCENE, PATH),), ("sacha", "paper")), Preset("tiny"), silent)


def test_frames_belong_to_one_avatar_that_is_bound() -> None:
    with pytest.raises(OptionError, match="--frames holds splats of one avatar's frames"):
        compare_codecs(Comparison((free_subject(SCENE, PATH),), ("ply",), frames={0: SCENE}), Preset("tiny"), silent)
