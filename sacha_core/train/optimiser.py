"""Adam over the groups of a training state."""

from __future__ import annotations

import math
from collections.abc import Mapping

import numpy as np
from jaxtyping import Float

from sacha_core.raster.pool import Pool
from sacha_core.train.kernels.adam import adam_range
from sacha_core.train.state import TrainState

__all__ = ["BETAS", "EPSILON", "adam", "position_rate"]

BETAS = (0.9, 0.999)
EPSILON = 1e-15
RANGE = 1 << 16  # values that one task steps


def adam(
    state: TrainState,
    group: str,
    gradients: Mapping[str, Float[np.ndarray, "..."]],
    rates: Mapping[str, float],
    pool: Pool,
) -> None:
    """Take one step with the arrays of a group.

    Args:
        state: changed.
        group: whose step count to use: `gaussians` or `motion`.
        gradients: by name; an array without a gradient stays as it is.
        rates: learning rates by name.
        pool: shares out ranges.

    Source: Kingma and Ba, Adam, 2015.
    """
    state.steps[group] += 1
    step = state.steps[group]
    correction = 1 - BETAS[0] ** step
    square = np.float32(1 / math.sqrt(1 - BETAS[1] ** step))
    decay = tuple(np.float32(number) for number in (*BETAS, 1 - BETAS[0], 1 - BETAS[1]))
    tasks = [
        (name, first, min(first + RANGE, gradient.size))
        for name, gradient in gradients.items()
        for first in range(0, gradient.size, RANGE)
    ]

    def run(_: int, job: int) -> None:
        name, first, last = tasks[job]
        arrays = (state.values[name], gradients[name], state.first[name], state.second[name])
        part = [array.reshape(-1)[first:last] for array in arrays]
        rate = np.float32(rates[name] / correction)
        adam_range(*part, rate, *decay, np.float32(EPSILON), square)

    pool.run(run, len(tasks))


def position_rate(first: float, last: float, iteration: int, over: int) -> float:
    """Give the learning rate that falls log-linearly from `first` to `last` over so many iterations."""
    done = min(iteration / over, 1.0)
    return math.exp(math.log(first) * (1 - done) + math.log(last) * done)
