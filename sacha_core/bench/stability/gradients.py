"""Gradients of the whole chain, from the picture's loss back to every parameter, FLAME's included.

Two questions, asked of each parameter. Is the formula right? Its gradient by automatic differentiation of the exact loss, whose decisions
are kept, must be the limit of central differences: a theorem, in float64. Is what ships precise enough? The kernels' float32 gradient must
agree with the exact one; the scene keeps clear of all thresholds, so that both decide alike.
"""

from __future__ import annotations

from collections.abc import Iterator
from copy import deepcopy
from dataclasses import dataclass
from functools import lru_cache, partial

import numpy as np
import torch
from jaxtyping import Float
from torch import Tensor

from sacha_core.bench.stability.case import Case, Findings
from sacha_core.bench.stability.chain import DEGREE, Chain, Setting, chain
from sacha_core.bench.stability.exact_step import ExactLoss, StepDecisions, exact_loss, step_leaves
from sacha_core.flame.posing import TURNS
from sacha_core.train.cpu_engine import CpuEngine
from sacha_core.train.options import TrainOptions
from sacha_core.train.state import ATTRIBUTES, FITTED_MOTION

__all__ = ["cases"]

# Of central differences, whose error falls with its square, while rounding of the loss grows with its inverse
STEP = 1e-5
SLOPE = 1e-6  # relative to the largest gradient of the kind: what STEP leaves of both
SHIPPED = 1e-4  # likewise: float32 sums over a thousand pixels, through some ten stages; 4e-5 was seen
LOSS = 1e-6  # relative: float32 sums
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


SETTINGS: dict[str, Setting] = {
    "a picture that is cropped to the head": "cropped",
    "two cameras in one step": "two views",
}

EXACT = "be what the kernels give (float32)"
RIGHT = f"be the limit of central differences (float64), and {EXACT}"


def cases(full: bool = False) -> Iterator[Case]:
    """Give the family; `full` moves every number of every parameter, and not some of each."""
    for name in (*ATTRIBUTES, *FITTED_MOTION):
        yield Case(name, "an ordinary pose", RIGHT, partial(_gradient, name, None, full))
    for given, pose in POSES.items():
        yield Case(f"motion {given}", given, RIGHT, partial(_motion, pose))
    for given, setting in SETTINGS.items():
        yield Case(f"all parameters, {setting}", given, EXACT, partial(_in_setting, setting))
    for setting in ("one view", *SETTINGS.values()):
        given = "gradients by places in the image, in normalised device units"
        yield Case(f"growth statistic, {setting}", given, EXACT, partial(_growth, setting))


@dataclass(frozen=True)
class Judged:
    """A scene with its gradients.

    Args:
        made: the scene.
        loss: the exact one of a step.
        decisions: that it rests on, of each view.
        exact: gradients of it by automatic differentiation.
        shipped: gradients by which training steps.
        shipped_loss: the loss that training reports.
    """

    made: Chain
    loss: float
    decisions: list[StepDecisions]
    exact: dict[str, Tensor]
    shipped: dict[str, Float[np.ndarray, "..."]]
    shipped_loss: float


def _gradient(name: str, pose: float | None, whole: bool, findings: Findings) -> None:
    judged = _judged(pose)
    largest = float(judged.exact[name].abs().max())
    findings.below(f"{name} against slopes", _slope_error(judged, name, whole) / largest, SLOPE)
    _hold_kernels(findings, judged, name)


def _motion(pose: float, findings: Findings) -> None:
    for name in FITTED_MOTION:
        _gradient(name, pose, True, findings)


def _in_setting(setting: Setting, findings: Findings) -> None:
    for name in (*ATTRIBUTES, *FITTED_MOTION):
        _hold_kernels(findings, _judged(None, setting), name)


def _growth(setting: Setting, findings: Findings) -> None:
    """A view says what it would say alone, whatever its share of the step's loss."""
    made = chain(None, setting)
    engine = _differentiated(made)
    lengths, counts = np.zeros(len(made.state)), np.zeros(len(made.state), int)
    leaves = step_leaves(made.state, 0)
    for view in made.views:
        shift = torch.zeros(len(lengths), 2, dtype=torch.float64, requires_grad=True)
        scene = (made.exact_head, made.state.binding, view, DEGREE, made.weights)
        (slope,) = torch.autograd.grad(exact_loss(leaves, *scene, shift=shift).parts["total"], shift)
        camera = view.target.camera
        lengths += np.hypot(*(slope.numpy() * (camera.width / 2, camera.height / 2)).T)
        counts += view.visible
    state = engine.take()
    findings.require(bool((state.gradient_count == counts).all()), "counts the views that show each Gaussian")
    findings.below("lengths in float32", float(np.abs(state.gradient_sum - lengths).max() / lengths.max()), SHIPPED)


def _hold_kernels(findings: Findings, judged: Judged, name: str) -> None:
    """Hold a parameter's float32 gradient to the exact one."""
    exact, shipped = judged.exact[name].numpy(), judged.shipped[name]
    largest = np.abs(exact).max()
    findings.require(bool(largest > 0), "a gradient" if largest > 0 else f"a gradient by {name}")
    if name in TURNS:  # what float32 rounds off is of the head's turns as a whole
        largest = max(largest, SMALL_TURN * max(float(judged.exact[turn].abs().max()) for turn in TURNS))
    findings.below(f"{name} in float32", float(np.abs(shipped - exact).max() / largest), SHIPPED)
    findings.below("loss in float32", abs(judged.shipped_loss - judged.loss) / judged.loss, LOSS)


@lru_cache(maxsize=8)
def _judged(pose: float | None, setting: Setting = "one view") -> Judged:
    made = chain(pose, setting)
    leaves = step_leaves(made.state, 0, learn=True)
    losses = made.losses(leaves)
    loss = _mean_total(losses)
    slopes = torch.autograd.grad(loss, list(leaves.values()))
    engine = _differentiated(made)
    shipped = engine.gradients(), engine.losses()["total"]
    decisions = [one.decisions for one in losses]
    return Judged(made, float(loss.detach()), decisions, dict(zip(leaves, slopes, strict=True)), *shipped)


def _slope_error(judged: Judged, name: str, whole: bool) -> float:
    """Give the largest difference between a gradient and the slopes of the loss with its decisions kept."""
    made, slopes = judged.made, judged.exact[name].reshape(-1)
    leaves = step_leaves(made.state, 0)
    start, size, rng = leaves[name].clone(), len(slopes), np.random.default_rng(11)
    chosen = np.arange(size) if whole else rng.choice(size, min(SAMPLES, size), replace=False)
    directions = [*np.eye(size)[chosen], *(rng.normal(size=(DIRECTIONS, size)) / np.sqrt(size))]
    worst = 0.0
    for direction in map(torch.from_numpy, directions):
        ends = []
        for sign in (1, -1):
            leaves[name] = start + sign * STEP * direction.reshape(start.shape)
            with torch.no_grad():
                ends.append(float(_mean_total(made.losses(leaves, judged.decisions))))
        worst = max(worst, abs((ends[0] - ends[1]) / (2 * STEP) - float(slopes @ direction)))
    return worst


def _mean_total(losses: list[ExactLoss]) -> Tensor:
    return torch.stack([loss.parts["total"] for loss in losses]).mean()


def _differentiated(made: Chain) -> CpuEngine:
    """Give the shipped engine with the gradients of a first step."""
    engine = CpuEngine(made.head, made.motion, TrainOptions(threads=1, losses=made.weights))
    engine.put(deepcopy(made.state))
    engine.differentiate(1, made.targets, DEGREE)
    return engine
