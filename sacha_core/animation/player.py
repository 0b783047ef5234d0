"""Plays an avatar: any frame from any camera, as fast as two cores draw."""

from __future__ import annotations

import math
from dataclasses import dataclass
from types import TracebackType

import numpy as np
from jaxtyping import Float

from sacha_core.animation.canvas import Canvas
from sacha_core.animation.figure import Figure
from sacha_core.animation.source import GroupsAhead, InMemory, MotionSource
from sacha_core.avatar.gaussians import Gaussians
from sacha_core.avatar.motion import Motion
from sacha_core.codec import embedded_head, inspect, open_stream
from sacha_core.codec.decoder import Source, read_source
from sacha_core.errors import GeometryError, OptionError
from sacha_core.flame.model import HeadModel
from sacha_core.flame.posing import fit_components
from sacha_core.flame.shelf import find_head
from sacha_core.parallel.pool import Pool
from sacha_core.raster.camera import Camera
from sacha_core.raster.rasteriser import Rasteriser
from sacha_core.stopwatch import Stopwatch, timed

__all__ = ["PlayOptions", "Player"]

CAMERA_NUMBERS = ("width", "height", "fx", "fy", "cx", "cy", "whole_view")


@dataclass(frozen=True)
class PlayOptions:
    """How an avatar is drawn.

    Args:
        threads: how many; None for one on each processor.
        dtype: of the pictures: uint8, 0 to 255, as screens and videos want it; or float32, as blended.
        background: of all channels, or (3,) of each.
        sh_degree: highest degree of the harmonics to use; None for all there are.
        crop: draw only the part of the picture that the avatar covers; the picture is the same.
        colour_turn_deg: colours that depend on the view are used again until a view has turned by more than this. 0 is exact; 0.5 cannot be
            seen.
    """

    threads: int | None = None
    dtype: type[np.uint8] | type[np.float32] = np.uint8
    background: float | Float[np.ndarray, "3"] = 1.0
    sh_degree: int | None = None
    crop: bool = True
    colour_turn_deg: float = 0.0


