"""Adam over the Gaussians and the motion of a training state."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np
from jaxtyping import Float

from sacha_core.animation.posed import block_bounds
from sacha_core.parallel.kept import Kept
from sacha_core.parallel.kernels.packed import Packed
from sacha_core.parallel.kernels.turns import new_turns
from sacha_core.parallel.pool import Pool
from sacha_core.train.gradients import ViewColours
from sacha_core.train.kernels.adam import step_in_turns, step_one_row
from sacha_core.train.state import FITTED_MOTION, ROWS, Arrays, TrainState

__all__ = ["BETAS", "EPSILON", "Adam", "GaussianStep", "MotionSlopes", "Slopes"]

BETAS = (0.9, 0.999)
EPSILON = 1e-15
LANES = 64  # of whose multiples jobs are, so that each Gaussian falls into the same lane whichever thread steps it
JOBS = 16  # of threads
CONSTANTS = tuple(np.float32(number) for number in (*BETAS, 1 - BETAS[0], 1 - BETAS[1], EPSILON))
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


@dataclass(frozen=True)
class Together:
    """Arrays of several names that kernels want together.

    Args:
        names: in this order.
        arrays: tuples of one for each.
    """

    names: tuple[str, ...]
    arrays: Packed


class GaussianStep(NamedTuple):
    """A step with the Gaussians that is still to be taken: what `step_gaussians` wants after a range.

    Args:
        by_rest: whether harmonics of degree 1 and up have gradients.
        by_plain: whether any other attribute has.
        degree: of the harmonics in use.
        harmonics: what `harmonics_range` wants after that.
        plain: what `step_range` wants after the rows.
        paces: what it wants then.
    """

    by_rest: bool
    by_plain: bool
    degree: int
    harmonics: tuple[Any, ...]
    plain: np.ndarray
    paces: tuple[Any, ...]


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
        self.take(state, self.prepare(state, rates, slopes, motion))

    def take(self, state: TrainState, step: GaussianStep) -> None:
        """Take a step that was prepared for this state; no other between."""
        turns, bounds = new_turns(1), np.array(block_bounds(len(state), LANES, JOBS))
        self._pool.run(lambda _, __: step_in_turns(turns, bounds, *step), self._pool.threads)

    def prepare(
        self, state: TrainState, rates: Mapping[str, float], slopes: Slopes | None, motion: MotionSlopes | None = None
    ) -> GaussianStep:
        """Step the motion, and give what is left to do of a step: gradients and state must stay as they are until then.

        See `step` for arguments.
        """
        kinds = state.values, state.first, state.second
        of = self._looked_up.of(lambda: flat(*kinds), *kinds[0].values(), *kinds[1].values(), *kinds[2].values())
        if motion is not None:
            self._step_motion(state, of, rates, motion)
        slopes = slopes or NO_SLOPES
        by_rest, by_plain = bool(slopes.colours) and slopes.degree > 0, bool(slopes.by_name)
        state.steps["gaussians"] += by_plain or bool(slopes.colours)
        pace = Pace(state.steps["gaussians"])
        some = self._together.of(lambda: of_gaussians(of, slopes.by_name, len(state)), of, *slopes.by_name.values())
        given = tuple(rates.get(name, 0.0) for name in some.names)
        paces = (given, pace.correction, *pace.rest)
        harmonics = self._harmonics(state, rates, slopes, pace)
        return GaussianStep(by_rest, by_plain, slopes.degree, harmonics, some.arrays.table, paces)

    def _harmonics(self, state: TrainState, rates: Mapping[str, float], slopes: Slopes, pace: Pace) -> tuple[Any, ...]:
        """Give what `harmonics_range` wants after rows and degree."""
        colours = slopes.colours or (NO_COLOURS,)
        centres, cuts = tuple(view.centre for view in colours), tuple(view.cut for view in colours)
        rest = (kind["sh_rest"] for kind in (state.values, state.first, state.second))
        return (slopes.means, centres, cuts, *rest, pace.rate(rates.get("sh_rest", 0.0)), *pace.rest)

    def _step_motion(self, state: TrainState, of: Flat, rates: Mapping[str, float], motion: MotionSlopes) -> None:
        """Step all timesteps, of which one has gradients."""
        rows = len(state.values[FITTED_MOTION[0]])
        moved = self._moved.of(lambda: of_motion(of, rows), of).arrays.table
        state.steps["motion"] += 1
        pace, slopes = Pace(state.steps["motion"]), tuple(motion.by_name[name] for name in FITTED_MOTION)
        given = tuple(rates[name] for name in FITTED_MOTION)
        step_one_row(motion.timestep, rows, moved, slopes, given, pace.correction, *pace.rest)


def of_gaussians(of: Flat, by_name: Arrays, n: int) -> Together:
    """Give widths, values, gradients and both moments of what has a row a Gaussian; what has no gradient has no width here."""
    names = tuple(name for name in ROWS if name in by_name or (name in of and name != "sh_rest"))
    slopes = tuple(by_name[name].reshape(-1) if name in by_name else of[name][0] for name in names)
    widths = tuple(slope.size // max(n, 1) if name in by_name else 0 for name, slope in zip(names, slopes, strict=True))
    values, first, second = zip(*(of[name] for name in names), strict=True)
    return Together(names, Packed((widths, values, slopes, first, second)))


def of_motion(of: Flat, rows: int) -> Together:
    """Give widths, values and both moments of the motion, and space for the gradients of one parameter."""
    values, first, second = zip(*(of[name] for name in FITTED_MOTION), strict=True)
    widths = tuple(value.size // max(rows, 1) for value in values)
    return Together(FITTED_MOTION, Packed((widths, values, first, second, np.zeros(rows * max(widths), np.float32))))


def flat(values: Arrays, first: Arrays, second: Arrays) -> dict[str, tuple[np.ndarray, ...]]:
    """Give values and moments by name, each as one row."""
    return {
        name: (value.reshape(-1), first[name].reshape(-1), second[name].reshape(-1)) for name, value in values.items()
    }


class Pace:
    """What a step's number makes of the rates: the kernels' last arguments.

    Args:
        step: counted from 1; 0 where none was taken yet.

    Attributes:
        correction: of the first moment's bias, which the others' rates are divided by.
        rest: what does not depend on the rate.
    """

    def __init__(self, step: int) -> None:
        self.correction = 1 - BETAS[0] ** max(step, 1)
        self.rest = (*CONSTANTS, np.float32(1 / math.sqrt(1 - BETAS[1] ** max(step, 1))))

    def rate(self, rate: float) -> np.float32:
        """Give the first of them for a learning rate."""
        return np.float32(rate / self.correction)
