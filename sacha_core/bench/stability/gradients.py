"""Gradients of the whole chain, from the picture's loss back to every parameter, FLAME's included.

Two questions, asked of each parameter. Is the formula right? Its gradient by automatic differentiation of the exact loss, whose decisions
are kept, must be the limit of central differences: a theorem, in float64. Is what ships precise enough? The kernels' float32 gradient must
agree with the exact one; the scene keeps clear of all thresholds, so that both decide alike.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace
from functools import lru_cache, partial

import numpy as np
import torch
from jaxtyping import Float
from torch import Tensor

from sacha_core.bench.stability.case import Case, Findings
from sacha_core.bench.stability.chain import DEGREE, Chain, chain
from sacha_core.bench.stability.exact_step import ExactLoss, step_leaves
from sacha_core.train.cpu_engine import CpuEngine
from sacha_core.train.options import TrainOptions
from sacha_core.train.state import ATTRIBUTES, FITTED_MOTION

__all__ = ["cases"]

# Of central differences, whose error falls with its square, while rounding of the loss grows with its inverse
STEP = 1e-5
SLOPE = 1e-6  # relative to the largest gradient of the kind: what STEP leaves of both
SHIPPED = 5e-5  # likewise: float32 sums over a thousand pixels, through some ten stages
LOSS = 1e-6  # relative: float32 sums
TURNS = ("rotation", "neck", "jaw", "eyes")
SMALL_TURN = 0.01  # of the largest gradient by any of them
SAMPLES = 10  # numbers of a parameter that are moved alone
DIRECTIONS = 3  # random ones, in which all are moved together

# Every component of every rotation vector, radians
POSES = {
    "at rest, where Rodrigues' angle vanishes": 0.0,
    "turned by 1e-7 rad a component": 1e-7,
    "turned by 1e-3 rad a component": 1e-3,
    "turned by half a turn": float(np.pi / np.sqrt(3)),
    "turned beyond a whole turn": 4.0,
}


def cases(full: bool = False) -> Iterator[Case]:
    """Give the family; `full` moves every number of every parameter, and not some of each."""
    must = "be the limit of central differences (float64), and be what the kernels give (float32)"
    for name in (*ATTRIBUTES, *FITTED_MOTION):
        yield Case(name, "an ordinary pose", must, partial(_gradient, name, None, full))
    for given, pose in POSES.items():
        yield Case(f"motion {given}", given, must, partial(_motion, pose))


@dataclass(frozen=True)
class Judged:
    """A scene with its gradients.

    Args:
        made: the scene.
        loss: the exact one, with its decisions.
        exact: gradients of that by automatic differentiation.
        shipped: gradients by which training steps.
        shipped_loss: the loss that training reports.
    """

    made: Chain
    loss: ExactLoss
    exact: dict[str, Tensor]
    shipped: dict[str, Float[np.ndarray, "..."]]
    shipped_loss: float


def _motion(pose: float, findings: Findings) -> None:
    for name in FITTED_MOTION:
        _gradient(name, pose, True, findings)


def _gradient(name: str, pose: float | None, whole: bool, findings: Findings) -> None:
    judged = _judged(pose)
    gradient, shipped = judged.exact[name], judged.shipped[name]
    largest, loss = float(gradient.abs().max()), float(judged.loss.parts["total"])
    findings.require(largest > 0, f"{name} has a gradient")
    findings.below(f"{name} against slopes", _slope_error(judged, name, whole) / largest, SLOPE)
    error = float(np.abs(shipped - gradient.numpy()).max())
    findings.below(f"{name} in float32", error / max(largest, _least(judged, name)), SHIPPED)
    findings.below("loss in float32", abs(judged.shipped_loss - loss) / loss, LOSS)


def _least(judged: Judged, name: str) -> float:
    """Give the size below which a gradient by a turn is judged as that: what float32 rounds off is of the head's turns as a whole."""
    return SMALL_TURN * max(float(judged.exact[turn].abs().max()) for turn in TURNS) if name in TURNS else 0.0


@lru_cache(maxsize=8)
def _judged(pose: float | None) -> Judged:
    made = chain(pose)
    leaves = step_leaves(made.state, made.target.timestep, learn=True)
    loss = made.loss(leaves)
    slopes = torch.autograd.grad(loss.parts["total"], list(leaves.values()))
    parts = {name: part.detach() for name, part in loss.parts.items()}
    return Judged(made, replace(loss, parts=parts), dict(zip(leaves, slopes, strict=True)), *_shipped(made))


def _slope_error(judged: Judged, name: str, whole: bool) -> float:
    """Give the largest difference between a gradient and the slopes of the loss with its decisions kept."""
    made, slopes = judged.made, judged.exact[name].reshape(-1)
    leaves = step_leaves(made.state, made.target.timestep)
    start, size, rng = leaves[name].clone(), len(slopes), np.random.default_rng(11)
    chosen = np.arange(size) if whole else rng.choice(size, min(SAMPLES, size), replace=False)
    directions = [*np.eye(size)[chosen], *(rng.normal(size=(DIRECTIONS, size)) / np.sqrt(size))]
    worst = 0.0
    for direction in map(torch.from_numpy, directions):
        ends = []
        for sign in (1, -1):
            leaves[name] = start + sign * STEP * direction.reshape(start.shape)
            with torch.no_grad():
                ends.append(float(made.loss(leaves, judged.loss.decisions).parts["total"]))
        worst = max(worst, abs((ends[0] - ends[1]) / (2 * STEP) - float(slopes @ direction)))
    return worst


def _shipped(made: Chain) -> tuple[dict[str, Float[np.ndarray, "..."]], float]:
    """Give the gradients by which training steps, and the loss that it reports."""
    engine = CpuEngine(made.head, made.motion, TrainOptions(losses=made.weights, threads=1))
    engine.put(made.state)
    engine.differentiate(1, [made.target], DEGREE)
    return engine.gradients(), engine.losses()["total"]
