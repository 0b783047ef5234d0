"""How far training in float32 drifts from the same run in float64: the same views in the same order, the same start, Adam to the letter.

Descent on a picture is chaotic: runs that differ by a rounding part, in whatever precision. So a third run computes in float64, too, but
keeps its parameters in float32 as the shipped one does; how far that drifts is the measure.
"""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import closing
from dataclasses import dataclass
from functools import lru_cache, partial
from itertools import count, islice, pairwise
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

import numpy as np
import torch
from jaxtyping import Float
from torch import Tensor

from sacha_core.bench.stability.case import Case, Findings
from sacha_core.bench.stability.chain import as_seen
from sacha_core.bench.stability.exact_head import ExactHead
from sacha_core.bench.stability.exact_step import exact_loss, world_leaves
from sacha_core.bench.stability.tiny import capture_of, ring, tiny_head
from sacha_core.progress import silent
from sacha_core.train.loop import Run
from sacha_core.train.options import Schedule, TrainOptions
from sacha_core.train.rates import learning_rates
from sacha_core.train.state import ATTRIBUTES, FITTED_MOTION
from sacha_core.train.views import Target, epoch_steps

__all__ = ["Divergence", "cases", "divergence", "iterations_of"]

WIDTH, HEIGHT, CAMERAS, FRAMES = 24, 28, 4, 3
NEVER = 10**9
BETAS, EPSILON = (0.9, 0.999), 1e-15

FIRST = 1e-6  # relative: float32 sums of one loss
EARLY, CLOSE = (
    30,
    1e-5,
)  # iterations, and how far apart, relative, in the median: single pixels at a threshold cost more at once
APART = 0.02  # relative, of the mean of the last tenth of losses
MARKS = (1, 3, 10, 30, 60, 100, 300, 1000)  # iterations up to which drift is told


@dataclass(frozen=True)
class Divergence:
    """Losses of three runs, iteration by iteration.

    Args:
        exact: (i,) in float64.
        shipped: (i,) by the CPU's engine.
        stored: (i,) in float64, with parameters rounded to float32 after each step.
    """

    exact: Float[np.ndarray, " i"]
    shipped: Float[np.ndarray, " i"]
    stored: Float[np.ndarray, " i"]

    def apart(self, other: Float[np.ndarray, " i"]) -> Float[np.ndarray, " i"]:
        """Give how far a run's losses are from the exact ones, relative."""
        relative: np.ndarray = np.abs(other / self.exact - 1)
        return relative

    def rows(self) -> Iterator[dict[str, Any]]:
        """Give median and largest distance in stretches of the runs, for a table."""
        marks = [mark for mark in MARKS if mark <= len(self.exact)]
        for run, losses in (("shipped, float32", self.shipped), ("float64, kept in float32", self.stored)):
            for first, last in pairwise([0, *marks]):
                apart = self.apart(losses)[first:last]
                figures = {"median": float(np.median(apart)), "largest": float(apart.max())}
                yield {
                    "run": run,
                    "from": first + 1,
                    "to": last,
                    "loss": float(self.exact[first:last].mean()),
                    **figures,
                }


def cases(full: bool = False) -> Iterator[Case]:
    """Give the family; `full` trains for a thousand iterations."""
    iterations = iterations_of(full)
    given = f"{iterations} iterations, {tiny_head().n_faces} Gaussians, {WIDTH} x {HEIGHT} pixels, no density control"
    must = "begin with the same losses, and end as low"
    yield Case("loss in float32 and float64", given, must, partial(_drift, iterations), slow=True)


def iterations_of(full: bool) -> int:
    """Give the length of the runs."""
    return 1000 if full else 60


@lru_cache(maxsize=1)
def divergence(iterations: int) -> Divergence:
    """Train the same three times."""
    with TemporaryDirectory() as name:
        capture = capture_of(Path(name), ring(CAMERAS, width=WIDTH, height=HEIGHT), FRAMES)
        run = Run(capture, tiny_head(), _options(iterations), Path(name) / "model", silent)
        run.begin(resume=False, start_from=None)
        exact, stored = ExactRun(run), ExactRun(run, stored=True)
        shipped = []
        with closing(run.targets):
            for _ in range(iterations):
                run.iterate()
                shipped.append(run.engine.losses()["total"])
        targets = list(islice(_targets(run), iterations))
    losses = [[made.iterate(k, target) for k, target in enumerate(targets, 1)] for made in (exact, stored)]
    return Divergence(np.array(losses[0]), np.array(shipped), np.array(losses[1]))


