"""What is not coded yet makes up for what was rounded: fitted to pictures, attribute after attribute, while a file is made.

Source: own; see `codec.in_turn`.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from typing import Literal

from sacha_core.avatar.avatar import Avatar
from sacha_core.avatar.gaussians import Gaussians
from sacha_core.errors import OptionError
from sacha_core.flame.model import HeadModel
from sacha_core.progress import Progress, Report, silent
from sacha_core.rate.fitting import CODED, EVERY, Fitting, falling, fit, starting_rates
from sacha_core.train.options import LearningRates
from sacha_core.train.state import Arrays
from sacha_core.train.views import Target

__all__ = ["MakingUp", "MakingUpOptions"]

PACE, HARMONIC_PACE = 0.7, 4.0  # of `fitting.starting_rates`; harmonics take four times those
STAGE = "make up for rounding"
ROUND = 12  # steps through the quantiser of harmonics between two looks at what it gives


def making_up_rates() -> LearningRates:
    """Give the learning rates at the start; they fall to nothing as half a cosine."""
    usual = starting_rates()
    return replace(usual, sh_rest=HARMONIC_PACE * usual.sh_rest)


@dataclass(frozen=True)
class MakingUpOptions:
    """How long, and towards what.

    Args:
        iterations: steps after each attribute, and a quarter more through the quantiser of harmonics.
        loss: the squared difference of pictures, which is what PSNR sees, or training's own.
        threads: how many; one for each processor by default.
        seed: of the order of pictures.

    Raises:
        OptionError: an option is out of range.
    """

    iterations: int = 300
    loss: Literal["squared", "training"] = "squared"
    threads: int | None = None
    seed: int = 0

    def __post_init__(self) -> None:
        if self.iterations < 1:
            raise OptionError(f"{self.iterations} steps after each attribute, expected at least 1")


class MakingUp:
    """Moves what is not coded yet (`codec.in_turn.Remaining`).

    Args:
        avatar: with the motion that the targets' timesteps are of; its Gaussians are not looked at.
        head: that it is bound to.
        targets: pictures to look like; those of one step share a timestep.
        options: how long, and towards what.
        report: told about progress.
    """

    def __init__(
        self,
        avatar: Avatar,
        head: HeadModel,
        targets: Sequence[Sequence[Target]],
        options: MakingUpOptions,
        report: Report = silent,
    ) -> None:
        self._avatar, self._head, self._targets, self._options = avatar, head, targets, options
        self._report = report
        self._fitting: Fitting | None = None

    def after(self, gaussians: Gaussians, coded: frozenset[str]) -> Gaussians:
        """Let all but `coded` make up for what these lost."""
        fitting, rates = self._begin(gaussians, coded)
        fit(fitting, self._options.iterations, rates, PACE, self._report, STAGE)
        return fitting.gaussians()

    def through(
        self, gaussians: Gaussians, coded: frozenset[str], decode: Callable[[Gaussians], Gaussians]
    ) -> Gaussians:
        """Move all but `coded` so that they look better as decoded, straight through."""
        fitting, rates = self._begin(gaussians, coded)
        total, decoded = self._options.iterations * 5 // 4, Arrays()
        for done in range(total):
            if done % EVERY == 0:
                self._report(Progress(STAGE, done, total))
            if done % ROUND == 0:
                seen = decode(fitting.gaussians())
                decoded = {name: getattr(seen, name) for name in CODED if name not in coded}
            fitting.step(rates, falling(done, total), decoded)
        self._report(Progress(STAGE, total, total))
        return fitting.gaussians()

    def _begin(self, gaussians: Gaussians, coded: frozenset[str]) -> tuple[Fitting, LearningRates]:
        if self._fitting is None:
            how, now = self._options, replace(self._avatar, gaussians=gaussians)
            self._fitting = Fitting(now, self._head, self._targets, how.loss, how.threads, how.seed)
        else:
            self._fitting.restart(gaussians)
        return self._fitting, replace(making_up_rates(), **dict.fromkeys(coded, 0.0))
