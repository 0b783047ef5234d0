"""`sacha render`: pictures and videos of an avatar."""

from __future__ import annotations

import math
from collections.abc import Iterator
from contextlib import closing
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, Literal

import tyro

from sacha_core.cli.common import (
    Common,
    FileOption,
    HeadSource,
    MaybeFloat,
    MaybePath,
    PixelsOption,
    require_both_sides,
    require_size,
)
from sacha_core.cli.comparing import CompareOptions
from sacha_core.cli.console import Console
from sacha_core.errors import OptionError
from sacha_core.progress import Progress

if TYPE_CHECKING:
    import numpy as np

    from sacha_core.cli.cameras import Extent, RoundTheHead, ThroughCapture
    from sacha_core.cli.sources import Opened
    from sacha_core.cli.stage import Stage

__all__ = ["INPUTS", "OUTPUTS", "Options", "ViewOptions", "run"]

INPUTS = ("avatar", "motion", "vertices")
OUTPUTS = ("output", "video", "compare.truth", "compare.error")

DEFAULT_SIZE = (550, 802)  # the paper's images


@dataclass(frozen=True)
class ViewOptions:
    """Where from."""

    azimuth: Annotated[tuple[float, ...], tyro.conf.arg(metavar="DEGREES...")] = (0.0,)
    """Where the camera stands: 0 in front, 90 at the subject's left; several give pictures side by side."""

    elevation: Annotated[float, tyro.conf.arg(metavar="DEGREES")] = 0.0
    """How far above the middle of the head."""

    distance: Annotated[MaybeFloat, tyro.conf.arg(metavar="METRES", help_behavior_hint="(default: 1)")] = None
    """From the middle of the head."""

    focal: Annotated[
        MaybeFloat, tyro.conf.arg(metavar="PIXELS", help_behavior_hint="(default: so that the head fits)")
    ] = None
    """Focal length."""

    orbit: Annotated[float, tyro.conf.arg(metavar="DEGREES")] = 0.0
    """Video only: how far the cameras travel round the head from first frame to last; 360 is once round."""

    dataset: Annotated[MaybePath, tyro.conf.arg(metavar="DATASET", help_behavior_hint="")] = None
    """A capture whose cameras to look through, instead of all the above."""

    camera: Annotated[tuple[int, ...], tyro.conf.arg(metavar="INDEX...")] = (8,)
    """Which of the capture's cameras; several give pictures side by side."""

    camera_file: Annotated[MaybePath, tyro.conf.arg(metavar="FILE.json", help_behavior_hint="")] = None
    """A camera of your own, instead of all the above: width, height, K, world_to_camera (OpenCV's axes, metres), and near if need be."""


@dataclass(frozen=True)
class Options:
    """Draw one frame of an avatar, or a video of it.

    sacha render a.sacha --frame 0 -o a.png

    sacha render a.sacha --video a.mp4 --azimuth -40 0 40

    sacha render a.sacha --video a.mp4 --dataset DATASET --camera 8 0

    sacha render MODEL --level 2 -o a.png --error error.png
    """

    avatar: Annotated[Path, tyro.conf.Positional, tyro.conf.arg(metavar="AVATAR")]
    """A .sacha file, a model folder, or a PLY of bound Gaussians (with --head)."""

    output: Annotated[MaybePath, tyro.conf.arg(aliases=["-o"], metavar="FILE.png", help_behavior_hint="")] = None
    """The picture to write."""

    frame: int = 0
    """Which frame of the motion the picture shows, from 0."""

    video: Annotated[MaybePath, tyro.conf.arg(metavar="FILE.mp4", help_behavior_hint="")] = None
    """The video to write."""

    frames: Annotated[str, tyro.conf.arg(metavar="FROM:TO:STEP", help_behavior_hint="(default: all)")] = ":"
    """Which frames the video shows, as slices in Python: 0:100, ::2."""

    motion: FileOption = None
    """Motion (.npz) to play instead of the avatar's own."""

    vertices: Annotated[MaybePath, tyro.conf.arg(metavar="FILE.npy", help_behavior_hint="")] = None
    """Picture only: posed vertices (v, 3) of the head, metres, y up, instead of a frame of the motion."""

    colour: Literal["rgb", "region"] = "rgb"
    """rgb: as it looks; region: each Gaussian in the colour of its region."""

    width: PixelsOption = None
    """Width of each picture; by default the capture's, or 550."""

    height: PixelsOption = None
    """Height of each picture; by default the capture's, or 802."""

    view: ViewOptions = field(default_factory=ViewOptions)
    compare: CompareOptions = field(default_factory=CompareOptions)
    head: HeadSource = field(default_factory=HeadSource)
    common: Common = field(default_factory=Common)