class ExactRun:
    """A run in float64, beginning where another one stands.

    Args:
        run: that has begun; only looked at.
        stored: whether parameters are rounded to float32 after each step.

    Source: Kingma and Ba, Adam, 2015; the rest as `exact_loss` has it.
    """

    def __init__(self, run: Run, stored: bool = False) -> None:
        self._options, self._extent = run.options, run.extent
        self._head = ExactHead(run.head, run.capture.motion)
        self._stored, state = stored, run.engine.take()
        self._binding = state.binding.copy()
        self._values = {
            name: torch.tensor(state.values[name].astype(np.float64)) for name in (*ATTRIBUTES, *FITTED_MOTION)
        }
        self._first = {name: torch.zeros_like(value) for name, value in self._values.items()}
        self._second = {name: torch.zeros_like(value) for name, value in self._values.items()}

    def iterate(self, iteration: int, target: Target) -> float:
        """Take one step by one view, and give the loss before it."""
        schedule, options = self._options.schedule, self._options
        degree = min(options.sh_degree, iteration // schedule.sh_every)
        leaves = {name: value.clone() for name, value in self._values.items() if name in ATTRIBUTES}
        leaves |= {name: self._values[name][target.timestep].clone() for name in FITTED_MOTION}
        for leaf in leaves.values():
            leaf.requires_grad_()
        with torch.no_grad():
            world, _ = world_leaves(leaves, self._head, self._binding, target.camera, degree)
        seen = as_seen(world, target)
        loss = exact_loss(leaves, self._head, self._binding, seen, degree, options.losses).parts["total"]
        slopes = dict(zip(leaves, torch.autograd.grad(loss, list(leaves.values())), strict=True))
        rates = learning_rates(options.rates, schedule, iteration, self._extent)
        for name, value in self._values.items():
            gradient = slopes[name]
            if name in FITTED_MOTION:
                gradient = torch.zeros_like(value)
                gradient[target.timestep] = slopes[name]
            self._adam(name, gradient, rates[name], iteration)
        return float(loss.detach())

    def _adam(self, name: str, gradient: Tensor, rate: float, step: int) -> None:
        first, second = self._first[name], self._second[name]
        first.mul_(BETAS[0]).add_(gradient, alpha=1 - BETAS[0])
        second.mul_(BETAS[1]).addcmul_(gradient, gradient, value=1 - BETAS[1])
        mean, square = first / (1 - BETAS[0] ** step), second / (1 - BETAS[1] ** step)
        value = self._values[name] - rate * mean / (square.sqrt() + EPSILON)
        self._values[name] = value.float().double() if self._stored else value


def _drift(iterations: int, findings: Findings) -> None:
    found = divergence(iterations)
    apart, tenth = found.apart(found.shipped), iterations // 10
    findings.finite("losses", {"shipped": found.shipped, "exact": found.exact})
    findings.below("first loss off by", float(apart[0]), FIRST)
    findings.below(f"median of the first {EARLY} off by", float(np.median(apart[:EARLY])), CLOSE)
    findings.seen("largest off by", float(apart.max()))
    findings.seen("in float64 with parameters kept in float32, largest off by", float(found.apart(found.stored).max()))
    ends = float(found.shipped[-tenth:].mean() / found.exact[-tenth:].mean())
    findings.below("mean of the last tenth off by", abs(ends - 1), APART)


def _targets(run: Run) -> Iterator[Target]:
    """Give the views in the order in which the run sees them."""
    views = run.views.views
    for epoch in count():
        for (index,) in epoch_steps(views, 1, run.options.seed, epoch):
            yield run.views[index]


def _options(iterations: int) -> TrainOptions:
    """A run in which nothing is decided but by gradients; harmonics up to degree 2 come in on the way."""
    quiet = Schedule(
        iterations=iterations, position_decay=iterations, sh_every=max(iterations // 3, 1), densify_from=NEVER, densify_every=NEVER,
        densify_until=NEVER, warm_up=NEVER, calibrations=(), opacity_resets=(), size_prune_from=NEVER,
    )  # fmt: skip
    return TrainOptions(threads=1, sh_degree=2, device="cpu", schedule=quiet)
