r"""Choosing harmonics' levels: the encoder's business.

What a Gaussian's levels are worth is judged together: the change of its pictures is a quadratic form of its components, so each level
makes up for the errors of the ones chosen before. A level is taken where it saves more of that than its bits cost.

Source: own; rate-distortion optimised quantisation, as in video encoders (Karczewicz et al., 2008), by coordinate descent.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from jaxtyping import Bool, Float, Int

from sacha_core.codec.grouping import LevelBits
from sacha_core.codec.harmonic_basis import on_axes
from sacha_core.codec.harmonic_contexts import Activity
from sacha_core.codec.harmonic_metric import Metric
from sacha_core.codec.harmonics import AXES, BASIS_ONE, UNIT, Neighbourhood, Transform
from sacha_core.codec.order import Layout
from sacha_core.codec.steps import Classes
from sacha_core.geometry.contraction import contract

__all__ = ["Problem", "cheapest", "choose", "pose"]

SWEEPS = 2
ZERO_BITS, LEVEL_BITS, OCTAVE_BITS = 0.15, 3.5, 2.0  # of levels, before their tables are known
MAX_LEVEL = 200.0
ONE_IN = 500  # Gaussians has to have a level of a component: fewer do not pay for its function, its weights and the time to decode it


@dataclass(frozen=True)
class Problem:
    """What is to be coded: the change of a Gaussian's pictures is $x^T A x - 2 h^T x$ of its components x on each axis, plus a constant.

    Args:
        transform: what components mean.
        quadratic: (n, f, f) A.
        linear: (n, f, 3) h.
        steps: (n, c) of components, in `UNIT`.
        lagrangian: squared change of the picture that a bit is worth.
    """

    transform: Transform
    quadratic: Float[np.ndarray, "n f f"]
    linear: Float[np.ndarray, "n f 3"]
    steps: Int[np.ndarray, "n c"]
    lagrangian: float

    def trimmed(self, levels: Int[np.ndarray, "n c"]) -> tuple[Problem, Bool[np.ndarray, " c"]]:
        """Leave out, axis by axis, the last functions with too few levels to be worth their bytes; tell which components stay."""
        used = np.count_nonzero(levels, axis=0) >= 1 + len(levels) // ONE_IN
        functions, axis = self.transform.functions, self.transform.axis
        counts = tuple(int((functions[(axis == a) & used] + 1).max(initial=0)) for a in range(AXES))
        most = max(counts)
        transform = replace(
            self.transform,
            counts=counts,
            basis=self.transform.basis[:most],
            exponents=self.transform.exponents[:most],
        )
        kept = functions < np.array(counts)[axis]
        quadratic, linear = self.quadratic[:, :most, :most], self.linear[:, :most]
        return Problem(transform, quadratic, linear, self.steps[:, kept], self.lagrangian), kept


def pose(
    transform: Transform, sh_rest: Float[np.ndarray, "n k 3"], metric: Metric, classes: Classes, lagrangian: float
) -> Problem:
    """State what is to be coded, in units of components."""
    n, k = len(sh_rest), transform.basis.shape[1]
    rows = np.ascontiguousarray((transform.basis / BASIS_ONE * UNIT).T.astype(np.float32))  # (k, f)
    seen = (metric.left.reshape(n * k, k) @ rows).reshape(n, k, rows.shape[1])
    turned = np.ascontiguousarray(seen.transpose(0, 2, 1))
    quadratic = (turned.reshape(n * rows.shape[1], k) @ rows).reshape(n, rows.shape[1], rows.shape[1])
    linear = turned @ on_axes(sh_rest, transform.axes).astype(np.float32)
    return Problem(transform, quadratic, linear, transform.steps(classes), lagrangian)


def choose(
    layout: Layout,
    problem: Problem,
    neighbourhood: Neighbourhood,
    tables: tuple[Activity, LevelBits] | None,
) -> tuple[Int[np.ndarray, "n c"], Int[np.ndarray, "n c"]]:
    """Choose all levels, by the bits of their tables or a guess; give them and the components as the decoder will have them."""
    levels, values = np.zeros(problem.steps.shape, np.int64), np.zeros(problem.steps.shape, np.int64)
    for step in layout.passes:
        rows, expected = step.rows, neighbourhood.predict(step, values)
        prices = (tables[1], tables[0].contexts(step)) if tables else None
        chosen = descend(problem, rows, expected, prices)
        if tables:
            tables[0].learn(step, chosen)
        levels[rows] = chosen
        values[rows] = expected + chosen * problem.steps[rows]
    return levels, values


def descend(
    problem: Problem,
    rows: Int[np.ndarray, " p"],
    expected: Int[np.ndarray, "p c"],
    prices: tuple[LevelBits, Int[np.ndarray, "p c"]] | None,
) -> Int[np.ndarray, "p c"]:
    """Choose the levels of a pass, one component after the other, and again with all others known."""
    transform = problem.transform
    quadratic, steps = problem.quadratic[rows], problem.steps[rows].astype(np.float64)
    curvature = np.maximum(np.einsum("pff->pf", quadratic), 1e-30)
    left = problem.linear[rows]  # less what the values so far explain
    for axis in range(AXES):
        mine = np.flatnonzero(transform.axis == axis)
        left[:, :, axis] -= contract("pfg,pg->pf", quadratic[:, :, transform.functions[mine]], expected[:, mine])
    levels = np.zeros(expected.shape, np.int64)
    for _ in range(SWEEPS if prices else 1):
        for component, (function, axis) in enumerate(transform.components):
            step, before = steps[:, component], levels[:, component]
            gain = curvature[:, function] * step
            exact = np.clip(left[:, function, axis] / gain + before, -MAX_LEVEL, MAX_LEVEL)
            price = (prices[0], prices[1][:, component]) if prices else None
            best = cheapest(exact, gain * step, problem.lagrangian, price)
            moved = np.flatnonzero(best - before)
            change = (best - before)[moved] * step[moved]
            left[moved, :, axis] -= quadratic[moved, :, function] * change[:, None]
            levels[:, component] = best
    return levels


def cheapest(
    exact: Float[np.ndarray, " p"],
    worth: Float[np.ndarray, " p"],
    lagrangian: float,
    prices: tuple[LevelBits, Int[np.ndarray, " p"]] | None,
) -> Int[np.ndarray, " p"]:
    """Give the level of the least worth x (exact - level)^2 + lagrangian x bits: the nearest, the one below, or zero."""
    nearest = np.rint(exact).astype(np.int64)
    below = nearest - np.sign(nearest)
    best, least = nearest, np.full(len(exact), np.inf)
    for level in (nearest, below, np.zeros_like(nearest)):
        price = prices[0].of(level, prices[1]) if prices else guessed_bits(level)
        cost = worth * np.square(exact - level) + lagrangian * price
        best, least = np.where(cost < least, level, best), np.minimum(cost, least)
    return np.asarray(best)


def guessed_bits(values: Int[np.ndarray, " m"]) -> Float[np.ndarray, " m"]:
    """Bits of levels before their tables are known: those of a typical table."""
    magnitude = np.abs(values)
    guess = LEVEL_BITS + OCTAVE_BITS * np.log2(np.maximum(magnitude, 1))
    return np.asarray(np.where(magnitude > 0, guess, ZERO_BITS))
