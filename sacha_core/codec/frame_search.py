"""Chooses what a motion's frames become: steps by the vertex error that is aimed at, the model that fits them, and every residual.

Only the encoder needs this.

Source: own.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from jaxtyping import Float, Int

from sacha_core.avatar.motion import Motion
from sacha_core.codec.adaptive import compiled_kernels
from sacha_core.codec.displacement import error_of
from sacha_core.codec.frame_coder import Chosen, choose_frames
from sacha_core.codec.frame_fit import adopted, first_model, mates_of, refit, rescaled
from sacha_core.codec.frame_model import FrameModel, parameters_of
from sacha_core.codec.kernels.frames import FINE

__all__ = ["FrameTask", "choose_groups", "search_frames"]

REFITS, MOST_TRIALS = 4, 10
NEAR_ENOUGH = 0.975  # of the error aimed at, from below
AIM_BELOW = 0.99
SAMPLE, PLAIN_SAMPLE = 400_000, 20_000  # numbers that the search looks at; the rest is chosen once
FIRST_GUESS = 5.0  # steps are about so many times the error aimed at, over the root of how many parameters there are


@dataclass(frozen=True)
class FrameTask:
    """What shall become of a motion's frames.

    Args:
        values: (t, p) parameters.
        kinds: (p,) index into PARAMETERS of each.
        fixed_steps: (p,) where nothing is known of vertices.
        products: (p, p) inner products of displacements, as `displacement.displacement_products` gives them; None where there is no head.
        aim: vertex error aimed at, metres (norm, RMS over vertices and frames).
        group_frames: frames in every group but the last.
        live: whether frames other than these are to come.
    """

    values: Float[np.ndarray, "t p"]
    kinds: Int[np.ndarray, " p"]
    fixed_steps: Float[np.ndarray, " p"]
    products: Float[np.ndarray, "p p"] | None
    aim: float
    group_frames: int
    live: bool = False

    @property
    def weighted(self) -> Float[np.ndarray, "p p"]:
        """Inner products of displacements, or what makes all of them unrelated and steps the fixed ones."""
        return np.diag(self.fixed_steps**-2.0) if self.products is None else self.products

    def over(self, motion: Motion) -> FrameTask:
        """Give the same task for other frames."""
        return replace(self, values=parameters_of(motion))

    def sample(self) -> FrameTask:
        """Give the same task for no more than some groups."""
        groups = -(-len(self.values) // self.group_frames)
        most = SAMPLE if compiled_kernels() else PLAIN_SAMPLE
        wanted = max(1, most // (self.group_frames * len(self.kinds)))
        if groups <= wanted:
            return self
        taken = np.unique(np.linspace(0, groups - 2, wanted).astype(int))  # the last may be a short one
        rows = (taken[:, None] * self.group_frames + np.arange(self.group_frames)).reshape(-1)
        return replace(self, values=self.values[rows])


def choose_groups(model: FrameModel, task: FrameTask, expected: int = 0) -> list[Chosen]:
    """Choose the residuals of every group."""
    targets, mates = task.values[:, model.alive] / (model.steps[model.alive] / FINE), mates_of(model, task.weighted)
    starts = range(0, len(targets), task.group_frames)
    expected = max(expected, targets.size)
    return [choose_frames(targets[at : at + task.group_frames], model, mates, expected) for at in starts]


def joined(groups: list[Chosen]) -> Chosen:
    """Give all groups as one."""
    parts = ([getattr(group, name) for group in groups] for name in ("residuals", "kinds", "units"))
    return Chosen(*(np.concatenate(part) for part in parts))


def error_when(model: FrameModel, task: FrameTask, groups: list[Chosen]) -> float:
    """Give the vertex error of what was chosen, metres."""
    off = model.values(joined(groups).units).astype(np.float64) - task.values
    return error_of(off, task.weighted)


def search_frames(task: FrameTask) -> FrameModel:
    """Find the model for a task: with a head, of the largest steps whose vertex error is below the one aimed at.

    Raises:
        OverflowError: a value is beyond 2**30 steps.
    """
    whole, task = task, task.sample()
    reach = np.sqrt(np.maximum(np.diag(task.weighted), 0))
    measured = task.products is not None and bool(reach.any())
    unit = task.aim * FIRST_GUESS / np.sqrt(np.count_nonzero(reach)) if measured else 1.0

    def fresh(unit: float) -> FrameModel:
        return first_model(whole.values, task.kinds, reach, task.fixed_steps, unit, live=task.live)

    model = fresh(unit)
    if not len(task.values):
        return model
    for trial in range(MOST_TRIALS):
        groups = choose_groups(model, task, task.values.size * MOST_TRIALS)
        error = error_when(model, task, groups) if measured else task.aim
        if trial >= REFITS and (not measured or NEAR_ENOUGH * task.aim <= error <= task.aim):
            break
        if trial < REFITS:
            targets = task.values[:, model.alive] / (model.steps[model.alive] / FINE)
            model = refit(model, targets, joined(groups), task.group_frames, live=task.live)
        if measured and error > 0:
            unit = model.unit * min(max(AIM_BELOW * task.aim / error, 0.25), 4.0)
            model = adopted(fresh(unit), model) if trial == 0 else rescaled(model, task.values, unit)
    return settled(model, whole) if measured else rescaled(model, whole.values, model.unit)


def settled(model: FrameModel, task: FrameTask) -> FrameModel:
    """Give the model with steps so small that the error of all frames is below the one aimed at."""
    for _ in range(MOST_TRIALS):
        model = rescaled(model, task.values, model.unit)
        error = error_when(model, task, choose_groups(model, task))
        if error <= task.aim:
            break
        model = replace(model, unit=model.unit * min(0.97, AIM_BELOW * task.aim / error))
    return model
