"""An avatar's Gaussians as they are to be drawn in a pose: what does not change is made once, what changes into the same memory."""

from __future__ import annotations

import math

import numpy as np
from jaxtyping import Float

from sacha_core.animation.carry import room_for
from sacha_core.animation.kernels.carry import BLOCK
from sacha_core.animation.kernels.carry import carry as carry_range
from sacha_core.animation.kernels.view_change import largest_turn
from sacha_core.animation.posed import PosedHead, block_bounds
from sacha_core.avatar.binding import sigmoid
from sacha_core.avatar.gaussians import Gaussians
from sacha_core.errors import OptionError
from sacha_core.flame.model import HeadModel
from sacha_core.flame.posing import HeadMotion
from sacha_core.parallel.pool import Pool
from sacha_core.raster.bounds import pixel_box
from sacha_core.raster.camera import Camera
from sacha_core.raster.harmonics import NO_TILTS, degrees_in_use
from sacha_core.raster.kernels.bounds import reach
from sacha_core.raster.kernels.harmonics import harmonic_colours
from sacha_core.raster.kernels.layout import ALPHA_MIN
from sacha_core.raster.splats import Splats
from sacha_core.raster.view import view_parameters
from sacha_core.stopwatch import Stopwatch, timed

__all__ = ["Figure"]

Box = tuple[int, int, int, int]


class Figure:
    """Poses an avatar and gives what a rasteriser draws.

    Gaussians that are too faint for any pixel are left out; the picture is the same to the bit.

    Args:
        gaussians: n canonical Gaussians.
        head: the head that they are bound to.
        motion: whose static parameters make the person.
        pool: shares out the work.
        degree: highest degree of the harmonics to use; None for all there are.
        colours: (n, 3) to draw instead of the Gaussians' own.
        turn_tolerance_rad: colours are used again until the view of some triangle has turned by more than this.
        stopwatch: told of `pose` and of `carry, colour and bound`.

    Raises:
        HeadError: the motion has components or vertex offsets that the head lacks.
        OptionError: the Gaussians have no harmonics of that degree, or there is not one colour for each of them.
    """

    def __init__(
        self,
        gaussians: Gaussians,
        head: HeadModel,
        motion: HeadMotion,
        pool: Pool,
        degree: int | None = None,
        colours: Float[np.ndarray, "n 3"] | None = None,
        turn_tolerance_rad: float = 0.0,
        stopwatch: Stopwatch | None = None,
    ) -> None:
        if colours is not None and colours.shape != (len(gaussians), 3):
            raise OptionError(f"colours have shape {colours.shape}, expected {(len(gaussians), 3)}")
        if degree is not None and not 0 <= degree <= gaussians.sh_degree:
            raise OptionError(f"harmonics of degree {degree} were asked for, expected 0 to {gaussians.sh_degree}")
        gaussians.validate(head.n_faces)
        opacities = sigmoid(gaussians.opacity_logit)
        shown = np.flatnonzero(opacities >= ALPHA_MIN)
        self._pool, self._posed, self._watch = pool, PosedHead(head, motion, pool), stopwatch
        self._gaussians = gaussians = gaussians.select(shown)
        self._opacities = opacities[shown]
        with np.errstate(over="ignore"):  # a Gaussian without end is culled when it is drawn
            self._scale = np.exp(gaussians.log_scale)
        self._degree = gaussians.sh_degree if degree is None else degree
        self._degrees = degrees_in_use(
            gaussians.sh_rest
        )  # most coefficients of a small file are zero, and cost nothing
        self._bounds = block_bounds(len(gaussians), BLOCK, pool.threads)
        self._world = room_for(len(gaussians))
        self._given = colours is not None
        self._colours = np.zeros((len(gaussians), 3), np.float32)
        if colours is not None:
            self._colours[:] = colours[shown]
        self._turn_tolerance = turn_tolerance_rad
        self._coloured_from: tuple[np.ndarray, np.ndarray] | None = (
            None  # origins of triangles and centre of the camera
        )
        self._to_carry = self._to_colour = False  # whether the pose is new to the Gaussians and to their colours

    def __len__(self) -> int:
        """Give the number of Gaussians that can be seen at all."""
        return len(self._gaussians)

    def pose(
        self,
        expression: Float[np.ndarray, " e"],
        vectors: Float[np.ndarray, "5 3"],
        translation: Float[np.ndarray, "3"],
    ) -> None:
        """Take a pose; arguments as of `PosedHead.pose`.

        Raises:
            GeometryError: it makes a triangle degenerate.
        """
        with timed(self._watch, "pose"):
            self._pose = self._posed.pose(expression, vectors, translation)
        self._to_carry = self._to_colour = True

    def seen_by(self, camera: Camera, near: float) -> tuple[Splats, Box | None]:
        """Give what to draw of the last pose, and in which part of the image.

        Gaussians are carried, coloured and bounded range by range, while they are in the cache, and only as far as something has changed.

        Args:
            camera: from where.
            near: what is closer to the camera's plane is not drawn, metres.

        Returns:
            Gaussians, whose arrays hold until the next pose, and left, top, width and height; None where nothing is to be seen.

        Raises:
            OptionError: the camera is unusable.
        """
        view = view_parameters(camera, near)
        centre = np.asarray(camera.centre, np.float32)
        bounds, sides = self._bounds, dict[int, tuple[float, float, float, float]]()
        colouring = self._colours_are_stale(centre)

        def job(_: int, k: int) -> None:
            start, stop = bounds[k], bounds[k + 1]
            if self._to_carry:
                self._carry(start, stop)
            if colouring:
                self._colour(start, stop, centre)
            sides[k] = reach(start, stop, self._world[0], self._world[1], self._opacities, view)

        if colouring:
            self._coloured_from = None  # until all are, whatever interrupts
        with timed(self._watch, "carry, colour and bound"):
            self._pool.run(job, len(bounds) - 1)
        self._to_carry = self._to_colour = False
        if colouring:
            self._coloured_from = self._pose.frames.origin.copy(), centre
        return Splats(*self._world, self._opacities, self._colours), pixel_box(sides.values(), camera)

    def _carry(self, start: int, stop: int) -> None:
        gaussians, frames = self._gaussians, self._pose.frames
        carry_range(
            start, stop, gaussians.position, self._scale, gaussians.quaternion, gaussians.binding,
            frames.rotation, frames.scale, frames.origin, self._pose.quaternions, *self._world,
        )  # fmt: skip

    def _colour(self, start: int, stop: int, centre: Float[np.ndarray, "3"]) -> None:
        gaussians = self._gaussians
        harmonic_colours(
            start, stop, gaussians.sh_dc, gaussians.sh_rest, self._world[0], centre, self._degree, self._degrees,
            self._colours, NO_TILTS,
        )  # fmt: skip

    def _colours_are_stale(self, centre: Float[np.ndarray, "3"]) -> bool:
        """Tell whether colours have to be made for a view from `centre`."""
        if self._given or self._coloured_from is None or self._degree == 0:
            return not self._given and self._coloured_from is None
        if not self._to_colour and np.array_equal(centre, self._coloured_from[1]):
            return False
        if self._turn_tolerance == 0:
            return True
        turn = largest_turn(self._pose.frames.origin, centre, *self._coloured_from)
        return math.sqrt(turn) > self._turn_tolerance
