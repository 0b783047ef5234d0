"""One view forward and backward: from parameters to losses and the gradients of all that is fitted."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import torch
from jaxtyping import Bool, Float

from sacha_core.avatar.motion import Motion
from sacha_core.errors import GeometryError
from sacha_core.flame.model import HeadModel
from sacha_core.perception.image_loss import ImageLoss
from sacha_core.raster.camera import Camera
from sacha_core.raster.harmonics import sh_colours, sh_colours_backward
from sacha_core.raster.pool import Pool
from sacha_core.raster.rasteriser import NEAR, Frame, Rasteriser
from sacha_core.raster.splats import Splats
from sacha_core.train.binding import to_world, triangle_frames
from sacha_core.train.kernels.penalty import image_bounds, penalise
from sacha_core.train.options import LossOptions
from sacha_core.train.posing import DifferentiablePoser
from sacha_core.train.state import FITTED_MOTION, Arrays, TrainState
from sacha_core.train.views import Box, Target

__all__ = ["Drawing", "Outcome", "Stage"]

BACKGROUND = np.array([1, 1, 1, 0], np.float32)  # white, and not sensitive
MARGIN = 10  # pixels: twice the reach of SSIM's window, so that nothing outside the crop sees what is inside


@dataclass(frozen=True)
class Drawing:
    """The avatar in the pose of one timestep, and its picture.

    Args:
        frame: the rasteriser's, of the crop.
        box: the crop: left, top, right, bottom.
        triangle_scale: (f,) metres a local unit, of each triangle.
        world: means, scales and quaternions, for the way back.
        leaves: what they were made of, by name.
    """

    frame: Frame
    box: Box
    triangle_scale: Float[np.ndarray, " f"]
    world: tuple[torch.Tensor, ...]
    leaves: dict[str, torch.Tensor]


@dataclass(frozen=True)
class Outcome:
    """What one view says.

    Args:
        losses: weighted sum `total` and its parts, unweighted but for the penalties.
        gradients: of the Gaussians' attributes, by name.
        motion_gradients: (t, .) of motion parameters, zero but for the timestep of the view; none where motion is not fitted.
        visible: (n,) which Gaussians the view shows.
        image_gradient: (n,) length of the gradient by the mean's place in the image, in normalised device units.
    """

    losses: dict[str, float]
    gradients: Arrays
    motion_gradients: Arrays
    visible: Bool[np.ndarray, " n"]
    image_gradient: Float[np.ndarray, " n"]


class Stage:
    """Draws and judges; owns the rasteriser, the loss and their buffers.

    Args:
        head: the head model.
        motion: whose static parameters make the person.
        losses: weights.
        pool: shares out the work on pixels.
        fine_tune: whether motion gets gradients.
    """

    def __init__(
        self, head: HeadModel, motion: Motion, losses: LossOptions, pool: Pool, fine_tune: bool = True
    ) -> None:
        self._faces = np.ascontiguousarray(head.faces, np.int32)
        self._poser = DifferentiablePoser(head, motion)
        self._losses, self._fine_tune, self._pool = losses, fine_tune, pool
        self._rasteriser = Rasteriser(pool.threads)
        self._image_loss = ImageLoss(losses.l1, losses.ssim, losses.sensitivity, pool.run)
        self._motion_gradients: Arrays = {}

    def draw(
        self, state: TrainState, timestep: int, camera: Camera, degree: int, box: Box, learn: bool = True
    ) -> Drawing:
        """Draw the avatar.

        Args:
            state: its parameters.
            timestep: frame of the motion.
            camera: the whole image's.
            degree: of the spherical harmonics in use.
            box: that must be drawn at least; the rest of the image is drawn as far as Gaussians reach.
            learn: whether `judge` will follow.

        Raises:
            GeometryError: the pose makes a triangle degenerate; the message names both.
        """
        values = state.values
        local = {name: torch.from_numpy(values[name]) for name in ("position", "log_scale", "quaternion")}
        pose = {name: torch.from_numpy(values[name][timestep]) for name in FITTED_MOTION}
        leaves = {**local, **pose} if self._fine_tune else local
        for tensor in leaves.values():
            tensor.requires_grad_(learn)
        try:
            frames = triangle_frames(self._poser(**pose), self._faces)
        except GeometryError as error:
            raise GeometryError(f"timestep {timestep}: {error}") from error
        world = to_world(local["position"], local["log_scale"], local["quaternion"], state.binding, frames)
        made = (world.means, world.scales, world.quaternions)
        means, scales, quaternions = (tensor.detach().numpy() for tensor in made)
        opacities = sigmoid(values["opacity_logit"])
        colours = np.empty((len(state), 4), np.float32)
        centre = np.asarray(camera.centre, np.float32)
        colours[:, :3] = sh_colours(values["sh_dc"], values["sh_rest"], means, centre, degree, self._pool)
        colours[:, 3] = sigmoid(values["sensitivity_logit"])
        crop = self._crop(means, scales, opacities, camera, box)
        part = camera.crop(crop[0], crop[1], crop[2] - crop[0], crop[3] - crop[1])
        frame = self._rasteriser.forward(Splats(means, scales, quaternions, opacities, colours), part, BACKGROUND)
        return Drawing(frame, crop, frames.scale.detach().numpy(), made, leaves)

    def judge(self, state: TrainState, drawing: Drawing, target: Target, degree: int) -> Outcome:
        """Compare a drawing with its target and go back to the parameters.

        Args:
            state: as for `draw`.
            drawing: the last that `draw` made.
            target: of the same timestep and camera.
            degree: as for `draw`.
        """
        left, top, right, bottom = drawing.box
        height, width = target.sensitivity.shape
        wanted, sensitive = target.image[:, top:bottom, left:right], target.sensitivity[top:bottom, left:right]
        losses = self._image_loss(drawing.frame.image, wanted, sensitive, height * width)
        splats = drawing.frame.splats
        slopes = self._rasteriser.backward(drawing.frame, losses.gradient)
        sh = (state.values["sh_dc"], state.values["sh_rest"], splats.means)
        centre = np.asarray(drawing.frame.camera.centre, np.float32)
        d_dc, d_rest, d_means = sh_colours_backward(*sh, centre, degree, slopes.colours[:, :3], self._pool)
        incoming = (slopes.means + d_means, slopes.scales, slopes.quaternions)
        torch.autograd.backward(drawing.world, [torch.from_numpy(np.ascontiguousarray(g)) for g in incoming])
        gradients = {name: gradient_of(drawing.leaves[name]) for name in ("position", "log_scale", "quaternion")}
        sensitivity = splats.colours[:, 3]
        gradients |= {
            "opacity_logit": slopes.opacities * splats.opacities * (1 - splats.opacities),
            "sensitivity_logit": slopes.colours[:, 3] * sensitivity * (1 - sensitivity),
            "sh_dc": d_dc,
        }
        if degree > 0:
            gradients["sh_rest"] = d_rest
        visible = drawing.frame.visible
        strayed, swollen = self._penalise(state, visible, gradients)
        parts = {
            "l1": losses.l1,
            "ssim": losses.ssim,
            "sensitivity": losses.entropy,
            "position": strayed,
            "scale": swollen,
        }
        length = np.hypot(slopes.means_2d[:, 0] * (width / 2), slopes.means_2d[:, 1] * (height / 2))
        motion = self._motion_rows(state, drawing, target.timestep)
        return Outcome({"total": losses.total + strayed + swollen, **parts}, gradients, motion, visible, length)

    def weights(self, state: TrainState, target: Target, degree: int) -> Float[np.ndarray, "n 2"]:
        """Give each Gaussian's blending weight summed over the pixels of a view: plain, and weighted by reference sensitivity."""
        drawing = self.draw(state, target.timestep, target.camera, degree, target.box, learn=False)
        left, top, right, bottom = drawing.box
        sensitive = target.sensitivity[top:bottom, left:right] * np.float32(1 / 255)
        return self._rasteriser.colour_weights(drawing.frame, np.stack([np.ones_like(sensitive), sensitive]))

    def _crop(
        self,
        means: Float[np.ndarray, "n 3"],
        scales: Float[np.ndarray, "n 3"],
        opacities: Float[np.ndarray, " n"],
        camera: Camera,
        box: Box,
    ) -> Box:
        """Give what must be drawn: `box` and all that Gaussians touch, with a margin, inside the image; at least one pixel."""
        bounds = np.empty(4)
        pose = (np.asarray(camera.rotation, np.float64), np.asarray(camera.translation, np.float64))
        intrinsics = (float(camera.fx), float(camera.fy), float(camera.cx), float(camera.cy))
        image_bounds(means, scales, opacities, *pose, *intrinsics, NEAR, bounds)
        boxes = [b for b in (bounds.tolist(), box) if b[2] > b[0] and b[3] > b[1]]
        if not boxes:
            return (0, 0, 1, 1)
        left, top = (max(0.0, min(b[side] for b in boxes) - MARGIN) for side in (0, 1))
        right = min(camera.width, max(b[2] for b in boxes) + MARGIN)
        bottom = min(camera.height, max(b[3] for b in boxes) + MARGIN)
        if not (left < right and top < bottom):
            return (0, 0, 1, 1)
        return (int(left), int(top), int(np.ceil(right)), int(np.ceil(bottom)))

    def _penalise(self, state: TrainState, visible: Bool[np.ndarray, " n"], gradients: Arrays) -> tuple[float, float]:
        """Add the penalties' gradients, and give the penalties; none where nothing is visible."""
        count = max(int(np.count_nonzero(visible)), 1)
        options = self._losses
        numbers = (options.position / count, options.position_limit, options.scale / count, options.scale_limit)
        sums = np.zeros(2)
        attributes = (state.values["position"], state.values["log_scale"], visible)
        slopes = (gradients["position"], gradients["log_scale"])
        penalise(*attributes, *(np.float32(number) for number in numbers), *slopes, sums)
        return float(sums[0]), float(sums[1])

    def _motion_rows(self, state: TrainState, drawing: Drawing, timestep: int) -> Arrays:
        """Put the gradients of one timestep into arrays of all."""
        if not self._fine_tune:
            return {}
        if not self._motion_gradients:
            self._motion_gradients = {name: np.zeros_like(state.values[name]) for name in FITTED_MOTION}
        for name, rows in self._motion_gradients.items():
            rows[:] = 0
            rows[timestep] = gradient_of(drawing.leaves[name])
        return self._motion_gradients


def sigmoid(logit: Float[np.ndarray, " n"]) -> Float[np.ndarray, " n"]:
    """Logistic function through tanh, which does not overflow; keeps the dtype."""
    half = logit.dtype.type(0.5)
    value: np.ndarray = half + half * np.tanh(half * logit)
    return value


def gradient_of(leaf: torch.Tensor) -> Float[np.ndarray, "..."]:
    """Give the gradient that the backward pass left at a leaf, as an array; zero where it left none."""
    return np.zeros(leaf.shape, np.float32) if leaf.grad is None else leaf.grad.numpy()
