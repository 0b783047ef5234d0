"""A training state in a pose, as a camera sees it."""

from __future__ import annotations

from collections.abc import Callable
from contextlib import AbstractContextManager
from dataclasses import dataclass

import numpy as np
from jaxtyping import Bool, Float, Int

from sacha_core.animation.kernels import frames as frame_kernels
from sacha_core.animation.kernels import posing as posing_kernels
from sacha_core.animation.posed import Posing, block_bounds, refuse_first
from sacha_core.parallel.buffers import Buffers
from sacha_core.parallel.kept import Kept, KeptOfEach
from sacha_core.parallel.kernels.packed import Packed
from sacha_core.parallel.kernels.turns import new_turns
from sacha_core.parallel.pool import Pool
from sacha_core.raster.bounds import pixel_box
from sacha_core.raster.camera import Camera
from sacha_core.raster.harmonics import ALL_DEGREES
from sacha_core.raster.rasteriser import NEAR, Frame, Rasteriser
from sacha_core.raster.splats import Splats
from sacha_core.raster.view import view_parameters
from sacha_core.train.kernels.place import BLOCK
from sacha_core.train.kernels.pose_and_place import PARTS, enclosed, pose_and_place
from sacha_core.train.masks import alive
from sacha_core.train.optimiser import GaussianStep
from sacha_core.train.state import FITTED_MOTION, MASK_LOGIT, TrainState
from sacha_core.train.views import Box

__all__ = ["Drawer", "Drawing"]

BACKGROUND = np.array([1, 1, 1, 0], np.float32)  # white, and not sensitive
CARRIED = ("position", "log_scale", "quaternion", "opacity_logit", "sensitivity_logit")  # as `carry_splats` wants them
NO_MASKS = np.zeros(0, np.float32)
FACE_JOBS = 16
CAMERAS = 4096  # whose parameters are kept
MARGIN = 10  # pixels: twice the reach of SSIM's window, so that nothing outside the crop sees what is inside


@dataclass(frozen=True)
class Placing:
    """Where a state's Gaussians go: the same as long as none comes or goes.

    Args:
        splats: in the world.
        tilts: see `Drawer`.
        faults: (b,) out: of each range of triangles the first degenerate one, or -1.
        sides: (c, 4) out: the box in the image that each range of Gaussians reaches.
        fine: (c,) out: whether all its colours can be drawn.
        fixed: what `pose_and_place` wants.
    """

    splats: Splats
    tilts: Float[np.ndarray, "3 n 3"]
    faults: Int[np.ndarray, " b"]
    sides: Float[np.ndarray, "c 4"]
    fine: Bool[np.ndarray, " c"]
    fixed: Packed


