"""Gaussians on their way to look like pictures: what finding fewer of them and making up for rounding share.

Source: own.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Literal

import numpy as np
from jaxtyping import Int

from sacha_core.avatar.avatar import Avatar
from sacha_core.avatar.gaussians import Gaussians
from sacha_core.errors import OptionError
from sacha_core.flame.model import HeadModel
from sacha_core.progress import Progress, Report, silent
from sacha_core.rate.squared_loss import squared_loss
from sacha_core.train.cpu_engine import CpuEngine
from sacha_core.train.options import LearningRates, LossOptions, TrainOptions
from sacha_core.train.state import Arrays, initial_state, rearrange
from sacha_core.train.views import Target

__all__ = ["CODED", "EVERY", "Fitting", "falling", "fit", "starting_rates"]

# What is coded of a Gaussian, beside its triangle
CODED = ("position", "log_scale", "quaternion", "opacity_logit", "sh_dc", "sh_rest")
ALIKE = LossOptions(sensitivity=0.0, position=0.0, scale=0.0)  # to look like the pictures, and nothing else
EVERY = 20  # steps from one word of progress to the next


def starting_rates() -> LearningRates:
    """Give the learning rates at the start; positions in triangle units."""
    return LearningRates(
        position=0.001, log_scale=0.0025, quaternion=0.0005, opacity_logit=0.01, sh_dc=0.00125, sh_rest=0.00006
    )


class Fitting:
    """Moves Gaussians by the gradients of pictures, each round of them in an order of its own.

    Args:
        avatar: with the motion that the targets' timesteps are of, which stays as it is.
        head: that it is bound to.
        targets: pictures to look like; those of one step share a timestep.
        loss: the squared difference of pictures, which is what PSNR sees, or training's own.
        threads: how many; one for each processor by default. They change nothing.
        seed: of the order of pictures.

    Raises:
        OptionError: there is no motion, or no picture.
    """

    def __init__(
        self,
        avatar: Avatar,
        head: HeadModel,
        targets: Sequence[Sequence[Target]],
        loss: Literal["squared", "training"] = "squared",
        threads: int | None = None,
        seed: int = 0,
    ) -> None:
        if avatar.motion is None or not targets:
            raise OptionError("fitting needs a motion and pictures of it")
        options = TrainOptions(losses=ALIKE, fine_tune=False, threads=threads, device="cpu")
        self._engine = CpuEngine(head, avatar.motion, options, squared_loss if loss == "squared" else None)
        self._motion, self._targets, self._seed = avatar.motion, targets, seed
        self.restart(avatar.gaussians)

    def restart(self, gaussians: Gaussians) -> None:
        """Begin anew, with Gaussians as they are now."""
        self._rows = np.argsort(gaussians.binding, kind="stable")  # training wants them by triangle
        self._engine.put(initial_state(gaussians.select(self._rows), self._motion, 1, 1.0, 0.0))
        self._rng, self._waiting = np.random.default_rng([self._seed, 3]), list[int]()
        self._degree, self._done = gaussians.sh_degree, 0

    @property
    def rows(self) -> Int[np.ndarray, " m"]:
        """Which of the avatar's Gaussians are left, ascending."""
        return np.sort(self._rows)

    def gaussians(self) -> Gaussians:
        """Give those left as they are now, in the order in which they were given."""
        return self._engine.take().gaussians().select(np.argsort(self._rows))

    def keep(self, places: Int[np.ndarray, " k"]) -> None:
        """Leave only some of those left; `places` are of `rows`."""
        kept = np.sort(np.argsort(self._rows)[places])  # by triangle, as they are
        rearrange(self._engine.take(), kept)
        self._rows = self._rows[kept]

    def step(self, rates: LearningRates, pace: float, decoded: Arrays | None = None) -> None:
        """Let the next picture move them.

        Args:
            rates: learning rates.
            pace: times as much.
            decoded: what is drawn in their place, by name, in the order of `gaussians`.
        """
        values = self._engine.take().values
        given = {name: values[name] for name in CODED}
        values |= {name: self._in_training(value) for name, value in (decoded or {}).items()}
        self._done += 1
        try:
            self._engine.differentiate(self._done, self._next(), self._degree)
        finally:
            values |= given
        paced = {name: getattr(rates, name) * pace for name in CODED}
        self._engine.advance(paced | {"sensitivity_logit": 0.0}, frozenset())

    def _in_training(self, value: np.ndarray) -> np.ndarray:
        """Give rows in the order of `gaussians` in that of the state."""
        return np.ascontiguousarray(value[np.argsort(np.argsort(self._rows))], np.float32)

    def _next(self) -> Sequence[Target]:
        self._waiting = self._waiting or self._rng.permutation(len(self._targets)).tolist()
        return self._targets[self._waiting.pop()]


def fit(
    fitting: Fitting,
    iterations: int,
    rates: LearningRates,
    pace: float = 1.0,
    report: Report = silent,
    stage: str = "fit",
) -> None:
    """Take some steps, whose rates, `pace` times those given, fall to nothing; tell of them as of a stage."""
    for done in range(iterations):
        if done % EVERY == 0:
            report(Progress(stage, done, iterations))
        fitting.step(rates, pace * falling(done, iterations))
    report(Progress(stage, iterations, iterations))


def falling(done: int, total: int) -> float:
    """Give the share of the learning rates at a step of many: from 1 to nothing, as half a cosine."""
    return 0.5 * (1 + math.cos(math.pi * done / total))
