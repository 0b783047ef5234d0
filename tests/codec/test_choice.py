"""Choice of levels: the least cost of all levels, by trying them."""

from __future__ import annotations

import numpy as np
import pytest

from sacha_core.codec.choice import Chooser, Worth
from sacha_core.codec.grouping import LevelBits
from sacha_core.codec.tokens import MAX_TOKEN

N = 400


def geometric_bits() -> LevelBits:
    """Bits of integers that fall off geometrically, in two contexts."""
    magnitude = np.abs(np.arange(-MAX_TOKEN, MAX_TOKEN + 1))
    return LevelBits(np.stack([0.3 + 2.0 * magnitude, 2.0 + 0.4 * magnitude]))


@pytest.mark.parametrize("lagrangian", [0.0, 0.05, 0.2, 1.0])
@pytest.mark.parametrize("weighted", [False, True])
def test_cost_is_the_least(lagrangian, weighted):
    """Oracle: all levels tried one by one. Bits grow with the magnitude, so that none beyond the nearest can be best."""
    rng = np.random.default_rng(3)
    residual, steps = rng.integers(-300, 301, N), rng.integers(20, 60, N)
    contexts, rows = rng.integers(0, 2, N), rng.permutation(N)
    weights = rng.exponential(1.0, (N, 2)) if weighted else None
    bits = geometric_bits()
    found = Chooser(Worth(lagrangian, weights), bits).choose(rows, 1, residual, steps, contexts)
    tried = np.arange(-16, 17)
    weight = weights[rows, 1] if weights is not None else np.ones(N)
    cost = weight[:, None] * np.square(residual[:, None] / steps[:, None] - tried)
    cost += lagrangian * bits.table[contexts][:, tried + MAX_TOKEN]
    chosen = np.take_along_axis(cost, found[:, None] + 16, axis=1)[:, 0]
    inner = weight / np.maximum(lagrangian, 1e-9) > 1.5  # two levels down is never best where an error weighs enough
    assert np.allclose(chosen[inner], cost.min(axis=1)[inner])
    plain = np.take_along_axis(cost, np.rint(residual / steps).astype(np.int64)[:, None] + 16, axis=1)[:, 0]
    assert (chosen <= plain).all()


def test_nothing_to_trade_takes_the_nearest():
    residual, steps = np.array([-31, -10, 0, 9, 11, 29]), np.full(6, 20)
    rows = np.arange(6)
    for chooser in (Chooser(), Chooser(Worth(0.0), geometric_bits())):
        assert chooser.choose(rows, 0, residual, steps, rows * 0).tolist() == [-2, 0, 0, 0, 1, 1]
