"""A training state in a pose, as a camera sees it."""

from __future__ import annotations

from collections.abc import Callable
from contextlib import AbstractContextManager
from dataclasses import dataclass

import numpy as np
from jaxtyping import Float

from sacha_core.animation.kernels.carry import BLOCK
from sacha_core.animation.posed import Pose, block_bounds
from sacha_core.parallel.buffers import Buffers
from sacha_core.parallel.kept import Kept
from sacha_core.parallel.pool import Pool
from sacha_core.raster.bounds import pixel_box
from sacha_core.raster.camera import Camera
from sacha_core.raster.harmonics import ALL_DEGREES
from sacha_core.raster.rasteriser import NEAR, Frame, Rasteriser
from sacha_core.raster.splats import Splats
from sacha_core.raster.view import view_parameters
from sacha_core.train.kernels.place import place
from sacha_core.train.masks import alive
from sacha_core.train.state import MASK_LOGIT, TrainState
from sacha_core.train.views import Box

__all__ = ["Drawer", "Drawing"]

BACKGROUND = np.array([1, 1, 1, 0], np.float32)  # white, and not sensitive
CARRIED = ("position", "log_scale", "quaternion", "opacity_logit", "sensitivity_logit")  # as `carry_splats` wants them
NO_MASKS = np.zeros(0, np.float32)
MARGIN = 10  # pixels: twice the reach of SSIM's window, so that nothing outside the crop sees what is inside


@dataclass(frozen=True)
class Placing:
    """Where a state's Gaussians go: the same as long as none comes or goes.

    Args:
        splats: in the world.
        tilts: see `Drawer`.
        bounds: of the ranges of Gaussians that jobs take.
        own: what `carry_splats` wants of the Gaussians, flat.
        rest: what it wants after the factors of their opacities.
    """

    splats: Splats
    tilts: Float[np.ndarray, "3 n 3"]
    bounds: list[int]
    own: tuple[np.ndarray, ...]
    rest: tuple[np.ndarray, ...]


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
        tilts: (3, n, 3) gradient of each colour by the mean, as the last `draw` saw it.
    """

    splats: Splats
    tilts: Float[np.ndarray, "3 n 3"]

    def __init__(self, rasteriser: Rasteriser, pool: Pool, time: Callable[[str], AbstractContextManager[None]]) -> None:
        self._rasteriser, self._pool, self._time, self._buffers = rasteriser, pool, time, Buffers()
        self._placing: Kept[Placing] = Kept()

    def place(self, state: TrainState, pose: Pose) -> None:
        """Let the next `draw` carry the Gaussians along with a posed head first."""
        values = state.values
        own = tuple(values[name] for name in CARRIED)
        placing = self._placing.of(lambda: self._begin(state, pose), pose, state.binding, *own)
        self.splats, self.tilts, self._bounds = placing.splats, placing.tilts, placing.bounds
        self._state, self._to_carry = state, True
        factors = alive(values[MASK_LOGIT]).astype(np.float32) if MASK_LOGIT in values else NO_MASKS
        self._carrying = (*placing.own, factors, *placing.rest)

    def _begin(self, state: TrainState, pose: Pose) -> Placing:
        n, values, frames = len(state), state.values, pose.frames
        widths = {"means": 3, "scales": 3, "quaternions": 4, "colours": 4}
        space = {name: self._buffers.space(name, n * c, np.float32).reshape(n, c) for name, c in widths.items()}
        splats = Splats(**space, opacities=self._buffers.space("opacities", n, np.float32))
        rest = (
            state.binding, frames.rotation.reshape(-1), frames.scale, frames.origin.reshape(-1), pose.quaternions.reshape(-1),
            splats.means.reshape(-1), splats.scales.reshape(-1), splats.quaternions.reshape(-1), splats.opacities,
            splats.colours.reshape(-1),
        )  # fmt: skip
        return Placing(
            splats=splats,
            tilts=self._buffers.space("tilts", 9 * n, np.float32).reshape(3, n, 3),
            bounds=block_bounds(n, BLOCK, self._pool.threads),
            own=tuple(values[name].reshape(-1) for name in CARRIED),
            rest=rest,
        )

    def draw(self, camera: Camera, degree: int | None, box: Box) -> Drawing:
        """Draw what was placed.

        Args:
            camera: the whole image's.
            degree: of the spherical harmonics in use; None to draw all in black, where only weights are wanted.
            box: that must be drawn at least; the rest of the image is drawn as far as Gaussians reach.

        Raises:
            ColourError: a colour is not finite.
        """
        splats, values, bounds, to_carry = self.splats, self._state.values, self._bounds, self._to_carry
        view, centre = view_parameters(camera, NEAR), np.asarray(camera.centre, np.float32)
        sides = [(0.0, 0.0, 0.0, 0.0)] * (len(bounds) - 1)
        colouring = (
            values["sh_dc"], values["sh_rest"], splats.means, centre, degree or 0, ALL_DEGREES, splats.colours, self.tilts
        )  # fmt: skip
        if degree is None:
            splats.colours[:, :3] = 0

        def job(_: int, k: int) -> None:
            sides[k] = place(
                bounds[k], bounds[k + 1], to_carry, self._carrying, colouring, degree is not None,
                splats.means, splats.scales, splats.opacities, view,
            )  # fmt: skip

        with self._time("place and colour"):
            self._pool.run(job, len(bounds) - 1)
            self._to_carry = False
        crop = union(pixel_box(sides, camera, MARGIN), box, camera)
        part = camera.crop(crop[0], crop[1], crop[2] - crop[0], crop[3] - crop[1])
        return Drawing(self._rasteriser.forward(splats, part, BACKGROUND), crop)


def union(reached: tuple[int, int, int, int] | None, box: Box, camera: Camera) -> Box:
    """Give what must be drawn: what Gaussians reach (left, top, width, height) and, with a margin, `box`; at least one pixel."""
    boxes = [] if reached is None else [(reached[0], reached[1], reached[0] + reached[2], reached[1] + reached[3])]
    if box[2] > box[0] and box[3] > box[1]:
        sides = max(box[0] - MARGIN, 0), max(box[1] - MARGIN, 0), box[2] + MARGIN, box[3] + MARGIN
        boxes.append((*sides[:2], min(sides[2], camera.width), min(sides[3], camera.height)))
    if not boxes:
        return (0, 0, 1, 1)
    lefts, tops, rights, bottoms = zip(*boxes, strict=True)
    return (min(lefts), min(tops), max(rights), max(bottoms))
