"""Training on the CPU: the loop's engine in NumPy and compiled kernels."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from contextlib import AbstractContextManager

import numpy as np
from jaxtyping import Float

from sacha_core.errors import GeometryError, OptionError
from sacha_core.flame.model import HeadModel
from sacha_core.flame.posing import HeadMotion
from sacha_core.parallel.pool import Pool
from sacha_core.perception.image_loss import ImageLoss, ImageLosses
from sacha_core.raster.rasteriser import Rasteriser
from sacha_core.raster.splats import ColourError
from sacha_core.stopwatch import Stopwatch, timed
from sacha_core.train.drawing import Drawer, Drawing
from sacha_core.train.faults import LARGEST_GRADIENT, Fault
from sacha_core.train.gradients import GaussianGradients
from sacha_core.train.looking import Looker
from sacha_core.train.masks import mask_gradient, mask_penalty
from sacha_core.train.optimiser import Adam, GaussianStep, MotionSlopes, Slopes
from sacha_core.train.options import TrainOptions
from sacha_core.train.rig import Rig
from sacha_core.train.state import FITTED_MOTION, MASK_LOGIT, Arrays, TrainState, lay_together
from sacha_core.train.views import Box, Target

__all__ = ["CpuEngine"]

Compare = Callable[[np.ndarray, np.ndarray, np.ndarray, Box], ImageLosses]


class CpuEngine:
    """Trains on the CPU; `sacha_core.train.engine.Engine` says what each method is for.

    Results have the same bits for any number of threads. The state is the loop's own: `put` and `take` cost no more than a step that
    Gaussians have yet to take, which is joined with placing them in the next iteration.

    Args:
        head: the head model.
        motion: whose static parameters make the person.
        options: of the run.
        compare: called as `ImageLoss` is, with a drawn image, its target, the reference sensitivity and the part of these that was
            drawn, in place of the losses of the options.

    Attributes:
        stopwatch: told how long each stage takes; None for nobody.

    Raises:
        HeadError: the motion has components or vertex offsets that the head lacks.
        OptionError: an option is not for the CPU.
    """

    def __init__(
        self, head: HeadModel, motion: HeadMotion, options: TrainOptions, compare: Compare | None = None
    ) -> None:
        if options.density.gradient != "ndc":
            raise OptionError(f"density.gradient is {options.density.gradient}, expected ndc on the CPU")
        self.stopwatch: Stopwatch | None = None
        self._fine_tune, losses = options.fine_tune, options.losses
        self._mask_weight, self._sensitivity_weight = losses.mask, losses.sensitivity
        self._sensitivity_until = options.schedule.sensitivity_until
        self._pool = Pool(options.threads)
        self._rig = Rig(head, motion, self._pool)
        self._rasteriser = Rasteriser(pool=self._pool, stopwatch=self._time)
        self._drawer = Drawer(self._rasteriser, self._pool, self._time)
        self._looker = Looker(self._rig, self._rasteriser, self._pool, self._time)
        self._image_loss = ImageLoss(losses.l1, losses.ssim, losses.sensitivity, self._pool)
        self._compare = compare or self._image_loss
        self._gradients = GaussianGradients(losses, self._rig, self._pool, options.fine_tune)
        self._adam = Adam(self._pool)
        self._step: GaussianStep | None = None  # which the Gaussians of the state have yet to take
        self._masks: Arrays = {}  # gradient by the masks, where they are learnt
        self._motion: Arrays = {}  # gradients of the rows of one timestep
        self._timestep, self._degree = 0, 0
        self._fault: Fault | None = None
        self._sums: dict[str, float] = {}
        self._summed = 0
        self._scale = np.ones(head.n_faces, np.float32)

    def put(self, state: TrainState) -> None:
        """Go on from a state, whose arrays may move to other memory."""
        self._settle()
        lay_together(state)  # what was read from a file or copied lies just anywhere
        self._state = state

    def take(self) -> TrainState:
        """Give the state as it is now."""
        self._settle()
        return self._state

    def differentiate(self, iteration: int, targets: Sequence[Target], degree: int) -> None:
        """Draw some views of one timestep, compare, and keep the gradients of the mean loss; adds to statistics and losses."""
        self._timestep, self._degree = targets[0].timestep, degree
        ended = self._sensitivity_until is not None and iteration > self._sensitivity_until
        self._image_loss.entropy_weight = 0.0 if ended else self._sensitivity_weight
        losses: dict[str, float] = {}
        cause = self._find_gradients(targets, losses)
        self._fault = None if cause is None else Fault(iteration, *cause)
        state = self._state
        if self._fault is not None:
            state.faults = state.faults.and_one(self._fault)
            return
        with self._time("statistics"):
            state.gradient_sum += self._gradients.lengths
            state.gradient_count += self._gradients.seen
        self._summed += 1
        for name, value in losses.items():
            self._sums[name] = self._sums.get(name, 0.0) + value

    def advance(self, rates: Mapping[str, float], void: frozenset[str]) -> None:
        """Let Adam step with the gradients kept; not at all after a fault."""
        if self._fault is not None:
            return
        with self._time("Adam"):
            gradients = {name: slope for name, slope in self._gradients.by_name.items() if name not in void}
            colours = () if "sh_rest" in void else self._gradients.colours
            if MASK_LOGIT not in void:
                gradients |= self._masks
            slopes = Slopes(gradients, self._drawer.splats.means, colours, self._degree)
            motion = MotionSlopes(self._timestep, self._motion) if self._motion else None
            self._step = self._adam.prepare(self._state, rates, slopes, motion)
        if MASK_LOGIT in self._state.values:  # which decide what is drawn
            self._settle()

    def losses(self) -> dict[str, float]:
        """Give the mean losses of the iterations without fault since the last call."""
        means = {name: total / self._summed for name, total in self._sums.items()}
        self._sums, self._summed = {}, 0
        return means

    def gradients(self) -> Arrays:
        """Give copies of the gradients of the last `differentiate`, by name; of the motion the row of its timestep."""
        copies = {name: slope.copy() for name, slope in self._gradients.by_name.items()}
        if self._degree > 0:
            copies["sh_rest"] = self._gradients.by_harmonics(self._degree)
        return copies | {name: slope.copy() for name, slope in (self._motion | self._masks).items()}

    def weights(self, targets: Sequence[Target], degree: int) -> Float[np.ndarray, "n 2"]:  # noqa: ARG002 (no colour, no degree)
        """Give each Gaussian's blending weight summed over pixels of views of one timestep: plain, and by reference sensitivity."""
        return self._looker.weights(self.take(), targets)

    def removals(self, targets: Sequence[Target], degree: int) -> Float[np.ndarray, "n 4"]:
        """Give what views of one timestep change by where a Gaussian alone is removed: squared, absolute; plain and by sensitivity."""
        return self._looker.removals(self.take(), targets, degree)

    @property
    def triangle_scale(self) -> Float[np.ndarray, " f"]:
        """Metres a local unit, of each triangle, in the pose of the last `differentiate` that could pose."""
        return self._scale

    def _settle(self) -> None:
        """Let the Gaussians take the step that they would take when they are placed next."""
        step, self._step = self._step, None
        if step is not None:
            with self._time("Adam"):
                self._adam.take(self._state, step)

    def _find_gradients(self, targets: Sequence[Target], losses: dict[str, float]) -> tuple[str, int] | None:
        """Leave the gradients of the mean loss and the parts of that; give the parameter and the row of a fault."""
        state, timestep, gradients = self._state, self._timestep, self._gradients
        posing = self._rig.posing
        step, self._step = self._step, None
        self._drawer.place(state, timestep, posing, step or self._adam.prepare(state, {}, None), step is not None)
        gradients.begin(state, posing.pose, self._drawer.splats, len(targets))
        for target in targets:
            try:
                drawing = self._drawer.draw(target.camera, self._degree, target.box)
            except GeometryError:
                return "pose", timestep
            except ColourError as error:
                return "colour", error.row
            self._scale[:] = posing.pose.frames.scale
            found = self._judge(target, drawing, len(targets))
            half_way = self._rasteriser.backward_to_entries(drawing.frame, found.gradient)
            with self._time("gradients"):
                height, width = target.sensitivity.shape
                gradients.add_view(drawing.frame, half_way, self._drawer.tilts, drawing.centre, width, height)
            parts = {"total": found.total, "l1": found.l1, "ssim": found.ssim, "sensitivity": found.entropy}
            for name, value in parts.items():
                losses[name] = losses.get(name, 0.0) + value / len(targets)
        losses["position"], losses["scale"] = gradients.penalties
        losses["total"] += sum(gradients.penalties)
        if MASK_LOGIT in state.values:
            losses["mask"] = self._find_mask_gradient(state.values[MASK_LOGIT])
            losses["total"] += losses["mask"]
        if self._fine_tune:
            self._motion = self._rig.slopes(self._row(timestep))
        return self._cause(losses["total"])

    def _find_mask_gradient(self, mask_logit: Float[np.ndarray, " n"]) -> float:
        """Leave the gradient by the masks; give their penalty."""
        opacities, slopes = self._drawer.splats.opacities, self._gradients.by_name
        self._masks = {MASK_LOGIT: mask_gradient(mask_logit, opacities, slopes, self._mask_weight)}
        return mask_penalty(mask_logit, self._mask_weight)

    def _judge(self, target: Target, drawing: Drawing, views: int) -> ImageLosses:
        """Compare a drawing with its target; the gradient is of its share of the mean over so many views."""
        with self._time("loss"):
            found = self._compare(drawing.frame.image, target.image, target.sensitivity, drawing.box)
            if views > 1:
                np.multiply(found.gradient, np.float32(1 / views), out=found.gradient)
        return found

    def _cause(self, loss: float) -> tuple[str, int] | None:
        """Give what is not finite: an attribute and its first row, else a motion parameter, else the loss and their timestep."""
        if not self._gradients.sound():
            if (cause := self._gradients.fault()) is not None:
                return cause
            for name, slope in self._motion.items():
                if not (np.abs(slope) <= LARGEST_GRADIENT).all():
                    return name, self._timestep
        return None if math.isfinite(loss) else ("loss", self._timestep)

    def _row(self, timestep: int) -> Arrays:
        return {name: self._state.values[name][timestep] for name in FITTED_MOTION}

    def _time(self, stage: str) -> AbstractContextManager[None]:
        return timed(self.stopwatch, stage)
