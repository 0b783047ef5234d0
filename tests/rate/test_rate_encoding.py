"""Encoding by rendering: what goes is what nobody misses, and files are smaller at no more error than plain ones."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from sacha_core.avatar.avatar import Avatar
from sacha_core.avatar.binding import initial_gaussians
from sacha_core.avatar.gaussians import Gaussians
from sacha_core.codec import decode, encode, inspect
from sacha_core.codec.levels import level_at
from sacha_core.flame.model import HeadModel
from sacha_core.raster.rasteriser import Rasteriser
from sacha_core.raster.scene import render_avatar
from sacha_core.rate.covering import FINE_PIXELS
from sacha_core.rate.encoding import RenderingEncoder, encode_by_rendering
from sacha_core.rate.judging import Judge
from sacha_core.rate.stances import stock_motion
from sacha_core.rate.views import protocol_shots
from sacha_core.rate.visibility import STOCK_SHARE, grounds_for, prune, removal_errors

JOINTLY = 2.0  # times what the removed were worth alone, at most: many hide behind one another
DB = 0.01  # float32 pictures, summed in another order


@pytest.fixture(scope="module")
def avatar(head: HeadModel) -> Avatar:
    """A skin of opaque Gaussians, and as many behind it that it hides from all sides."""
    rng = np.random.default_rng(0)
    skin = initial_gaussians(head.n_faces, rng, 0)
    n = len(skin)
    skin = replace(
        skin,
        opacity_logit=np.full(n, 4, np.float32),
        log_scale=rng.normal(-0.4, 0.2, (n, 3)).astype(np.float32),
        sh_dc=rng.uniform(-1, 1, (n, 3)).astype(np.float32),
    )
    below = skin.position.copy()
    below[:, 1] -= 2.5  # along the normal, in triangle units
    both = {
        name: np.concatenate([getattr(skin, name), getattr(replace(skin, position=below), name)])
        for name in ("position", "log_scale", "quaternion", "opacity_logit", "sh_dc", "sh_rest", "binding")
    }
    return Avatar(Gaussians(**both), head.reference, stock_motion(head).frames(slice(0, 8)))


def test_removal_errors_are_means_over_views(avatar: Avatar, head: HeadModel, rasteriser: Rasteriser) -> None:
    """Oracle: drawing without the Gaussian, view by view."""
    shots = grounds_for(avatar, head).own[:2]
    found = removal_errors(avatar.gaussians, shots, rasteriser)
    row = int(np.argmax(found))
    rest = avatar.gaussians.select(np.arange(len(avatar.gaussians)) != row)
    changes = []
    for shot in shots:
        for camera in shot.cameras:
            before, after = (
                render_avatar(gaussians, shot.frames, camera, rasteriser=rasteriser).colour.astype(np.float64)
                for gaussians in (avatar.gaussians, rest)
            )
            changes.append(((after - before) ** 2).sum())
    assert found[row] == pytest.approx(np.mean(changes), rel=0.02)


def test_the_hidden_go_first_and_their_error_stays_below_what_was_allowed(
    avatar: Avatar, head: HeadModel, rasteriser: Rasteriser
) -> None:
    grounds, n = grounds_for(avatar, head), len(avatar.gaussians)
    coarse, fine = (
        sum(shot.cameras[0].width * shot.cameras[0].height for shot in shots) for shots in (grounds.own, grounds.fine)
    )
    assert fine == pytest.approx(FINE_PIXELS * coarse, rel=0.02)  # a camera's sides are whole pixels
    elsewhere = STOCK_SHARE * removal_errors(avatar.gaussians, grounds.stock, rasteriser)
    assert len(prune(avatar.gaussians, grounds.own, elsewhere, 0.0, rasteriser)) == n
    least = 1e-3
    rows = prune(avatar.gaussians, grounds.own, elsewhere, least, rasteriser)
    worth = removal_errors(avatar.gaussians, grounds.own + grounds.stock, rasteriser)
    gone = np.setdiff1d(np.arange(n), rows)
    assert len(gone) > n / 3  # most of what is below
    assert worth[gone].max() < np.median(worth[rows])
    assert set(np.flatnonzero(worth == 0)) <= set(gone)
    kept, error = avatar.gaussians.select(rows), []
    for shot in grounds.own:
        for camera in shot.cameras:
            before, after = (
                render_avatar(gaussians, shot.frames, camera, rasteriser=rasteriser).colour.astype(np.float64)
                for gaussians in (avatar.gaussians, kept)
            )
            error.append(((after - before) ** 2).sum())
    assert np.mean(error) < JOINTLY * least * (n - len(rows))
    assert len(prune(avatar.gaussians, grounds.own, elsewhere, 100 * least, rasteriser)) < len(rows)


def test_files_name_their_rows_and_beat_plain_ones(avatar: Avatar, head: HeadModel) -> None:
    encoder, judge = RenderingEncoder(avatar, head), Judge(avatar, head)
    found = encoder.encode(2)
    assert found.data == encode_by_rendering(avatar, 2, head=head)
    back = decode(found.data, head=head).gaussians
    np.testing.assert_array_equal(back.binding, avatar.gaussians.binding[found.rows])
    as_good = [
        inspect(plain).gaussian_bytes
        for plain in (encode(avatar, level_at(quality), head=head) for quality in np.arange(1.0, 6.0, 0.5))
        if judge.quick(decode(plain, head=head).gaussians) >= judge.quick(back)
    ]
    assert inspect(found.data).gaussian_bytes < min(as_good)


def test_psnr_is_that_of_the_protocol(avatar: Avatar, head: HeadModel, rasteriser: Rasteriser) -> None:
    """Oracle: the definition, spelled out over all views."""
    worse = replace(avatar.gaussians, sh_dc=avatar.gaussians.sh_dc + np.float32(0.05))
    values = []
    for shot in protocol_shots(avatar, head):
        assert len(shot.cameras) == 16
        for camera in shot.cameras:
            truth = render_avatar(avatar.gaussians, shot.frames, camera, rasteriser=rasteriser)
            found = render_avatar(worse, shot.frames, camera, rasteriser=rasteriser)
            own = truth.alpha > 0.01
            error = np.clip(found.colour, 0, 1)[own].astype(np.float64) - np.clip(truth.colour, 0, 1)[own]
            values.append(-10 * np.log10((error**2).mean()))
    judge = Judge(avatar, head, rasteriser)
    assert judge.full(worse) == pytest.approx(np.mean(values), abs=DB)
    assert abs(judge.quick(worse) - judge.full(worse)) < 1
    assert judge.quick(avatar.gaussians) == judge.full(avatar.gaussians) == 120