def run(options: Options, console: Console) -> dict[str, Any]:
    """Draw what was asked for.

    Raises:
        SachaError: the avatar, its head or the options make no sense.
        OSError: a file cannot be read or written.
    """
    from sacha_core.cli.sources import open_avatar
    from sacha_core.cli.stage import Stage

    if (options.output is None) == (options.video is None):
        raise OptionError("expected one of the two: -o FILE.png for a picture, --video FILE.mp4 for a video")
    require_size(width=options.width, height=options.height)
    require_consistent(options)
    require_posable(options)
    opened = open_avatar(options.avatar, options.head, options.motion)
    if options.output is not None and is_posed_or_compared(options):
        return draw_posed(opened, options, options.output, console)
    gaussians = opened.avatar.gaussians
    painted = painted_triangles(opened, options)
    colours = None if painted is None else painted[gaussians.binding]
    with closing(Stage(gaussians, opened.head, opened.avatar.motion, colours)) as stage:
        if options.output is not None:
            return draw_picture(stage, options, options.output, console)
        assert options.video is not None
        return draw_video(stage, options, options.video, console)


def require_consistent(options: Options) -> None:
    """Check that every option that was given has a part in what will be drawn.

    Raises:
        OptionError: naming the first that has none, or that is not finite.
    """
    view, usual = options.view, ViewOptions()
    for name in ("azimuth", "elevation", "distance", "focal", "orbit"):
        value = getattr(view, name)
        if value is not None and not all(map(math.isfinite, value if isinstance(value, tuple) else (value,))):
            raise OptionError(f"--{name} is not finite, expected plain numbers")
        if value != getattr(usual, name) and view.dataset is not None:
            raise OptionError(f"--{name} moves no camera of a capture; expected it or --dataset, not both")
    if view.camera != usual.camera and view.dataset is None:
        raise OptionError("--camera names a camera of a capture; expected --dataset DATASET beside it")
    if not view.azimuth or not view.camera:
        raise OptionError(f"--{'camera' if view.azimuth else 'azimuth'} has no value, expected one or more")
    if options.video is not None and options.frame != Options.frame:
        raise OptionError("--frame is for a picture; expected --frames FROM:TO for a video")
    if options.video is None and options.frames != Options.frames:
        raise OptionError("--frames is for a video; expected --frame N for a picture")
    if options.video is None and view.orbit != usual.orbit:
        raise OptionError("--orbit is for a video; expected --azimuth DEGREES for a picture")


def require_posable(options: Options) -> None:
    """Check that a camera's file is the whole camera, and that what is for pictures alone is not given for a video.

    Raises:
        OptionError: naming the first option that has no part in what will be drawn.
    """
    from sacha_core.cli import comparing

    view = options.view
    if view.camera_file is not None and view != ViewOptions(camera_file=view.camera_file):
        raise OptionError("--camera-file is the whole camera; expected no other option that says where from")
    if view.camera_file is not None and (options.width, options.height) != (None, None):
        raise OptionError("--camera-file says how large the picture is; expected no --width and --height")
    if options.video is not None:
        for name, value in (("camera-file", view.camera_file), ("vertices", options.vertices)):
            if value is not None:
                raise OptionError(f"--{name} is for a picture; expected -o FILE.png with it")
        if options.compare != CompareOptions():
            raise OptionError("comparing is for a picture; expected -o FILE.png with --level or --against")
    comparing.require_consistent(options.compare)


def is_posed_or_compared(options: Options) -> bool:
    """Tell whether a picture takes more than a frame and the usual cameras."""
    return (
        options.vertices is not None
        or options.view.camera_file is not None
        or any(getattr(options.compare, name) is not None for name in ("level", "against"))
    )


