r"""Fine-tuning through the quantiser: fitting an avatar to pictures as it will look when it is decoded.

Pictures are drawn with what a decoder would have, and the gradients move the numbers that will be encoded, as if decoding changed nothing
(straight through). So what one number loses to its step the others make up for. To that comes what bits cost (`codec.bit_gradient`):
numbers that say little move to where they are expected. The file is made anew every few iterations by the encoder itself, with all its
predictions and decisions, and rates fall to nothing, so that in the end hardly any symbol changes.

Source: Bengio, Leonard and Courville, 2013 (straight-through estimator); here with the whole codec in the loop.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from typing import Literal

import numpy as np

from sacha_core.avatar.avatar import Avatar
from sacha_core.avatar.gaussians import Gaussians
from sacha_core.codec.bit_gradient import bit_gradient
from sacha_core.codec.importance import GaussianImportance
from sacha_core.codec.levels import Level
from sacha_core.errors import OptionError
from sacha_core.flame.model import HeadModel
from sacha_core.progress import Progress, Report, silent
from sacha_core.rate.fitting import Fitting, falling, starting_rates
from sacha_core.rate.quantised import CODED, quantised
from sacha_core.rate.views import MEASURED_PIXELS
from sacha_core.train.options import LearningRates
from sacha_core.train.state import Arrays
from sacha_core.train.views import Target

__all__ = ["TuningOptions", "finetune"]

REPORT_EVERY = 10
COLOURS = 3
RATE = 2.0  # measured: takes 1 to 2 % of the bytes at equal PSNR; 6 little more; 40 costs more than it takes


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
    fitting = Fitting(avatar, head, targets, options.loss, options.threads, options.seed)
    decoded: Arrays = {}
    costs: Arrays = {}
    for done in range(options.iterations if len(avatar.gaussians) else 0):
        if done % options.refresh == 0:
            current = replace(avatar, gaussians=fitting.gaussians())
            seen = quantised(current, head, level, importance).gaussians
            decoded = {name: getattr(seen, name) for name in CODED}
            if options.rate > 0 and options.loss == "squared" and importance is not None:
                costs = rate_slopes(current.gaussians, head, level, importance, options.rate)
        fitting.step(options.rates, falling(done, options.iterations), decoded, costs)
        if done % REPORT_EVERY == 0:
            report(Progress("fine-tune", done, options.iterations))
    report(Progress("fine-tune", options.iterations, options.iterations))
    return fitting.gaussians()


def rate_slopes(
    gaussians: Gaussians, head: HeadModel, level: int | Level, importance: GaussianImportance, rate: float
) -> Arrays:
    """Give the gradient of what bits cost, in mean squared error."""
    found = bit_gradient(gaussians, head, level, importance)
    price = rate * found.price / (COLOURS * MEASURED_PIXELS)  # whatever the resolution of the pictures learnt from
    return {name: (price * getattr(found, name)).astype(np.float32) for name in ("position", "log_scale", "sh_dc")}
