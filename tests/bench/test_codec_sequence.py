"""A sequence coded frame by frame, from splats that correspond and from splats that were trained apart."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest

from sacha_core.animation.standing import Standing
from sacha_core.avatar.gaussians import Gaussians
from sacha_core.bench.codec_clip import POSED, TRAINED, captured_psnr, make_clip, picture_psnr
from sacha_core.bench.codec_sequence import sequence_rows
from sacha_core.bench.preset import Preset, Subject
from sacha_core.bench.scenes import made_avatar
from sacha_core.errors import OptionError
from sacha_core.evaluate.peers.peer import visible
from sacha_core.evaluate.peers.registry import PEERS
from sacha_core.progress import silent
from sacha_core.raster.rasteriser import Rasteriser
from sacha_core.raster.scene import render_avatar

AVATAR, HEAD = made_avatar(500, 1, 6)
SUBJECT = Subject(AVATAR, HEAD, Path("made.sacha"))
STANDING = Standing(AVATAR.gaussians, HEAD, AVATAR.motion)
HALF_A_LEVEL_DB = 54.0  # of an image of 8 bits that rounds a picture: 10 log10(12 * 255^2) = 58.9, less what is clipped


def trained(*frames: int) -> dict[int, Gaussians]:
    """Give splats for frames as if trained apart: another choice of the avatar's own each time, in an order of chance."""
    rng, found = np.random.default_rng(3), {}
    for time in frames:
        seen = visible(STANDING(time))
        some = seen.select(rng.permutation(len(seen))[: 400 + 10 * time])
        found[time] = replace(some, binding=np.zeros(len(some), np.int32))
    return found


def test_trained_frames_are_taken_as_they_are_and_posed_ones_stand_beside_them() -> None:
    """Oracle: the splats given, and the avatar as it stands in these frames."""
    given = trained(2, 3, 5)
    clip = make_clip(SUBJECT, 2, 0.1, given)
    assert clip.times == (2, 3)
    for place, time in enumerate(clip.times):
        np.testing.assert_array_equal(clip.splats[TRAINED][place].position, given[time].position)
        np.testing.assert_allclose(clip.splats[POSED][place].position, visible(STANDING(time)).position, atol=1e-6)
        corners = clip.shots[place].frames.origin[clip.splats[TRAINED][place].binding]
        assert np.linalg.norm(corners - given[time].position, axis=1).max() < 0.05  # at the triangle that is near


def test_frames_that_the_motion_lacks_are_refused() -> None:
    with pytest.raises(OptionError, match=r"splats of frame 9; the motion of made.sacha has frames 0 to 5"):
        make_clip(SUBJECT, 4, 0.1, {0: STANDING(0), 9: STANDING(0)})


def test_every_route_is_taken_on_both_kinds_of_splats() -> None:
    codecs = [name for name in ("sacha", "hevc") if PEERS[name].lacking() is None]
    given = trained(1, 2)
    rows = sequence_rows("a", SUBJECT, codecs, Preset("tiny", threads=1), Rasteriser(1), silent, given)
    assert not [row for row in rows if row.get("failure")]
    assert len({(row["splats"], row["route"]) for row in rows}) == len(rows)
    plain = {row["splats"]: row for row in rows if row["route"] == "uncompressed"}
    numbers = 17 + 3 * 3  # of a splat of degree 1
    assert plain["trained for each frame"]["kb"] == pytest.approx(sum(map(len, given.values())) * 4 * numbers / 1000)
    assert "psnr" not in plain["one avatar"]
    assert all(row["psnr"] > 25 for row in rows if row["route"] != "uncompressed"), rows
    kinds = {row["splats"] for row in rows}
    assert len(kinds) == (3 if "hevc" in codecs else 2)


def test_a_capture_judges_frames_by_their_own_time() -> None:
    """Oracle: pictures of the avatar itself, which are wrong by rounding alone; and another frame's, which are not."""
    clip = make_clip(SUBJECT, 2, 0.2, {})
    shown, rasteriser = clip.uncompressed(POSED), Rasteriser(1)
    views, images = [], {}
    for place, time in enumerate(clip.times):
        camera = clip.shots[place].cameras[0]
        drawn = render_avatar(AVATAR.gaussians, clip.shots[place].frames, camera, rasteriser=rasteriser).colour
        views.append(SimpleNamespace(timestep=time, camera=camera, number=place))
        images[place] = np.round(255 * np.clip(drawn, 0, 1)).astype(np.uint8)
    capture = SimpleNamespace(val=views, image=lambda view: images[view.number])
    right = captured_psnr(clip, capture, shown, rasteriser)
    assert right is not None
    assert right > HALF_A_LEVEL_DB
    wrong = SimpleNamespace(val=views, image=lambda view: images[1 - view.number])
    other = captured_psnr(clip, wrong, shown, rasteriser)
    assert other is not None
    assert other < right - 10
    assert captured_psnr(clip, SimpleNamespace(val=[]), shown, rasteriser) is None
    assert picture_psnr(clip, shown, shown, rasteriser) == 120
