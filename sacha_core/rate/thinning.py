"""Fewer Gaussians that look like all of them did: the least needed go, the others are fitted to the pictures, and so on.

Left out alone, hardly a Gaussian is worth less than its bits. Where those left may make up for it, half of them and more are. How many
go is found by looking: after each round what is left is encoded, and the rounds end when a file that meets its goal would be no better.

Source: own.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

import numpy as np
from jaxtyping import Float, Int

from sacha_core.avatar.avatar import Avatar
from sacha_core.avatar.gaussians import Gaussians
from sacha_core.codec import decode, encode, inspect
from sacha_core.codec.levels import level_at
from sacha_core.errors import OptionError
from sacha_core.flame.model import HeadModel
from sacha_core.progress import Progress, Report, silent
from sacha_core.raster.rasteriser import Rasteriser
from sacha_core.rate.curvature import importance_of
from sacha_core.rate.fitting import Fitting, fit, starting_rates
from sacha_core.rate.goal import Goal, Measured, Prospect
from sacha_core.rate.judging import Judge
from sacha_core.rate.visibility import STOCK_SHARE, grounds_for, removal_errors
from sacha_core.train.options import LearningRates

__all__ = ["Thinned", "ThinningOptions", "thin", "thinning_rates"]

LOOKS = 3  # encodings by which the level for a goal is approached, at most
PACES = {"position": 0.6, "log_scale": 4.5, "quaternion": 3.0, "opacity_logit": 3.0, "sh_dc": 3.0, "sh_rest": 12.0}
NEAR = 0.3  # levels, within which what a level takes and gives is known from another


def thinning_rates() -> LearningRates:
    """Give the learning rates at the start of a round: places move slower than usual, all else faster."""
    usual = starting_rates()
    return replace(usual, **{name: factor * getattr(usual, name) for name, factor in PACES.items()})


@dataclass(frozen=True)
class ThinningOptions:
    """How fast, and how long.

    Args:
        share: of the Gaussians left that go in a round.
        iterations: steps after each, in which rates fall to nothing.
        last_iterations: steps once nobody goes any more.
        patience: rounds that promise nothing better, after which those that did stay.
        rounds: at most; none leaves all there.

    Raises:
        OptionError: an option is out of range.
    """

    share: float = 0.05
    iterations: int = 250
    last_iterations: int = 800
    patience: int = 3
    rounds: int = 60

    def __post_init__(self) -> None:
        if not 0 < self.share < 1:
            raise OptionError(f"a share of {self.share:g} goes in a round, expected between 0 and 1")
        if min(self.iterations, self.last_iterations, self.patience) < 1 or self.rounds < 0:
            raise OptionError(f"{self.iterations} and {self.last_iterations} steps, expected at least 1 of each")


@dataclass(frozen=True)
class Thinned:
    """What is left.

    Args:
        gaussians: m of them, fitted.
        rows: (m,) which of the avatar's Gaussians they were.
        quality: of the level at which they will meet the goal, about.
    """

    gaussians: Gaussians
    rows: Int[np.ndarray, " m"]
    quality: float


class Outlook:
    """Tells what Gaussians promise towards a goal.

    Args:
        avatar: all of it.
        head: that it is bound to.
        judge: of pictures.
        goal: what the file shall be.
        quality: of the level to begin with.
    """

    def __init__(self, avatar: Avatar, head: HeadModel, judge: Judge, goal: Goal, quality: float) -> None:
        self._avatar, self._head, self._judge, self._goal = avatar, head, judge, goal
        self._quality = quality

    def of(self, gaussians: Gaussians) -> Prospect:
        """Encode them, near the level that the last ones would have been encoded at, and look."""
        now = replace(self._avatar, gaussians=gaussians)
        importance, free = importance_of(now, self._head), self._judge.quick(gaussians)
        still = replace(now, motion=None)
        for _ in range(LOOKS):
            data = encode(still, level_at(self._quality), head=self._head, importance=importance)
            coded = self._judge.quick(decode(data, head=self._head).gaussians)
            found = self._goal.prospect(Measured(self._quality, inspect(data).gaussian_bytes, free, coded))
            near, self._quality = abs(found.quality - self._quality) < NEAR, found.quality
            if near or math.isinf(found.cost):
                break
        return found


def thin(
    avatar: Avatar,
    fitting: Fitting,
    outlook: Outlook,
    head: HeadModel,
    factors: Float[np.ndarray, " n"] | None = None,
    options: ThinningOptions | None = None,
    report: Report = silent,
) -> Thinned:
    """Leave out Gaussians for as long as that promises a better file.

    Args:
        avatar: of n Gaussians.
        fitting: of some or all of these.
        outlook: tells what files would be.
        head: that it is bound to.
        factors: (n,) how many times as much a change counts where each shows; once by default.
        options: how fast, and how long.
        report: told about progress.

    Raises:
        FormatError: a value left what the format holds.
    """
    options = options or ThinningOptions()
    worth, promised = Worth(avatar, head, fitting.rows, factors), outlook.of(fitting.gaussians())
    best = Thinned(fitting.gaussians(), fitting.rows, promised.quality)
    cost, since = promised.cost, 0
    for done in range(options.rounds):
        report(Progress("thin", done, options.rounds, {"Gaussians": len(fitting.rows)}))
        going = math.ceil(options.share * len(fitting.rows))
        if going >= len(fitting.rows) or since >= options.patience:
            break
        order = np.argsort(worth.of(fitting.gaussians(), fitting.rows), kind="stable")
        fitting.keep(order[going:])
        fit(fitting, options.iterations, thinning_rates())
        promised, since = outlook.of(fitting.gaussians()), since + 1
        if promised.cost < cost:
            best, cost, since = Thinned(fitting.gaussians(), fitting.rows, promised.quality), promised.cost, 0
    report(Progress("thin", options.rounds, options.rounds, {"Gaussians": len(best.rows)}))
    return best


class Worth:
    """What each Gaussian alone changes pictures by, in poses of the motion or, at a discount, in stock expressions.

    Args:
        avatar: all of it.
        head: that it is bound to.
        rows: which of its Gaussians are there.
        factors: (n,) see `thin`.
    """

    def __init__(
        self, avatar: Avatar, head: HeadModel, rows: Int[np.ndarray, " m"], factors: Float[np.ndarray, " n"] | None
    ) -> None:
        self._rasteriser, self._grounds = Rasteriser(), grounds_for(avatar, head)
        n = len(avatar.gaussians)
        self._factors = np.ones(n) if factors is None else factors
        self._elsewhere = np.zeros(n)
        there = avatar.gaussians.select(rows)
        self._elsewhere[rows] = STOCK_SHARE * removal_errors(there, self._grounds.stock, self._rasteriser)

    def of(self, gaussians: Gaussians, rows: Int[np.ndarray, " m"]) -> Float[np.ndarray, " m"]:
        """Give it of Gaussians that are left as they are now."""
        own = removal_errors(gaussians, self._grounds.own, self._rasteriser)
        return np.asarray(np.maximum(own, self._elsewhere[rows]) * self._factors[rows])
