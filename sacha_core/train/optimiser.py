"""Adam over the Gaussians and the motion of a training state."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
from jaxtyping import Float

from sacha_core.animation.posed import block_bounds
from sacha_core.parallel.kept import Kept
from sacha_core.parallel.pool import Pool
from sacha_core.train.gradients import ViewColours
from sacha_core.train.kernels.adam import harmonics_range, step_one_row, step_range
from sacha_core.train.state import Arrays, TrainState

__all__ = ["BETAS", "EPSILON", "Adam"]

BETAS = (0.9, 0.999)
EPSILON = 1e-15
ROWS = 64  # Gaussians, of which a job takes a multiple, so that each falls into the same lane whichever thread steps it


class Adam:
    """Steps the Gaussians and the motion of training states.

    Args:
        pool: shares out the work.

    Source: Kingma and Ba, Adam, 2015.
    """

    def __init__(self, pool: Pool) -> None:
        self._pool = pool
        self._looked_up: Kept[dict[str, tuple[np.ndarray, ...]]] = Kept()

    def step_gaussians(
        self,
        state: TrainState,
        gradients: Arrays,
        means: Float[np.ndarray, "n 3"],
        colours: Sequence[ViewColours],
        degree: int,
        rates: Mapping[str, float],
    ) -> None:
        """Take one step with the Gaussians.

        Args:
            state: changed.
            gradients: by name; an attribute without a gradient stays as it is.
            means: in the world, as they were seen.
            colours: of each view: the gradient by the harmonics of degree 1 and up, which then need none in `gradients`; none to leave
                them.
            degree: of the harmonics in use; the coefficients beyond have never had a gradient.
            rates: learning rates by name.
        """
        state.steps["gaussians"] += 1
        pace = Pace(state.steps["gaussians"])
        bounds = block_bounds(len(state), ROWS, self._pool.threads)
        centres, cuts = tuple(view.centre for view in colours), tuple(view.cut for view in colours)
        rest = [kind["sh_rest"] for kind in (state.values, state.first, state.second)]
        stepped = self._stepped(state, gradients, rates, pace, max(len(state), 1))

        def job(_: int, k: int) -> None:
            start, stop = bounds[k], bounds[k + 1]
            if colours and degree > 0:
                harmonics_range(
                    start, stop, degree, means, centres, cuts, *rest, pace.rate(rates["sh_rest"]), *pace.rest
                )
            if gradients:
                step_range(start, stop, *stepped, *pace.rest)

        self._pool.run(job, len(bounds) - 1)

    def step_motion(self, state: TrainState, timestep: int, gradients: Arrays, rates: Mapping[str, float]) -> None:
        """Take one step with the motion of all timesteps, of which one has gradients (rows by name)."""
        state.steps["motion"] += 1
        pace, rows = Pace(state.steps["motion"]), len(state.values[next(iter(gradients))])
        stepped = self._stepped(state, gradients, rates, pace, 1)
        step_one_row(timestep, rows, *stepped, *pace.rest, np.zeros(rows * max(stepped[0]), np.float32))

    def _stepped(
        self, state: TrainState, gradients: Arrays, rates: Mapping[str, float], pace: Pace, rows: int
    ) -> tuple[Any, ...]:
        """Give widths, values, gradients, both moments and rates, as the kernels want them; gradients have so many rows."""
        kinds = state.values, state.first, state.second
        of = self._looked_up.of(lambda: flat(*kinds), *kinds[0].values(), *kinds[1].values(), *kinds[2].values())
        slopes = tuple(slope.reshape(-1) for slope in gradients.values())
        values, first, second = zip(*(of[name] for name in gradients), strict=True) if gradients else ((), (), ())
        widths = tuple(slope.size // rows for slope in slopes)
        return widths, values, slopes, first, second, tuple(pace.rate(rates[name]) for name in gradients)


def flat(values: Arrays, first: Arrays, second: Arrays) -> dict[str, tuple[np.ndarray, ...]]:
    """Give values and moments by name, each as one row."""
    return {
        name: (value.reshape(-1), first[name].reshape(-1), second[name].reshape(-1)) for name, value in values.items()
    }


class Pace:
    """What a step's number makes of the rates: the kernels' last arguments.

    Args:
        step: counted from 1.

    Attributes:
        rest: what does not depend on the rate.
    """

    def __init__(self, step: int) -> None:
        self._correction = 1 - BETAS[0] ** step
        square = 1 / math.sqrt(1 - BETAS[1] ** step)
        self.rest = tuple(np.float32(number) for number in (*BETAS, 1 - BETAS[0], 1 - BETAS[1], EPSILON, square))

    def rate(self, rate: float) -> np.float32:
        """Give the first of them for a learning rate."""
        return np.float32(rate / self._correction)
