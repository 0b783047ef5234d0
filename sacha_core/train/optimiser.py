"""Adam over the Gaussians and the motion of a training state."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence

import numpy as np
from jaxtyping import Float

from sacha_core.animation.posed import block_bounds
from sacha_core.parallel.pool import Pool
from sacha_core.train.gradients import ViewColours
from sacha_core.train.kernels.adam import harmonics_range, step_one_row, step_range
from sacha_core.train.state import Arrays, TrainState

__all__ = ["BETAS", "EPSILON", "step_gaussians", "step_motion"]

BETAS = (0.9, 0.999)
EPSILON = 1e-15
ROWS = 64  # Gaussians, of which a job takes a multiple, so that each falls into the same lane whichever thread steps it


def step_gaussians(
    state: TrainState,
    gradients: Arrays,
    means: Float[np.ndarray, "n 3"],
    colours: Sequence[ViewColours],
    degree: int,
    rates: Mapping[str, float],
    pool: Pool,
) -> None:
    """Take one step with the Gaussians.

    Args:
        state: changed.
        gradients: by name; an attribute without a gradient stays as it is.
        means: in the world, as they were seen.
        colours: of each view: the gradient by the harmonics of degree 1 and up, which then need none in `gradients`; none to leave them.
        degree: of the harmonics in use; the coefficients beyond have never had a gradient.
        rates: learning rates by name.
        pool: shares out the work.

    Source: Kingma and Ba, Adam, 2015.
    """
    state.steps["gaussians"] += 1
    pace = Pace(state.steps["gaussians"])
    bounds = block_bounds(len(state), ROWS, pool.threads)
    centres, cuts = tuple(view.centre for view in colours), tuple(view.cut for view in colours)
    rest = [kind["sh_rest"] for kind in (state.values, state.first, state.second)]
    names = tuple(gradients)
    arrays = flat(state.values, names), flat(gradients, names), flat(state.first, names), flat(state.second, names)
    widths, paces = tuple(gradients[name][:1].size for name in names), tuple(pace.rate(rates[name]) for name in names)

    def job(_: int, k: int) -> None:
        start, stop = bounds[k], bounds[k + 1]
        if colours and degree > 0:
            harmonics_range(start, stop, degree, means, centres, cuts, *rest, pace.rate(rates["sh_rest"]), *pace.rest)
        if names:
            step_range(start, stop, widths, *arrays, paces, *pace.rest)

    pool.run(job, len(bounds) - 1)


def step_motion(state: TrainState, timestep: int, gradients: Arrays, rates: Mapping[str, float]) -> None:
    """Take one step with the motion of all timesteps, of which one has gradients (rows by name)."""
    state.steps["motion"] += 1
    pace, names = Pace(state.steps["motion"]), tuple(gradients)
    widths, paces = tuple(gradients[name].size for name in names), tuple(pace.rate(rates[name]) for name in names)
    rows = len(state.values[names[0]])
    step_one_row(
        timestep, rows, widths, flat(state.values, names), flat(gradients, names), flat(state.first, names), flat(state.second, names),
        paces, *pace.rest, np.zeros(rows * max(widths), np.float32),
    )  # fmt: skip


def flat(arrays: Arrays, names: Sequence[str]) -> tuple[np.ndarray, ...]:
    """Give some arrays, each as one row."""
    return tuple(arrays[name].reshape(-1) for name in names)


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
