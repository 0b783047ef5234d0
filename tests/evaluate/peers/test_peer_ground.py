"""Domains and layout: the world is where the animation carries Gaussians, ways back are inverses, and every Gaussian has its own cell."""

from __future__ import annotations

import numpy as np
import pytest

from sacha_core.avatar.binding import to_world
from sacha_core.bench.scenes import made_avatar
from sacha_core.evaluate.peers.attributes import columns_of, dequantise, gaussians_of, quantise, range_of
from sacha_core.evaluate.peers.gpcc_points import morton, set_apart
from sacha_core.evaluate.peers.grid import from_image, grid_of, to_image
from sacha_core.evaluate.peers.peer import Ground, enlarged, visible

AVATAR, HEAD = made_avatar(700, 1, 1)
GROUND = Ground(HEAD)
FLOAT32 = 2e-5  # a few roundings of coordinates of up to some triangle units
SAME_TURN = 1e-5  # of the product of two unit quaternions that are the same rotation


@pytest.mark.parametrize("domain", ["local", "world", "mixed"])
def test_the_way_back_undoes_the_way_into_a_domain(domain) -> None:
    given = AVATAR.gaussians.select(np.argsort(GROUND.place[AVATAR.gaussians.binding], kind="stable"))
    back = GROUND.from_domain(GROUND.to_domain(AVATAR.gaussians, domain), domain)
    assert np.array_equal(back.binding, given.binding)
    np.testing.assert_allclose(back.position, given.position, atol=FLOAT32)
    np.testing.assert_allclose(back.log_scale, given.log_scale, atol=FLOAT32)
    assert np.abs(np.abs((back.quaternion * given.quaternion).sum(axis=1)) - 1).max() < SAME_TURN


def test_the_world_is_where_the_head_at_rest_carries_gaussians() -> None:
    world = GROUND.to_domain(AVATAR.gaussians, "world")
    order = np.argsort(GROUND.place[AVATAR.gaussians.binding], kind="stable")
    expected = to_world(AVATAR.gaussians.select(order), GROUND.frames)
    np.testing.assert_allclose(world.position, expected.means, atol=1e-6)
    np.testing.assert_allclose(np.exp(world.log_scale), expected.scales, rtol=1e-4)
    assert np.abs(np.abs((world.quaternion * expected.quaternions).sum(axis=1)) - 1).max() < SAME_TURN


def test_a_magnifying_glass_and_its_inverse_change_nothing() -> None:
    back = enlarged(enlarged(AVATAR.gaussians, 64.0), 1 / 64)
    assert np.array_equal(back.position, AVATAR.gaussians.position)
    np.testing.assert_allclose(back.log_scale, AVATAR.gaussians.log_scale, atol=2e-6)


def test_only_what_no_renderer_draws_is_left_out() -> None:
    alpha = 1 / (1 + np.exp(-AVATAR.gaussians.opacity_logit.astype(np.float64)))
    assert len(visible(AVATAR.gaussians)) == int((alpha >= 1 / 255).sum())


def test_columns_hold_all_that_a_gaussian_is() -> None:
    given = visible(AVATAR.gaussians)
    back = gaussians_of(columns_of(given, thinnest=50.0), given.binding)
    np.testing.assert_allclose(back.sh_dc, given.sh_dc, atol=1e-4)  # the transform's constants have four digits
    np.testing.assert_allclose(back.sh_rest, given.sh_rest, atol=1e-4)
    np.testing.assert_allclose(back.log_scale, given.log_scale, atol=1e-6)
    turns = given.quaternion / np.linalg.norm(given.quaternion, axis=1, keepdims=True)
    assert np.abs(np.abs((back.quaternion * turns).sum(axis=1)) - 1).max() < SAME_TURN


@pytest.mark.parametrize("n_bits", [1, 8, 12])
def test_quantised_columns_are_at_most_half_a_step_off(n_bits: int) -> None:
    values = np.random.default_rng(n_bits).normal(size=(500, 3))
    limits = range_of(values)
    back = dequantise(quantise(values, limits, n_bits), limits, n_bits)
    step = (limits[1] - limits[0]) / ((1 << n_bits) - 1)
    assert (np.abs(back - values) <= 0.5 * step + 1e-6).all()  # the range is rounded to float32


@pytest.mark.parametrize("n", [0, 1, 64, 65, 700])
def test_each_gaussian_has_a_cell_of_its_own_and_comes_back_from_it(n: int) -> None:
    cells, side = grid_of(AVATAR.gaussians.binding[:n], GROUND)
    assert len(np.unique(cells)) == n
    assert side % 8 == 0
    assert side**2 >= n
    values = np.random.default_rng(0).integers(0, 4096, (n, 2))
    assert np.array_equal(from_image(to_image(values, cells, side), cells), values)


def test_points_set_apart_are_distinct_and_near() -> None:
    place = np.random.default_rng(0).integers(0, 6, (150, 3))
    apart = set_apart(place)
    assert len(np.unique(apart, axis=0)) == len(place)
    assert np.abs(apart - place).max() <= 3
    distinct = np.unique(place, axis=0)
    assert np.array_equal(set_apart(distinct), distinct)


def test_morton_codes_compare_the_highest_differing_bit_first() -> None:
    """Oracle: bits interleaved as text."""
    place = np.random.default_rng(1).integers(0, 1 << 18, (100, 3))
    written = ["".join(f"{x:021b}"[b] + f"{y:021b}"[b] + f"{z:021b}"[b] for b in range(21)) for x, y, z in place]
    assert morton(place).tolist() == [int(text, 2) for text in written]
