"""The pose and the cameras of one picture, wherever they come from: a motion or a posed mesh, a capture or a camera's file."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import numpy as np
from jaxtyping import Float

from sacha_core.avatar.binding import to_world
from sacha_core.avatar.gaussians import Gaussians
from sacha_core.avatar.motion import Motion
from sacha_core.cli.cameras import Extent, RoundTheHead, ThroughCapture, extent_of
from sacha_core.cli.render import Options
from sacha_core.cli.sources import Opened
from sacha_core.errors import FormatError, HeadError, OptionError
from sacha_core.flame.model import HeadModel
from sacha_core.flame.posing import Poser
from sacha_core.geometry.triangle import TriangleFrames, triangle_frames
from sacha_core.interchange.camera_file import PlacedCamera, read_camera_file

__all__ = ["extent_in", "placed_cameras", "posed_frames", "read_vertices"]


def posed_frames(opened: Opened, frame: int, vertices: Path | None) -> TriangleFrames:
    """Give the frames of the triangles in one pose: that of a file of vertices, or else of a frame of the avatar's motion.

    Raises:
        OptionError: the motion has no such frame.
        SachaError: the vertices are not the head's, or make a triangle degenerate.
        OSError: the file cannot be read.
    """
    head = opened.head
    if vertices is not None:
        return triangle_frames(read_vertices(vertices, head), head.faces)
    motion = opened.avatar.motion or Motion.rest(head.shapedirs.shape[2], head.exprdirs.shape[2])
    if not 0 <= frame < len(motion):
        raise OptionError(f"frame {frame} does not exist; the motion has frames 0 to {len(motion) - 1}")
    return triangle_frames(Poser(head, motion)(frame), head.faces)


def read_vertices(path: Path, head: HeadModel) -> Float[np.ndarray, "v 3"]:
    """Read the posed vertices of a head, metres, float32.

    Raises:
        FormatError: the file holds no such array.
        HeadError: they are not as many as the head has.
        OSError: it cannot be read.
    """
    try:
        vertices = np.load(path, mmap_mode="r", allow_pickle=False)
    except (ValueError, EOFError) as error:
        raise FormatError(f"{path} is no .npy file of vertices: {error}") from error
    if (
        not isinstance(vertices, np.ndarray)
        or vertices.ndim != 2
        or vertices.shape[1] != 3
        or vertices.dtype.kind != "f"
    ):
        raise FormatError(f"{path} holds no array of (v, 3) floating-point numbers")
    if len(vertices) != head.n_vertices:
        raise HeadError(f"{path} has {len(vertices)} vertices, head {head.name!r} has {head.n_vertices}")
    return np.array(vertices, np.float32)


def extent_in(gaussians: Gaussians, frames: TriangleFrames) -> Extent:
    """Give where an avatar lies in a pose.

    Raises:
        OptionError: there is nothing to look at.
    """
    world = to_world(gaussians, frames)
    return extent_of(world.means, world.opacities)


def placed_cameras(options: Options, otherwise: Callable[[], RoundTheHead | ThroughCapture]) -> list[PlacedCamera]:
    """Give the cameras to draw from: the one of a file, or else those that the other options name.

    Raises:
        SachaError: the file holds no camera, or the options make none.
        OSError: a file cannot be read.
    """
    if options.view.camera_file is not None:
        return [read_camera_file(options.view.camera_file)]
    return [PlacedCamera(camera) for camera in otherwise().cameras(options.frame, 0.0)]
