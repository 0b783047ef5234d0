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
CONSTANTS = tuple(np.float32(number) for number in (*BETAS, 1 - BETAS[0], 1 - BETAS[1], EPSILON))
NO_COLOURS = ViewColours(np.zeros(3, np.float32), np.zeros((0, 3), np.float32))
Flat = Mapping[str, tuple[np.ndarray, ...]]  # values and moments by name
Bounds = Int[np.ndarray, " b"]


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

    @property
    def in_order(self) -> tuple[np.ndarray, ...]:
        """The rows, in the order of `FITTED_MOTION`."""
        return tuple(self.by_name[name] for name in FITTED_MOTION)


@dataclass(frozen=True)
class Together:
    """Arrays of several names that kernels want together.

    Args:
        names: in this order.
        arrays: tuples of one for each.
    """

    names: tuple[str, ...]
    arrays: tuple[Any, ...]


NO_SLOPES = Slopes({}, np.zeros((0, 3), np.float32))


class Adam:
    """Steps the Gaussians and the motion of training states.

    Args:
        pool: shares out the work.

    Source: Kingma and Ba, Adam, 2015.
    """

    def __init__(self, pool: Pool) -> None:
        self._pool = pool
        self._looked_up: Kept[Flat] = Kept()
        self._together: Kept[Together] = Kept()
        self._moved: Kept[Together] = Kept()
        self._jobs: Kept[tuple[Bounds, Bounds]] = Kept()

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
        rest_bounds, plain_bounds = self._jobs.of(lambda: jobs(len(state)), of)
        rest_bounds = rest_bounds if slopes.colours and slopes.degree > 0 else NO_JOBS
        plain_bounds = plain_bounds if slopes.by_name else NO_JOBS
        harmonics = self._harmonics(state, rates, slopes, pace)
        some = self._together.of(lambda: of_gaussians(of, slopes.by_name, len(state)), of, *slopes.by_name.values())
        plain = (*some.arrays, pace.rates(rates, some.names), *pace.rest)

        def work(_: int, __: int) -> None:
            step_in_turns(turns, motion is not None, moving, rest_bounds, slopes.degree, harmonics, plain_bounds, plain)

        self._pool.run(work, self._pool.threads)

    def _harmonics(self, state: TrainState, rates: Mapping[str, float], slopes: Slopes, pace: Pace) -> tuple[Any, ...]:
        """Give what `harmonics_range` wants after rows and degree."""
        colours = slopes.colours or (NO_COLOURS,)
        centres, cuts = tuple(view.centre for view in colours), tuple(view.cut for view in colours)
        rest = (kind["sh_rest"] for kind in (state.values, state.first, state.second))
        return (slopes.means, centres, cuts, *rest, pace.rate(rates.get("sh_rest", 0.0)), *pace.rest)

    def _moving(
        self, state: TrainState, of: Flat, rates: Mapping[str, float], motion: MotionSlopes | None
    ) -> tuple[Any, ...]:
        """Give what `step_one_row` wants; it is not called where nothing moves."""
        rows = len(state.values[FITTED_MOTION[0]])
        all_of_it = self._moved.of(lambda: of_motion(of, rows), of)
        timestep, slopes = (0, all_of_it.arrays[1]) if motion is None else (motion.timestep, motion.in_order)
        state.steps["motion"] += motion is not None
        pace, (widths, values, first, second, space) = Pace(state.steps["motion"]), all_of_it.arrays
        given = rates if motion is not None else dict.fromkeys(FITTED_MOTION, 0.0)
        return (
            timestep, rows, widths, values, slopes, first, second, pace.rates(given, FITTED_MOTION), *pace.rest, space
        )  # fmt: skip


def jobs(n: int) -> tuple[Bounds, Bounds]:
    """Give bounds of ranges of Gaussians: of harmonics, and of everything else."""
    return np.array(block_bounds(n, LANES, REST_JOBS)), np.array(block_bounds(n, LANES, PLAIN_JOBS))


def of_gaussians(of: Flat, by_name: Arrays, n: int) -> Together:
    """Give widths, values, gradients and both moments of what has a row a Gaussian; what has no gradient has no width here."""
    names = tuple(name for name in ROWS if name in by_name or (name in of and name != "sh_rest"))
    slopes = tuple(by_name[name].reshape(-1) if name in by_name else of[name][0] for name in names)
    widths = tuple(slope.size // max(n, 1) if name in by_name else 0 for name, slope in zip(names, slopes, strict=True))
    values, first, second = zip(*(of[name] for name in names), strict=True)
    return Together(names, (widths, values, slopes, first, second))


def of_motion(of: Flat, rows: int) -> Together:
    """Give widths, values and both moments of the motion, and space for the gradients of one parameter."""
    values, first, second = zip(*(of[name] for name in FITTED_MOTION), strict=True)
    widths = tuple(value.size // max(rows, 1) for value in values)
    return Together(FITTED_MOTION, (widths, values, first, second, np.zeros(rows * max(widths), np.float32)))


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
        self.rest = (*CONSTANTS, np.float32(1 / math.sqrt(1 - BETAS[1] ** max(step, 1))))

    def rate(self, rate: float) -> np.float32:
        """Give the first of them for a learning rate."""
        return np.float32(rate / self._correction)

    def rates(self, rates: Mapping[str, float], names: Sequence[str]) -> Float[np.ndarray, " k"]:
        """Give it for the rates of these names; any number where there is none."""
        return (np.array([rates.get(name, 0.0) for name in names]) / self._correction).astype(np.float32)
