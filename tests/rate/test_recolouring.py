"""Colours that make up for what is lost, and how much of pictures each Gaussian makes up: against matrices written out by drawing."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from sacha_core.avatar.avatar import Avatar
from sacha_core.avatar.binding import initial_gaussians
from sacha_core.avatar.gaussians import Gaussians
from sacha_core.codec import decode, inspect
from sacha_core.codec.encoder import encode_traced
from sacha_core.density.scores.light_gaussian import light_gaussian_score
from sacha_core.flame.model import HeadModel
from sacha_core.raster.kernels.harmonics import BASIS
from sacha_core.raster.rasteriser import Rasteriser
from sacha_core.raster.splats import Splats
from sacha_core.rate.covering import COVER, FINE_PIXELS, Seen, cover_enough, look_at
from sacha_core.rate.curvature import draw, importance_of
from sacha_core.rate.encoding import RenderingEncoder
from sacha_core.rate.judging import Judge
from sacha_core.rate.leaving_out import JOINT_BITS, ROUNDS, Leaving
from sacha_core.rate.recolouring import RIDGE, RIDGE_RANK, STEPS, Pictures, Recolouring
from sacha_core.rate.stances import measuring_stances, stock_motion
from sacha_core.rate.views import COARSE, Shot, spread_shots
from sacha_core.rate.visibility import PRUNING_BITS, STOCK_SHARE, Grounds, prune, removal_errors
from sacha_core.rate.world import in_world

SOLVED = 2e-4  # of colours: float32 pictures, and sums of their products
SUMMED = 1e-5  # relative: float32 sums over a picture in another order
LEVEL = 1
BETTER_DB = 0.3  # at least, of what is possible here; without a fit it would be 0


@pytest.fixture(scope="module")
def avatar(head: HeadModel) -> Avatar:
    """A skin of half transparent Gaussians that overlap."""
    rng = np.random.default_rng(3)
    skin = initial_gaussians(head.n_faces, rng, 1)
    n = len(skin)
    skin = replace(
        skin,
        opacity_logit=rng.normal(0, 1, n).astype(np.float32),
        log_scale=rng.normal(-0.3, 0.3, (n, 3)).astype(np.float32),
        sh_dc=rng.uniform(-1, 1, (n, 3)).astype(np.float32),
        sh_rest=rng.normal(0, 0.05, skin.sh_rest.shape).astype(np.float32),
    )
    return Avatar(skin, head.reference, stock_motion(head).frames(slice(0, 6)))


@pytest.fixture(scope="module")
def shots(avatar: Avatar, head: HeadModel) -> tuple[Shot, ...]:
    return spread_shots(measuring_stances(avatar, head, 4), 1, COARSE)


def weights_by_drawing(gaussians: Gaussians, shots: tuple[Shot, ...], rasteriser: Rasteriser) -> np.ndarray:
    """Give (v, n, h, w) blending weights: each Gaussian white, the others and all behind black."""
    views = []
    for shot in shots:
        world = in_world(gaussians, shot.stance)
        for camera in shot.cameras:
            drawn = []
            for one in np.eye(len(gaussians), dtype=np.float32):
                splats = Splats(world.means, world.scales, world.quaternions, world.opacities, one[:, None])
                drawn.append(rasteriser.forward(splats, camera, np.zeros(1, np.float32)).image[0].copy())
            views.append(np.stack(drawn))
    return np.stack(views)


def front(avatar: Avatar, shots: tuple[Shot, ...], rasteriser: Rasteriser, n: int) -> np.ndarray:
    """Give the rows of the Gaussians that show most."""
    return np.argsort(-seen_of(avatar.gaussians, shots, rasteriser).cover)[:n]


def seen_of(
    gaussians: Gaussians, shots: tuple[Shot, ...], rasteriser: Rasteriser, stock: tuple[Shot, ...] = ()
) -> Seen:
    """Look at Gaussians in their own views."""
    return look_at(gaussians, Grounds(shots, stock, shots), rasteriser)


def test_colours_solve_the_least_squares_problem(avatar, shots, rasteriser):
    """Oracle: as many unknowns a channel as steps, for which conjugate gradients are exact, by normal equations written out."""
    rows = front(avatar, shots, rasteriser, STEPS)
    truth = avatar.gaussians.select(rows)
    moved = replace(
        truth,
        position=truth.position + np.float32(0.3),
        opacity_logit=truth.opacity_logit - np.float32(0.5),
        sh_dc=truth.sh_dc + np.float32(0.1),
    )
    worth = 100.0 * np.arange(1, STEPS + 1)
    found = Recolouring(Pictures(truth, shots), rasteriser)(moved, worth)

    weights = weights_by_drawing(moved, shots, rasteriser).astype(np.float64) * BASIS[0]
    matrix = weights.transpose(1, 0, 2, 3).reshape(STEPS, -1)
    off = []
    for shot in shots:
        for camera in shot.cameras:
            pictures = [
                draw(g, in_world(g, shot.stance), camera, rasteriser).image.astype(np.float64) for g in (truth, moved)
            ]
            off.append(pictures[0] - pictures[1])
    wanted = np.stack(off, axis=1).reshape(3, -1)
    views = len(off)
    ridge = RIDGE * np.quantile(worth, RIDGE_RANK)
    normal = matrix @ matrix.T / views + ridge * np.eye(STEPS)
    expected = moved.sh_dc + np.linalg.solve(normal, matrix @ wanted.T / views)
    assert np.abs(expected - moved.sh_dc).max() > 100 * SOLVED
    np.testing.assert_allclose(found, expected, atol=SOLVED)


def test_what_no_view_shows_keeps_its_colour(avatar, shots, rasteriser):
    """Oracle: its own colour."""
    gaussians = avatar.gaussians
    opacity = gaussians.opacity_logit.copy()
    opacity[::3] = -20
    hidden = replace(gaussians, opacity_logit=opacity)
    found = Recolouring(Pictures(gaussians, shots), rasteriser)(hidden, np.ones(len(gaussians)))
    assert np.array_equal(found[::3], gaussians.sh_dc[::3])
    assert not np.array_equal(found[1::3], gaussians.sh_dc[1::3])


@pytest.mark.parametrize("n", [0, 4])
def test_nothing_worth_anything_stays_as_it_is(avatar, shots, rasteriser, n):
    """Oracle: what was given."""
    few = avatar.gaussians.select(np.arange(n))
    assert np.array_equal(Recolouring(Pictures(avatar.gaussians, shots), rasteriser)(few, np.zeros(n)), few.sh_dc)


def test_colours_are_chosen_for_what_the_decoder_has_and_change_nothing_else(avatar, head):
    """Oracle: the decoder, and the other sections of the file."""
    still = replace(avatar, motion=None)
    importance = importance_of(avatar, head)
    seen: list[tuple[Gaussians, np.ndarray]] = []

    def darker(decoded: Gaussians, rows: np.ndarray) -> np.ndarray:
        seen.append((decoded, rows))
        return decoded.sh_dc - np.float32(0.5)

    plain, _ = encode_traced(still, LEVEL, head=head, importance=importance)
    data, order = encode_traced(still, LEVEL, head=head, importance=importance, recolour=darker)
    back, ((decoded, rows),) = decode(data, head=head).gaussians, seen
    assert np.array_equal(rows, order)
    for name in ("position", "log_scale", "quaternion", "opacity_logit", "sh_rest", "binding"):
        assert np.array_equal(getattr(back, name), getattr(decoded, name)), name
    sizes = [{part.name: part.n_bytes for part in inspect(d).sections if part.name != "Colour"} for d in (plain, data)]
    assert sizes[0] == sizes[1]
    assert np.median(back.sh_dc - decode(plain, head=head).gaussians.sh_dc) == pytest.approx(-0.5, abs=0.05)


def test_files_look_better_with_colours_that_make_up_for_losses(avatar, head, rasteriser):
    """Oracle: the protocol's judge, by cameras that colours were not fitted to; the same Gaussians at the same level."""
    encoder, judge = RenderingEncoder(avatar, head), Judge(avatar, head, rasteriser)
    left = encoder.prepare(LEVEL)
    fitted = encoder.encode_prepared(left)
    plain, _ = encode_traced(left.avatar, left.level, head=head, importance=left.importance)
    found = [judge.quick(decode(data, head=head).gaussians) for data in (plain, fitted.data)]
    assert found[1] > found[0] + BETTER_DB
    assert len(fitted.data) < len(plain) * 1.02