class Player:
    """Draws the frames of an avatar's motion, in any order, from any camera; computes nothing again that has not changed.

    Frames of the motion are decoded ahead on a thread, which `close` (or the end of a `with` block) ends. One call at a time.

    Args:
        gaussians: the canonical Gaussians.
        head: the head that they are bound to.
        motion: what it does, in groups or whole; None for the head at rest.
        options: how it is drawn.
        colours: (n, 3) to draw instead of the Gaussians' own.
        stopwatch: told of the stages of a frame.

    Raises:
        FormatError: a Gaussian is not finite, or bound to a triangle that the head lacks.
        HeadError: the motion has components or vertex offsets that the head lacks.
        OptionError: an option makes no sense.
    """

    def __init__(
        self,
        gaussians: Gaussians,
        head: HeadModel,
        motion: MotionSource | Motion | None = None,
        options: PlayOptions | None = None,
        colours: Float[np.ndarray, "n 3"] | None = None,
        stopwatch: Stopwatch | None = None,
    ) -> None:
        options = options or PlayOptions()
        if motion is None:
            motion = Motion.rest(head.shapedirs.shape[2], head.exprdirs.shape[2])
        self.motion: MotionSource = InMemory(motion) if isinstance(motion, Motion) else motion
        self._options = options
        self._pool = Pool(options.threads)
        self._rasteriser = Rasteriser(pool=self._pool, stopwatch=stopwatch)
        self._background = background = np.asarray(options.background, np.float32)
        if background.ndim == 0:
            self._background = np.repeat(background, 3)
        self._canvas = Canvas(self._background, options.dtype, self._pool)
        turn, self._watch = math.radians(options.colour_turn_deg), stopwatch
        if not turn >= 0:  # true for NaN, too
            raise OptionError(f"colours may turn by {options.colour_turn_deg} degrees, expected 0 or more")
        still = self.motion.still()
        self._figure = Figure(gaussians, head, still, self._pool, options.sh_degree, colours, turn, stopwatch)
        self._posed: bytes | None = None  # parameters of the pose that the figure has
        self._seen: tuple[object, ...] | None = None  # camera of the last picture
        self._picture = np.empty((0, 0, 3), options.dtype)
        self._head, self._group = head, still  # a group of the motion that the head was found to fit
        self._groups = GroupsAhead(self.motion)

    @classmethod
    def open(
        cls,
        source: Source,
        head: HeadModel | None = None,
        options: PlayOptions | None = None,
        stopwatch: Stopwatch | None = None,
    ) -> Player:
        """Open a `.sacha` file; its motion is decoded while it plays, so opening takes as long for a short one as for a long one.

        Args:
            source: the bytes of the file, or its path.
            head: the head that it is bound to; by default the one inside the file, else one that was used before.
            options: how it is drawn.
            stopwatch: told of the stages of a frame.

        Raises:
            FormatError: the file is damaged.
            HeadError: the head is another one or not to be found.
            OSError: the file cannot be read.
        """
        data = read_source(source)
        if head is None:
            head = find_head(inspect(data).head, None, embedded_head(data))
        stream = open_stream(data, head=head)
        return cls(stream.gaussians, head, stream.motion, options, stopwatch=stopwatch)

    def __len__(self) -> int:
        """Give the number of frames."""
        return len(self.motion)

    @property
    def frame_rate(self) -> float:
        """Frames a second."""
        return self.motion.frame_rate

    def seek(self, index: int) -> None:
        """Have the parameters of a frame at hand, so that the frame itself comes sooner.

        Raises:
            OptionError: the motion has no such frame.
            FormatError: its group is damaged.
        """
        self._groups.frame(index)

    def frame(self, index: int, camera: Camera) -> np.ndarray:
        """Draw one frame.

        Args:
            index: of the frame, from 0.
            camera: from where, and how large.

        Returns:
            (h, w, 3) picture, not to be written to, which holds until the call after the next. The same object again where neither the pose
            nor the camera has changed since the last call.

        Raises:
            OptionError: the motion has no such frame, or the camera is unusable.
            FormatError: the frame's group of the motion is damaged.
            HeadError: the group uses expression components that the head lacks.
            GeometryError: the pose makes a triangle degenerate.
        """
        posed_anew = self._pose(index)
        view = _identity(camera)
        if posed_anew or view != self._seen:
            self._seen = None
            self._picture = self._draw(camera)
            self._seen = view
        return self._picture

    def close(self) -> None:
        """End the thread that decodes ahead; no frame can be drawn afterwards."""
        self._groups.close()

    def __enter__(self) -> Player:
        """Give the player."""
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        """Close it."""
        self.close()

    def _pose(self, index: int) -> bool:
        """Take the pose of a frame; tell whether that is another than the figure had."""
        with timed(self._watch, "motion"):
            motion, row = self._groups.frame(index)
        if motion is not self._group:
            fit_components(motion.expression, self._head.exprdirs.shape[2], "expression", self._head)
            self._group = motion
        expression, translation = motion.expression[row], motion.translation[row]
        vectors = np.concatenate([motion.rotation[row], motion.neck[row], motion.jaw[row], motion.eyes[row]])
        parameters = b"".join((expression.tobytes(), vectors.tobytes(), translation.tobytes()))
        if parameters == self._posed:
            return False
        self._posed = None
        try:
            self._figure.pose(expression, vectors.reshape(5, 3), translation)
        except GeometryError as error:
            raise GeometryError(f"frame {index}: {error}") from error
        self._posed = parameters
        return True

    def _draw(self, camera: Camera) -> np.ndarray:
        splats, box = self._figure.seen_by(camera, self._rasteriser.near)
        if not self._options.crop:
            box = 0, 0, camera.width, camera.height
        if box is None:
            return self._canvas.show(np.empty((3, 0, 0), np.float32), 0, 0, camera.width, camera.height)
        frame = self._rasteriser.forward(splats, camera.crop(*box), self._background)
        with timed(self._watch, "picture"):
            return self._canvas.show(frame.image, box[0], box[1], camera.width, camera.height)


def _identity(camera: Camera) -> tuple[object, ...]:
    """Give what tells one camera from another."""
    numbers = tuple(getattr(camera, name) for name in CAMERA_NUMBERS)
    return (*numbers, np.asarray(camera.rotation).tobytes(), np.asarray(camera.translation).tobytes())