def draw_posed(opened: Opened, options: Options, path: Path, console: Console) -> dict[str, Any]:
    """Write a picture of any pose from any camera, and beside it, where that was asked for, what it is compared with."""
    from sacha_core.cli import comparing
    from sacha_core.cli.posing import extent_in, placed_cameras, posed_frames

    comparing.require_image_name(path)
    frames = posed_frames(opened, options.frame, options.vertices)
    truth, shown, n_bytes = (
        comparing.compared_with(opened, options.compare, options.head),
        opened.avatar.gaussians,
        None,
    )
    if options.compare.level is not None:
        shown, n_bytes = comparing.left_at_level(opened, options.avatar, options.compare, console)
    cameras = placed_cameras(options, lambda: viewpoints(extent_in(opened.avatar.gaussians, frames), options))
    painted = painted_triangles(opened, options)
    colours = [None if painted is None or one is None else painted[one.binding] for one in (shown, truth)]
    view = comparing.draw_view(shown, frames, cameras, colours[0])
    comparing.write_image(path, view.image)
    height, width = view.image.shape[:2]
    console.wrote("picture", path, f"{width}x{height}, {len(shown):,} Gaussians")
    report = {"picture": path, "width": width, "height": height, "frame": options.frame, "n_gaussians": len(shown)}
    report |= {"bytes": n_bytes, "level": options.compare.level}
    if truth is None:
        return report
    beside = comparing.draw_view(truth, frames, cameras, colours[1])
    return report | comparing.write_compared(view, beside, options.compare, console)


def painted_triangles(opened: Opened, options: Options) -> np.ndarray | None:
    """Give the colour of each triangle's region where those are asked for; None for the avatar's own colours."""
    from sacha_core.cli.stage import region_colours

    return region_colours(opened.head, opened.avatar.scheme) if options.colour == "region" else None


def draw_picture(stage: Stage, options: Options, path: Path, console: Console) -> dict[str, Any]:
    """Write one frame as an image."""
    from sacha_core.cli.comparing import require_image_name, write_image

    require_image_name(path)
    cameras = viewpoints(stage.extent(options.frame), options).cameras(options.frame, 0.0)
    image = stage.draw(options.frame, cameras)
    write_image(path, image)
    height, width = image.shape[:2]
    console.wrote("picture", path, f"{width}x{height}, frame {options.frame} of {len(stage.motion)}")
    return {"picture": path, "width": width, "height": height, "frame": options.frame}


def draw_video(stage: Stage, options: Options, path: Path, console: Console) -> dict[str, Any]:
    """Write a range of frames as a video."""
    from sacha_core.cli.video import write_video

    frames = frame_range(options.frames, len(stage.motion))
    looking = viewpoints(stage.extent(frames[0]), options)
    size = [0, 0]

    def images() -> Iterator[np.ndarray]:
        for done, frame in enumerate(frames):
            image = stage.draw(frame, looking.cameras(frame, options.view.orbit * done / len(frames)))
            size[:] = image.shape[1::-1]
            console.report(Progress("draw", done + 1, len(frames)))
            yield image

    step = abs(frames[1] - frames[0]) if len(frames) > 1 else 1
    write_video(path, images(), stage.motion.frame_rate / step)
    seconds = len(frames) * step / stage.motion.frame_rate
    console.wrote("video", path, f"{size[0]}x{size[1]}, {len(frames)} frames, {seconds:.1f} s")
    return {"video": path, "width": size[0], "height": size[1], "n_frames": len(frames), "duration_s": seconds}


def viewpoints(extent: Extent, options: Options) -> RoundTheHead | ThroughCapture:
    """Give where the cameras stand."""
    from sacha_core.cli.cameras import RoundTheHead, ThroughCapture
    from sacha_core.interchange.capture import read_capture

    view = options.view
    if view.dataset is not None:
        require_both_sides(options.width, options.height)
        return ThroughCapture(read_capture(view.dataset), view.camera, options.width, options.height)
    width, height = options.width or DEFAULT_SIZE[0], options.height or DEFAULT_SIZE[1]
    return RoundTheHead(extent, width, height, view.azimuth, view.elevation, view.distance, view.focal)


def frame_range(text: str, n_frames: int) -> range:
    """Give the frames that a slice such as `0:100:2` names.

    Raises:
        OptionError: it is no slice, or names no frame.
    """
    parts = text.split(":")
    try:
        numbers = [int(part) if part else None for part in parts]
        chosen = range(n_frames)[slice(*numbers)] if 2 <= len(parts) <= 3 else range(0)
    except ValueError as error:
        raise OptionError(f"--frames {text}: expected FROM:TO or FROM:TO:STEP, such as 0:100 or ::2") from error
    if not chosen:
        raise OptionError(
            f"--frames {text} names none of the {n_frames} frames; expected FROM:TO:STEP, such as 0:100 or ::2"
        )
    return chosen