def test_what_is_seen_of_each_is_its_weight_in_the_pictures(avatar, shots, rasteriser):
    """Oracle: each Gaussian drawn white among black ones, by its definition less for small ones; removal errors of stock views."""
    few = avatar.gaussians.select(front(avatar, shots, rasteriser, 8))
    own, stock = shots[:2], shots[2:]
    seen = seen_of(few, own, rasteriser, stock)
    sums = weights_by_drawing(few, shots, rasteriser).sum(axis=(2, 3))
    weight = np.maximum(sums[:2].mean(axis=0), FINE_PIXELS * STOCK_SHARE * sums[2:].mean(axis=0))
    expected = light_gaussian_score(weight, np.exp(few.log_scale.astype(np.float64)))
    np.testing.assert_allclose(seen.cover, expected, rtol=SUMMED)
    np.testing.assert_allclose(seen.missed, STOCK_SHARE * removal_errors(few, stock, rasteriser), rtol=SUMMED)


def test_who_covers_too_little_goes_and_more_where_bits_are_dear(avatar, shots, rasteriser):
    """Oracle: the definition; factors count a squared change, covers one that is not squared."""
    cover = seen_of(avatar.gaussians, shots, rasteriser).cover
    price = float(np.median(cover) / COVER) ** 2
    kept = cover_enough(cover, price)
    assert np.array_equal(kept, np.flatnonzero(cover >= np.median(cover)))
    assert np.array_equal(cover_enough(cover, 4 * price, np.full(len(cover), 4.0)), kept)
    assert len(cover_enough(cover, 4 * price)) < len(kept)


