"""Adam over the Gaussians and the motion of a training state."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from jaxtyping import Float, Int

from sacha_core.animation.posed import block_bounds
from sacha_core.parallel.kept import Kept
from sacha_core.parallel.kernels.turns import new_turns
from sacha_core.parallel.pool import Pool
from sacha_core.train.gradients import ViewColours
from sacha_core.train.kernels.adam import step_in_turns
from sacha_core.train.state import FITTED_MOTION, ROWS, Arrays, TrainState

__all__ = ["BETAS", "EPSILON", "Adam", "MotionSlopes", "Slopes"]

BETAS = (0.9, 0.999)
EPSILON = 1e-15
LANES = (
    64  # Gaussians, of which a job takes a multiple, so that each falls into the same lane whichever thread steps it
)
REST_JOBS, PLAIN_JOBS = (
    12,
    4,
)  # of about equal length: short ones begin too often with numbers that nobody has asked for yet
NO_JOBS = np.zeros(1, np.int64)  # bounds of no range
NO_ROW = np.zeros(0, np.float32)
NO_COLOURS = ViewColours(np.zeros(3, np.float32), np.zeros((0, 3), np.float32))
Flat = Mapping[str, tuple[np.ndarray, ...]]  # values and moments by name


@dataclass(frozen=True)
class Slopes:
    """The gradients of a step with the Gaussians.

    Args:
        by_name: an attribute without a gradient stays as it is.
        means: (n, 3) in the world, as they were seen.
        colours: of each view: the gradient by the harmonics of degree 1 and up, which then need none in `by_name`; none to leave them.
        degree: of the harmonics in use; the coefficients beyond have never had a gradient.
    """

    by_name: Arrays
    means: Float[np.ndarray, "n 3"]
    colours: Sequence[ViewColours] = ()
    degree: int = 0


@dataclass(frozen=True)
class MotionSlopes:
    """The gradients of a step with the motion.

    Args:
        timestep: the only one that has any.
        by_name: its rows, of all parameters.
    """

    timestep: int
    by_name: Arrays


NO_SLOPES = Slopes({}, np.zeros((0, 3), np.float32))


class Adam:
    """Steps the Gaussians and the motion of training states.

    Args:
        pool: shares out the work.

    Source: Kingma and Ba, Adam, 2015.
    """

    def __init__(self, pool: Pool) -> None:
        self._pool = pool
        self._looked_up: Kept[dict[str, tuple[np.ndarray, ...]]] = Kept()

    def step(
        self, state: TrainState, rates: Mapping[str, float], slopes: Slopes | None, motion: MotionSlopes | None = None
    ) -> None:
        """Take one step.

        Args:
            state: changed.
            rates: learning rates by name.
            slopes: of the Gaussians; None if they stay.
            motion: of the motion, of which all timesteps step; None if it stays.
        """
        kinds = state.values, state.first, state.second
        of = self._looked_up.of(lambda: flat(*kinds), *kinds[0].values(), *kinds[1].values(), *kinds[2].values())
        moving = self._moving(state, of, rates, motion)
        slopes = slopes or NO_SLOPES
        state.steps["gaussians"] += bool(slopes.by_name or slopes.colours)
        pace, turns = Pace(state.steps["gaussians"]), new_turns(1)
        rest_bounds, harmonics = self._harmonics(state, rates, slopes, pace)
        plain_bounds, plain = self._plain(state, of, rates, slopes.by_name, pace)

        def work(_: int, __: int) -> None:
            step_in_turns(turns, motion is not None, moving, rest_bounds, slopes.degree, harmonics, plain_bounds, plain)

        self._pool.run(work, self._pool.threads)

    def _harmonics(
        self, state: TrainState, rates: Mapping[str, float], slopes: Slopes, pace: Pace
    ) -> tuple[Int[np.ndarray, " a"], tuple[Any, ...]]:
        """Give the bounds of jobs, and what `harmonics_range` wants after rows and degree."""
        colours = slopes.colours or (NO_COLOURS,)
        centres, cuts = tuple(view.centre for view in colours), tuple(view.cut for view in colours)
        rest = [kind["sh_rest"] for kind in (state.values, state.first, state.second)]
        steps = bool(slopes.colours) and slopes.degree > 0
        arguments = (slopes.means, centres, cuts, *rest, pace.rate(rates["sh_rest"] if steps else 0.0), *pace.rest)
        return np.array(block_bounds(len(state), LANES, REST_JOBS)) if steps else NO_JOBS, arguments

    def _plain(
        self, state: TrainState, of: Flat, rates: Mapping[str, float], by_name: Arrays, pace: Pace
    ) -> tuple[Int[np.ndarray, " b"], tuple[Any, ...]]:
        """Give the bounds of jobs, and what `step_range` wants after the rows; what has no gradient has no width there."""
        n, names = max(len(state), 1), [name for name in ROWS if name in by_name or (name in of and name != "sh_rest")]
        slopes = tuple(by_name[name].reshape(-1) if name in by_name else of[name][0] for name in names)
        widths = tuple(slope.size // n if name in by_name else 0 for name, slope in zip(names, slopes, strict=True))
        rated = tuple(pace.rate(rates[name] if name in by_name else 0.0) for name in names)
        values, first, second = zip(*(of[name] for name in names), strict=True)
        bounds = np.array(block_bounds(len(state), LANES, PLAIN_JOBS)) if by_name else NO_JOBS
        return bounds, (widths, values, slopes, first, second, rated, *pace.rest)

    def _moving(
        self, state: TrainState, of: Flat, rates: Mapping[str, float], motion: MotionSlopes | None
    ) -> tuple[Any, ...]:
        """Give what `step_one_row` wants; nothing is stepped where nothing moves."""
        timestep, by_name = (0, {}) if motion is None else (motion.timestep, motion.by_name)
        state.steps["motion"] += motion is not None
        pace, rows = Pace(state.steps["motion"]), len(state.values[FITTED_MOTION[0]])
        values, first, second = zip(*(of[name] for name in FITTED_MOTION), strict=True)
        widths = tuple(value.size // max(rows, 1) for value in values)
        slopes = tuple(by_name.get(name, NO_ROW) for name in FITTED_MOTION)
        rated = tuple(pace.rate(rates[name] if name in by_name else 0.0) for name in FITTED_MOTION)
        space = np.zeros(rows * max(widths), np.float32)
        return (timestep, rows, widths, values, slopes, first, second, rated, *pace.rest, space)


def flat(values: Arrays, first: Arrays, second: Arrays) -> dict[str, tuple[np.ndarray, ...]]:
    """Give values and moments by name, each as one row."""
    return {
        name: (value.reshape(-1), first[name].reshape(-1), second[name].reshape(-1)) for name, value in values.items()
    }


class Pace:
    """What a step's number makes of the rates: the kernels' last arguments.

    Args:
        step: counted from 1; 0 where none is taken.

    Attributes:
        rest: what does not depend on the rate.
    """

    def __init__(self, step: int) -> None:
        self._correction = 1 - BETAS[0] ** max(step, 1)
        square = 1 / math.sqrt(1 - BETAS[1] ** max(step, 1))
        self.rest = tuple(np.float32(number) for number in (*BETAS, 1 - BETAS[0], 1 - BETAS[1], EPSILON, square))

    def rate(self, rate: float) -> np.float32:
        """Give the first of them for a learning rate."""
        return np.float32(rate / self._correction)
