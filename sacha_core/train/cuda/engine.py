"""Training on a CUDA device: the loop's engine in torch and gsplat."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from contextlib import AbstractContextManager
from functools import partial

import numpy as np
import torch
from jaxtyping import Bool, Float
from torch import Tensor

from sacha_core.avatar.motion import Motion
from sacha_core.flame.model import HeadModel
from sacha_core.parallel.pool import Pool
from sacha_core.raster.rasteriser import Rasteriser
from sacha_core.stopwatch import Stopwatch
from sacha_core.train.cuda.clock import DeviceClock
from sacha_core.train.cuda.drawing import Drawer, Drawing, Gsplat, World, load_gsplat
from sacha_core.train.cuda.graphs import Recorder
from sacha_core.train.cuda.image_loss import DeviceImageLoss
from sacha_core.train.cuda.layout import NAMES
from sacha_core.train.cuda.offered import require_offered
from sacha_core.train.cuda.penalties import penalise
from sacha_core.train.cuda.scene import Scene
from sacha_core.train.cuda.state import DeviceState
from sacha_core.train.cuda.statistics import gradient_lengths
from sacha_core.train.cuda.targets import DeviceTargets, TargetBatch, upload
from sacha_core.train.looking import Looker
from sacha_core.train.options import TrainOptions
from sacha_core.train.rig import Rig
from sacha_core.train.state import ATTRIBUTES, FITTED_MOTION, Arrays, TrainState
from sacha_core.train.views import Target

__all__ = ["CudaEngine"]

LOSSES = ("total", "l1", "ssim", "sensitivity", "position", "scale")
TARGETS_SHARE = 0.5  # of the device's free memory that targets may fill


class CudaEngine:
    """Trains on a device; `sacha_core.train.engine.Engine` says what each method is for.

    An iteration queues its work and goes on; only drawing waits, for how long the lists of tiles are. The order of atomic additions makes
    two runs differ in their last digits.

    Args:
        head: the head model.
        motion: whose static parameters make the person.
        options: of the run.
        device: where to compute; one without CUDA wants a stand-in for gsplat.
        gsplat: draws; None for gsplat itself.
        graphs: whether to launch stages between drawing as recorded CUDA graphs.

    Attributes:
        stopwatch: told how long each stage takes on the device; None for nobody.

    Raises:
        HeadError: the motion has components or vertex offsets that the head lacks.
        OptionError: an option is for the CPU alone.
    """

    def __init__(
        self,
        head: HeadModel,
        motion: Motion,
        options: TrainOptions,
        device: str = "cuda",
        gsplat: Gsplat | None = None,
        graphs: bool = False,
    ) -> None:
        require_offered(options)
        torch.set_float32_matmul_precision("highest")  # products are small here, and their digits matter
        self.stopwatch: Stopwatch | None = None
        self._device = torch.device(device)
        self._options, self._fine_tune = options.losses, options.fine_tune
        self._absolute = options.density.gradient == "absolute"
        self._scene = Scene(head, motion, self._device)
        self._drawer = Drawer(gsplat or load_gsplat(), self._device)
        self._image_loss = DeviceImageLoss(options.losses, self._device)
        self._targets = DeviceTargets(self._device, room_for_targets(self._device))
        self._clock, self._record = DeviceClock(self._device), Recorder(graphs)
        self._made_of, self._threads = (head, motion), options.threads
        self._looker: Looker | None = None
        self._host: TrainState | None = None
        self._state: DeviceState  # as soon as there is a host's
        self._degree, self._moment = 0, torch.zeros(2, dtype=torch.int64, device=self._device)
        self._sound: Bool[Tensor, ""] = torch.zeros((), dtype=torch.bool, device=self._device)
        # steps without fault and their losses
        self._summed = torch.zeros(1 + len(LOSSES), dtype=torch.float64, device=self._device)
        self._triangle_scale: Float[Tensor, " f"] = torch.zeros(head.n_faces, device=self._device)

    def put(self, state: TrainState) -> None:
        """Go on from a state. Gradients kept stay good; those of Gaussians do not where their number has changed."""
        if self._host is not None and self._state.fits(state):
            self._state.set(state)
        else:
            fresh = DeviceState(state, self._device)
            if self._host is not None:
                fresh.inherit(self._state)
            self._state = fresh
            self._record.forget()
        self._host = state

    def take(self) -> TrainState:
        """Give the state as it is now; waits for the device.

        Raises:
            ValueError: none was put.
        """
        if self._host is None:
            raise ValueError("there is no state to take, expected one to be put first")
        self._state.get(self._host)
        return self._host

    def differentiate(self, iteration: int, targets: Sequence[Target], degree: int) -> None:
        """Draw some views of one timestep, compare, and keep the gradients of the mean loss; adds to statistics and losses."""
        self._degree, timestep = degree, targets[0].timestep
        self._moment[0].fill_(iteration)
        self._moment[1].fill_(timestep)
        batches = self._targets.batches(targets)
        leaves = self._leaves(timestep)
        with self._stage("posing"):
            centres = torch.cat([batch.cameras.centres for batch in batches])
            *splats, colours, scale, posed = self._record(
                "posing", self._place, *leaves, centres, key=degree, learns=True
            )
        drawings, slopes, parts = [], [], []
        for batch, seen in zip(batches, colours.split_with_sizes([len(batch) for batch in batches]), strict=True):
            with self._stage("drawing"):
                drawings.append(self._drawer.draw(World(*splats), seen, batch.cameras, self._absolute))
            with self._stage("loss"), torch.no_grad():
                images = (drawings[-1].image, batch.image, batch.sensitivity)
                found = self._record("loss", self._image_loss, *images)
                if len(batches) > 1:  # each counts by its views
                    found = tuple(one * (len(batch) / len(targets)) for one in found)
                parts.append(found[0])
                slopes.append(found[1])
        with self._stage("backward"):
            wanted = [leaf for leaf in leaves if leaf.requires_grad] + [one.means_2d for one in drawings]
            gradients = torch.autograd.grad([one.image for one in drawings], wanted, slopes, materialize_grads=True)
        with self._stage("statistics"), torch.no_grad():
            visible = torch.cat([drawing.visible for drawing in drawings])
            lengths = self._lengths(drawings, batches, gradients[-len(drawings) :], len(targets))
            facts = (torch.stack(parts).sum(0), visible, lengths, colours, scale, posed)
            (self._sound,) = self._record("statistics", self._account, *facts, *gradients[: -len(drawings)])

    def advance(self, rates: Mapping[str, float], void: frozenset[str]) -> None:
        """Let Adam step with the gradients kept, unless the last `differentiate` found a fault."""
        moving = {*ATTRIBUTES, *(("motion",) if self._fine_tune else ())} - void
        step = partial(self._step, frozenset(moving if self._degree > 0 else moving - {"sh_rest"}))
        by_name = upload(np.array([rates[name] for name in NAMES]), self._device)
        with self._stage("Adam"), torch.no_grad():
            self._record("Adam", step, by_name, self._sound, key=step.args)

    def losses(self) -> dict[str, float]:
        """Give the mean losses of the iterations without fault since the last call; waits for the device."""
        steps, *sums = self._summed.tolist()
        self._summed.zero_()
        self._clock.settle(self.stopwatch)
        return {name: total / steps for name, total in zip(LOSSES, sums, strict=True)} if steps else {}

    def gradients(self) -> Arrays:
        """Give copies of the gradients of the last `differentiate`, of the motion the row of its timestep; waits for the device."""
        kept, timestep = self._state.gradients, int(self._moment[1])
        found = {name: kept[name] for name in ATTRIBUTES if name != "sh_rest" or self._degree > 0}
        if self._fine_tune:
            found |= {name: kept[name][timestep] for name in FITTED_MOTION}
        return {name: gradient.clone().cpu().numpy() for name, gradient in found.items()}

    def weights(self, targets: Sequence[Target], degree: int) -> Float[np.ndarray, "n 2"]:  # noqa: ARG002 (weights have no colour)
        """Give each Gaussian's blending weight summed over pixels of views of one timestep: plain, and by reference sensitivity."""
        summed = torch.zeros(len(self._state.binding), 2, dtype=torch.float64, device=self._device)
        with torch.no_grad():
            row = self._state.motion[targets[0].timestep]
            world, _, posed = self._scene.place(self._state.values, row, self._state.binding)
            for batch in self._targets.batches(targets):
                sensitive = batch.sensitivity * (1 / 255)
                pixels = torch.stack([torch.ones_like(sensitive), sensitive], 3)
                summed += self._drawer.weights(world, pixels, batch.cameras)
            found: np.ndarray = torch.where(posed, summed, 0).cpu().numpy()
        return found

    def removals(self, targets: Sequence[Target], degree: int) -> Float[np.ndarray, "n 4"]:
        """Give what views of one timestep change by where a Gaussian alone is removed: squared, absolute; plain and by sensitivity.

        Drawn on the CPU, since gsplat has no such pass: it is wanted a few times a run. Waits for the device.
        """
        return self._on_host().removals(self.take(), targets, degree)

    @property
    def triangle_scale(self) -> Float[np.ndarray, " f"]:
        """Metres a local unit, of each triangle, in the pose of the last `differentiate` that could pose; waits for the device."""
        scale: np.ndarray = self._triangle_scale.clone().cpu().numpy()
        return scale

    def _on_host(self) -> Looker:
        """Give what looks at the host's state, made when it is first wanted."""
        if self._looker is None:
            pool = Pool(self._threads)
            self._looker = Looker(Rig(*self._made_of, pool), Rasteriser(pool=pool), pool, self._stage)
        return self._looker

    def _stage(self, name: str) -> AbstractContextManager[None]:
        return self._clock(self.stopwatch, name)

    def _leaves(self, timestep: int) -> list[Tensor]:
        """Give the attributes and the motion's row of a timestep, as leaves that gradients are wanted of."""
        attributes = [self._state.values[name].detach().requires_grad_() for name in ATTRIBUTES]
        return [*attributes, self._state.motion[timestep].detach().requires_grad_(self._fine_tune)]

    def _place(self, *tensors: Tensor) -> tuple[Tensor, ...]:
        """From leaves and the cameras' centres to what is drawn, triangles' scale, and whether every triangle has an area."""
        *attributes, row, centres = tensors
        values = dict(zip(ATTRIBUTES, attributes, strict=True))
        world, scale, posed = self._scene.place(values, row, self._state.binding)
        colours = self._scene.colours(values, world.means, centres, self._degree)
        return world.means, world.scales, world.quaternions, world.opacities, colours, scale, posed

    def _lengths(
        self, drawings: Sequence[Drawing], batches: Sequence[TargetBatch], gradients: Sequence[Tensor], views: int
    ) -> Float[Tensor, " n"]:
        """Give what the statistics of growth get of each Gaussian."""
        lengths = []
        for drawing, batch, gradient in zip(drawings, batches, gradients, strict=True):
            slope: Tensor = drawing.means_2d.absgrad if self._absolute else gradient  # type: ignore[attr-defined]
            lengths.append(gradient_lengths(slope, batch.cameras.width, batch.cameras.height, views))
        return torch.stack(lengths).sum(0)

    def _account(
        self,
        parts: Float[Tensor, "4"],
        visible: Bool[Tensor, "c n"],
        lengths: Float[Tensor, " n"],
        colours: Float[Tensor, "c n 4"],
        scale: Float[Tensor, " f"],
        posed: Bool[Tensor, ""],
        *gradients: Tensor,
    ) -> tuple[Bool[Tensor, ""]]:
        """Keep the gradients with those of the penalties, look for faults, and where there is none add to losses and statistics."""
        state, kept = self._state, self._state.gradients
        state.flat_gradient.zero_()
        torch._foreach_copy_([kept[name] for name in ATTRIBUTES], gradients[: len(ATTRIBUTES)])
        if self._fine_tune:
            state.motion_gradient.index_copy_(0, self._moment[1:], gradients[-1][None])
        local = (state.values["position"], state.values["log_scale"])
        penalties = penalise(*local, visible, self._options, kept["position"], kept["log_scale"])
        total = parts[0] + penalties.sum()
        sound = state.faults.note(self._moment, posed, colours, state.flat_gradient, total)
        losses = torch.cat([torch.ones_like(parts[:1]), total[None], parts[1:], penalties])
        self._summed += torch.where(sound, losses, 0)
        self._triangle_scale.copy_(torch.where(posed, scale, self._triangle_scale))
        state.count(lengths, visible.sum(0), sound)
        return (sound,)

    def _step(self, moving: frozenset[str], rates: Float[Tensor, " k"], sound: Bool[Tensor, ""]) -> tuple[()]:
        """Let Adam step with some attributes, and with the motion."""
        state = self._state
        state.adam.step(state.flat_values, state.flat_gradient, rates, sound, moving)
        return ()


def room_for_targets(device: torch.device) -> int:
    """Give how many bytes of a device targets may fill; on the CPU, where they are already, none."""
    return int(TARGETS_SHARE * torch.cuda.mem_get_info(device)[0]) if device.type == "cuda" else 0