@pytest.mark.parametrize(("layers", "stays"), [(1, False), (40, True)])
def test_faint_layers_stay_that_are_missed_together(avatar, head, shots, rasteriser, layers, stays):
    """Oracle: one layer that changes pictures by less than its bits are worth goes; of many, worth far more together, none does."""
    gaussians = avatar.gaussians
    n = len(gaussians)
    faint = replace(gaussians, opacity_logit=np.full(n, -4.0, np.float32), log_scale=np.full((n, 3), -1.5, np.float32))
    rows = np.tile(np.arange(len(faint)), layers)
    many = faint.select(rows)
    grounds, pictures = Grounds(shots, (), shots), Pictures(many, shots)
    leaving = Leaving.of(many, grounds, pictures, rasteriser)
    alone = removal_errors(many, shots, rasteriser)
    price = float(np.quantile(alone[alone > 0], 0.9)) / PRUNING_BITS
    kept = cover_enough(leaving.seen.cover, price)
    few = many.select(kept)
    fewer = kept[prune(few, shots, np.zeros(len(kept)), PRUNING_BITS * price, rasteriser, None, ROUNDS)]
    assert len(fewer) < len(kept)
    lost = leaving.joint_error(fewer, rasteriser) - leaving.joint_error(kept, rasteriser)
    assert (lost > JOINT_BITS * price * (len(kept) - len(fewer))) == stays
    assert np.array_equal(leaving.rows(price, PRUNING_BITS, rasteriser), kept if stays else fewer)
    assert len(leaving.rows(price, 0, rasteriser)) == len(many)
