r"""Fine-tuning through the quantiser: fitting an avatar to pictures as it will look when it is decoded.

Pictures are drawn with what a decoder would have, and the gradients move the numbers that will be encoded, as if decoding changed nothing
(straight through). So what one number loses to its step the others make up for. To that comes what bits cost (`codec.bit_gradient`):
numbers that say little move to where they are expected. The file is made anew every few iterations by the encoder itself, with all its
predictions and decisions, and rates fall to nothing, so that in the end hardly any symbol changes.

Source: Bengio, Leonard and Courville, 2013 (straight-through estimator); here with the whole codec in the loop.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field, replace
from typing import Literal

import numpy as np
from jaxtyping import Int

from sacha_core.avatar.avatar import Avatar
from sacha_core.avatar.gaussians import Gaussians
from sacha_core.codec.bit_gradient import bit_gradient
from sacha_core.codec.importance import GaussianImportance
from sacha_core.codec.levels import Level
from sacha_core.errors import OptionError
from sacha_core.flame.model import HeadModel
from sacha_core.progress import Progress, Report, silent
from sacha_core.rate.quantised import CODED, quantised
from sacha_core.rate.squared_loss import squared_loss
from sacha_core.rate.views import MEASURED_PIXELS
from sacha_core.train.cpu_engine import CpuEngine
from sacha_core.train.options import LearningRates, LossOptions, TrainOptions
from sacha_core.train.state import Arrays, TrainState, initial_state
from sacha_core.train.views import Target

__all__ = ["TuningOptions", "finetune"]

REPORT_EVERY = 10
COLOURS = 3
RATE = 2.0  # measured: takes 1 to 2 % of the bytes at equal PSNR; 6 little more; 40 costs more than it takes
ALIKE = LossOptions(sensitivity=0.0, position=0.0, scale=0.0)  # to look like the pictures, and nothing else


def starting_rates() -> LearningRates:
    """Give the learning rates at the start; positions in triangle units."""
    return LearningRates(
        position=0.001, log_scale=0.0025, quaternion=0.0005, opacity_logit=0.01, sh_dc=0.00125, sh_rest=0.00006
    )


@dataclass(frozen=True)
class TuningOptions:
    """How long, how fast and towards what.

    Args:
        iterations: steps.
        refresh: steps after which the file is made anew.
        rates: learning rates at the start, of which those of motion and masks are not used; they fall to nothing as half a cosine.
        loss: the squared difference of pictures, which is what PSNR sees, or training's own.
        threads: how many; one for each processor by default.
        seed: of the order of pictures.
        rate: how much the bits of the file count beside the squared difference: 1 as much as the level trades for an error, 0 not at all.
            They only count with that loss, and where an importance tells the price.

    Raises:
        OptionError: an option is out of range.
    """

    iterations: int = 300
    refresh: int = 10
    rates: LearningRates = field(default_factory=starting_rates)
    loss: Literal["squared", "training"] = "squared"
    threads: int | None = None
    seed: int = 0
    rate: float = RATE

    def __post_init__(self) -> None:
        if self.iterations < 1 or self.refresh < 1:
            raise OptionError(f"{self.iterations} steps with a file every {self.refresh}, expected at least 1 of each")
        if not 0 <= self.rate < math.inf:
            raise OptionError(f"the rate counts {self.rate:g} times, expected 0 or more")


def finetune(
    avatar: Avatar,
    head: HeadModel,
    level: int | Level,
    targets: Sequence[Sequence[Target]],
    importance: GaussianImportance | None = None,
    options: TuningOptions | None = None,
    report: Report = silent,
) -> Gaussians:
    """Fit an avatar to pictures through the quantiser of a level.

    Args:
        avatar: with the motion that the targets' timesteps are of, which stays as it is.
        head: that it is bound to.
        level: that it will be encoded at.
        targets: pictures to look like; those of one step share a timestep.
        importance: that it will be encoded with.
        options: how long, how fast and towards what.
        report: told about progress.

    Returns:
        The Gaussians to encode at that level, in the order given.

    Raises:
        OptionError: there is no motion, or no picture.
        FormatError: a value left what the format holds.
    """
    options = options or TuningOptions()
    if avatar.motion is None or not targets:
        raise OptionError("fine-tuning needs a motion and pictures of it")
    order = np.argsort(avatar.gaussians.binding, kind="stable")  # training wants them by triangle
    back = np.argsort(order)  # the encoder looks at the order in which they were given
    state = initial_state(avatar.gaussians.select(order), avatar.motion, 1, 1.0, 0.0)
    engine = engine_for(avatar, head, options)
    engine.put(state)
    decoded: Arrays = {}
    costs: Arrays = {}
    for done, step in enumerate(shuffled(targets, options)):
        if done % options.refresh == 0:
            current = replace(avatar, gaussians=state.gaussians().select(back))
            seen = quantised(current, head, level, importance).gaussians.select(order)
            decoded = {name: np.ascontiguousarray(getattr(seen, name), np.float32) for name in CODED}
            if options.rate > 0 and options.loss == "squared" and importance is not None:
                costs = rate_slopes(current.gaussians, head, level, importance, options.rate, order)
        learn(engine, state, decoded, costs, done, step, options)
        if done % REPORT_EVERY == 0:
            report(Progress("fine-tune", done, options.iterations))
    report(Progress("fine-tune", options.iterations, options.iterations))
    return state.gaussians().select(back)


def engine_for(avatar: Avatar, head: HeadModel, options: TuningOptions) -> CpuEngine:
    """Give what differentiates pictures."""
    assert avatar.motion is not None
    train = TrainOptions(losses=ALIKE, fine_tune=False, threads=options.threads, device="cpu")
    return CpuEngine(head, avatar.motion, train, squared_loss if options.loss == "squared" else None)


def shuffled(targets: Sequence[Sequence[Target]], options: TuningOptions) -> Iterator[Sequence[Target]]:
    """Give as many steps as there shall be, each round in an order of its own."""
    rng = np.random.default_rng([options.seed, 3])
    order: list[int] = []
    for _ in range(options.iterations):
        order = order or rng.permutation(len(targets)).tolist()
        yield targets[order.pop()]


def rate_slopes(
    gaussians: Gaussians,
    head: HeadModel,
    level: int | Level,
    importance: GaussianImportance,
    rate: float,
    order: Int[np.ndarray, " n"],
) -> Arrays:
    """Give the gradient of what bits cost, in mean squared error, in the order of training."""
    found = bit_gradient(gaussians, head, level, importance)
    price = rate * found.price / (COLOURS * MEASURED_PIXELS)  # whatever the resolution of the pictures learnt from
    return {
        name: (price * getattr(found, name)[order]).astype(np.float32) for name in ("position", "log_scale", "sh_dc")
    }


def learn(
    engine: CpuEngine,
    state: TrainState,
    decoded: Arrays,
    costs: Arrays,
    done: int,
    step: Sequence[Target],
    options: TuningOptions,
) -> None:
    """Differentiate what a decoder has, add what bits cost, and let that move what will be encoded."""
    given = {name: state.values[name] for name in CODED}
    degree = math.isqrt(1 + state.values["sh_rest"].shape[1]) - 1
    state.values |= decoded
    try:
        engine.differentiate(done + 1, step, degree)
    finally:
        state.values |= given
    engine.add(costs)
    pace = 0.5 * (1 + math.cos(math.pi * done / options.iterations))
    rates = {name: getattr(options.rates, name) * pace for name in CODED}
    engine.advance(rates | {"sensitivity_logit": 0.0}, frozenset())
