"""A training state in a pose, as a camera sees it."""

from __future__ import annotations

from collections.abc import Callable
from contextlib import AbstractContextManager
from dataclasses import dataclass

import numpy as np

from sacha_core.animation.kernels.carry import BLOCK, carry
from sacha_core.animation.posed import Pose, block_bounds
from sacha_core.avatar.binding import sigmoid
from sacha_core.raster.buffers import Buffers
from sacha_core.raster.camera import Camera
from sacha_core.raster.harmonics import sh_colours
from sacha_core.raster.pool import Pool
from sacha_core.raster.rasteriser import NEAR, Frame, Rasteriser
from sacha_core.raster.splats import Splats
from sacha_core.train.kernels.penalty import image_bounds
from sacha_core.train.state import TrainState
from sacha_core.train.views import Box

__all__ = ["Drawer", "Drawing"]

BACKGROUND = np.array([1, 1, 1, 0], np.float32)  # white, and not sensitive
MARGIN = 10  # pixels: twice the reach of SSIM's window, so that nothing outside the crop sees what is inside


@dataclass(frozen=True)
class Drawing:
    """A picture of the avatar.

    Args:
        frame: the rasteriser's, of the crop.
        box: the crop: left, top, right, bottom.
    """

    frame: Frame
    box: Box


class Drawer:
    """Places a state's Gaussians in the world and draws them; owns what they become there.

    Args:
        rasteriser: draws.
        pool: shares out the work.
        time: measures a stage.

    Attributes:
        splats: what was placed; holds until the next `place`.
    """

    splats: Splats

    def __init__(self, rasteriser: Rasteriser, pool: Pool, time: Callable[[str], AbstractContextManager[None]]) -> None:
        self._rasteriser, self._pool, self._time, self._buffers = rasteriser, pool, time, Buffers()

    def place(self, state: TrainState, pose: Pose) -> None:
        """Carry the Gaussians along with a posed head."""
        n, values = len(state), state.values
        widths = {"means": 3, "scales": 3, "quaternions": 4, "colours": 4}
        space = {name: self._buffers.space(name, n * c, np.float32).reshape(n, c) for name, c in widths.items()}
        self.splats = Splats(**space, opacities=self._buffers.space("opacities", n, np.float32))
        splats, frames = self.splats, pose.frames
        bounds = block_bounds(n, BLOCK, self._pool.threads)

        def job(_: int, k: int) -> None:
            rows = slice(bounds[k], bounds[k + 1])
            with np.errstate(over="ignore"):  # a Gaussian without end is culled when it is drawn
                np.exp(values["log_scale"][rows], out=splats.scales[rows])
            carry(
                rows.start, rows.stop, values["position"], splats.scales, values["quaternion"], state.binding,
                frames.rotation, frames.scale, frames.origin, pose.quaternions, splats.means, splats.scales, splats.quaternions,
            )  # fmt: skip
            splats.opacities[rows] = sigmoid(values["opacity_logit"][rows])
            splats.colours[rows, 3] = sigmoid(values["sensitivity_logit"][rows])

        with self._time("carry"):
            self._pool.run(job, len(bounds) - 1)

    def draw(self, state: TrainState, camera: Camera, degree: int, box: Box) -> Drawing:
        """Draw what was placed.

        Args:
            state: the same.
            camera: the whole image's.
            degree: of the spherical harmonics in use.
            box: that must be drawn at least; the rest of the image is drawn as far as Gaussians reach.

        Raises:
            SachaError: a colour is not finite.
        """
        splats = self.splats
        centre = np.asarray(camera.centre, np.float32)
        with self._time("colour"):
            splats.colours[:, :3] = sh_colours(
                state.values["sh_dc"], state.values["sh_rest"], splats.means, centre, degree, self._pool
            )
            crop = self._crop(camera, box)
        part = camera.crop(crop[0], crop[1], crop[2] - crop[0], crop[3] - crop[1])
        return Drawing(self._rasteriser.forward(splats, part, BACKGROUND), crop)

    def _crop(self, camera: Camera, box: Box) -> Box:
        """Give what must be drawn: `box` and all that Gaussians touch, with a margin, inside the image; at least one pixel."""
        bounds = np.empty(4)
        splats = self.splats
        pose = (np.asarray(camera.rotation, np.float64), np.asarray(camera.translation, np.float64))
        intrinsics = (float(camera.fx), float(camera.fy), float(camera.cx), float(camera.cy))
        image_bounds(splats.means, splats.scales, splats.opacities, *pose, *intrinsics, NEAR, bounds)
        boxes = [b for b in (bounds.tolist(), box) if b[2] > b[0] and b[3] > b[1]]
        if not boxes:
            return (0, 0, 1, 1)
        left, top = (max(0.0, min(b[side] for b in boxes) - MARGIN) for side in (0, 1))
        right = min(camera.width, max(b[2] for b in boxes) + MARGIN)
        bottom = min(camera.height, max(b[3] for b in boxes) + MARGIN)
        if not (left < right and top < bottom):
            return (0, 0, 1, 1)
        return (int(left), int(top), int(np.ceil(right)), int(np.ceil(bottom)))