@dataclass(frozen=True)
class Drawing:
    """A picture of the avatar.

    Args:
        frame: the rasteriser's, of the crop.
        box: the crop: left, top, right, bottom.
        centre: (3,) float32, where the camera stands, metres.
    """

    frame: Frame
    box: Box
    centre: Float[np.ndarray, "3"]


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
        self._seen_from: KeptOfEach[tuple[np.ndarray, np.ndarray]] = KeptOfEach(CAMERAS)

    def place(self, state: TrainState, timestep: int, posing: Posing, step: GaussianStep, to_step: bool) -> None:
        """Let the next `draw` take a pose first, and carry the Gaussians along with the head.

        Args:
            state: whose Gaussians; without masks if there is a step to take.
            timestep: whose pose.
            posing: of the head.
            step: that the Gaussians take before, or one of the same state that they do not.
            to_step: whether they do.
        """
        values, pose = state.values, posing.pose
        own = tuple(values[name] for name in (*CARRIED, "sh_dc", "sh_rest", *FITTED_MOTION))
        self._placed = self._placing.of(lambda: self._begin(state, posing), pose, state.binding, *own)
        self.splats, self.tilts = self._placed.splats, self._placed.tilts
        self._timestep, self._posing, self._to_pose, self._step, self._to_step = timestep, posing, True, step, to_step
        self._factors = alive(values[MASK_LOGIT]).astype(np.float32) if MASK_LOGIT in values else NO_MASKS

    def _begin(self, state: TrainState, posing: Posing) -> Placing:
        n, values, pose, frames = len(state), state.values, posing.pose, posing.pose.frames
        widths = {"means": 3, "scales": 3, "quaternions": 4, "colours": 4}
        space = {name: self._buffers.space(name, n * c, np.float32).reshape(n, c) for name, c in widths.items()}
        splats = Splats(**space, opacities=self._buffers.space("opacities", n, np.float32))
        tilts = self._buffers.space("tilts", 9 * n, np.float32).reshape(3, n, 3)
        ranges = (
            np.array(block_bounds(len(pose.vertices), posing_kernels.BLOCK, len(pose.vertices))),
            np.array(block_bounds(len(frames.scale), frame_kernels.BLOCK, FACE_JOBS)),
            np.array(block_bounds(n, BLOCK, max(n, 1))),
        )
        jobs = len(ranges[2]) - 1
        left = np.full(len(ranges[1]) - 1, -1), np.empty((jobs, 4), np.float32), np.ones(jobs, bool)
        own = tuple(values[name].reshape(-1) for name in CARRIED)
        rest = (
            state.binding, frames.rotation.reshape(-1), frames.scale, frames.origin.reshape(-1), pose.quaternions.reshape(-1),
            splats.means.reshape(-1), splats.scales.reshape(-1), splats.quaternions.reshape(-1), splats.opacities,
            splats.colours.reshape(-1),
        )  # fmt: skip
        colouring = (values["sh_dc"], values["sh_rest"], splats.means), (ALL_DEGREES, splats.colours, tilts)
        reaching = splats.means, splats.scales, splats.opacities
        placing = np.zeros(1, np.int64), ranges, left, (own, rest), colouring, reaching
        parameters = tuple(values[name] for name in FITTED_MOTION), *posing.parameters
        return Placing(splats, tilts, *left, Packed(((parameters, *posing[2:]), placing)))

    def draw(self, camera: Camera, degree: int | None, box: Box) -> Drawing:
        """Draw what was placed.

        Args:
            camera: the whole image's.
            degree: of the spherical harmonics in use; None to draw all in black, where only weights are wanted.
            box: that must be drawn at least; the rest of the image is drawn as far as Gaussians reach.

        Raises:
            GeometryError: in the pose to be taken a triangle has zero area or a vertex that is not finite.
            ColourError: a colour is not finite.
        """
        splats, posing, placed = self.splats, self._posing, self._placed
        view, centre = self._seen_from.of(
            lambda: (view_parameters(camera, NEAR), np.asarray(camera.centre, np.float32)), camera
        )
        if degree is None:
            splats.colours[:, :3] = 0
        to_step, self._to_step = self._to_step, False  # whatever becomes of the drawing
        turns, refused = new_turns(PARTS), list[bool]()

        def work(_: int, __: int) -> None:
            sound = pose_and_place(
                turns, self._to_pose, self._timestep, placed.fixed.table, self._factors, centre, degree or 0, degree is not None, view,
                to_step, *self._step,
            )  # fmt: skip
            if not sound:
                refused.append(True)

        with self._time("Adam, pose, place and colour"):
            self._pool.run(work, self._pool.threads)
            if refused:
                refuse_first(posing.pose, posing.corners[1], placed.faults)
            self._to_pose = False
        reached = pixel_box([enclosed(placed.sides)] if len(placed.sides) else [], camera, MARGIN)
        crop = union(reached, box, camera)
        part = camera.crop(crop[0], crop[1], crop[2] - crop[0], crop[3] - crop[1])
        return Drawing(self._rasteriser.forward(splats, part, BACKGROUND, bool(placed.fine.all())), crop, centre)


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
