"""What `sacha render` draws beside a picture: the same view of another avatar, and where both differ."""

from __future__ import annotations

import math
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, Literal, NamedTuple

import tyro

from sacha_core.cli.common import FileOption, HeadSource, MaybeFloat, MaybeInt, MaybePath
from sacha_core.errors import OptionError

if TYPE_CHECKING:
    from collections.abc import Sequence

    import numpy as np
    from jaxtyping import Bool, Float, UInt8

    from sacha_core.avatar.gaussians import Gaussians
    from sacha_core.cli.console import Console
    from sacha_core.cli.sources import Opened
    from sacha_core.geometry.triangle import TriangleFrames
    from sacha_core.interchange.camera_file import PlacedCamera

__all__ = [
    "CompareOptions",
    "View",
    "compared_with",
    "draw_view",
    "left_at_level",
    "require_consistent",
    "write_compared",
]


@dataclass(frozen=True)
class CompareOptions:
    """How near to the uncompressed avatar."""

    level: Annotated[MaybeInt, tyro.conf.arg(metavar="1|2|3|4", help_behavior_hint="")] = None
    """Draw what is left of the avatar in a file of this level, and compare it with the avatar itself."""

    encoded: Annotated[MaybePath, tyro.conf.arg(metavar="FILE.sacha", help_behavior_hint="")] = None
    """With --level: the file of that level. It is written, or, where it is there already and newer than the avatar, drawn."""

    against: Annotated[MaybePath, tyro.conf.arg(metavar="AVATAR", help_behavior_hint="")] = None
    """Compare with this avatar on the same head instead."""

    truth: FileOption = None
    """Write the picture that is compared with here."""

    error: FileOption = None
    """Write a picture of the error here: black where there is none."""

    error_kind: Literal["difference", "flip"] = "difference"
    """difference: of the channel that differs most; flip: how visible it is when one flips between both, which takes flip-evaluator."""

    brightest: Annotated[
        MaybeFloat, tyro.conf.arg(metavar="ERROR", help_behavior_hint="(default: 0.1; of flip 0.4)")
    ] = None
    """Error that is painted brightest, of 1."""


class View(NamedTuple):
    """One drawn picture.

    Args:
        image: (h, w, 3) sRGB.
        covered: (h, w) where there is something of the avatar.
    """

    image: UInt8[np.ndarray, "h w 3"]
    covered: Bool[np.ndarray, "h w"]


def require_consistent(options: CompareOptions) -> None:
    """Check that options have a part in what is drawn.

    Raises:
        OptionError: naming the first that has none, or is out of range.
    """
    from sacha_core.perception.flip import missing

    if options.level is not None and not 1 <= options.level <= 4:
        raise OptionError(f"--level is {options.level}, expected 1 to 4")
    if options.encoded is not None and options.level is None:
        raise OptionError("--encoded is the file of --level; expected --level LEVEL beside it")
    if options.level is None and options.against is None:
        for name in ("truth", "error"):
            if getattr(options, name) is not None:
                raise OptionError(f"--{name} needs something to compare with; expected --level or --against AVATAR")
    if options.brightest is not None and not (0 < options.brightest < math.inf):
        raise OptionError(f"--brightest is {options.brightest:g}, expected more than 0")
    lacking = missing() if options.error_kind == "flip" else None
    if lacking:
        raise OptionError(f"--error-kind flip: {lacking}")


def left_at_level(opened: Opened, source: Path, options: CompareOptions, console: Console) -> tuple[Gaussians, int]:
    """Give what is left of an avatar's Gaussians in a file of a level, and the bytes of that file.

    Raises:
        SachaError: the avatar cannot be encoded, or the file that is kept is damaged.
        OSError: the file cannot be read or written.
    """
    from sacha_core.codec import decode
    from sacha_core.files import require_writable, write_aside
    from sacha_core.progress import Progress
    from sacha_core.rate.encoding import RenderingEncoder

    kept, level = options.encoded, options.level
    assert level is not None
    if kept is not None and kept.is_file() and kept.stat().st_mtime > last_change_s(source):
        data = kept.read_bytes()
    else:
        if kept is not None:
            require_writable(kept)
        console.report(Progress("encode", 0, 2))
        encoder = RenderingEncoder(opened.avatar, opened.head)
        console.report(Progress("encode", 1, 2))
        data = encoder.encode(level).data
        console.report(Progress("encode", 2, 2))
        if kept is not None:
            with write_aside(kept) as aside:
                aside.write_bytes(data)
    return decode(data, head=opened.head).gaussians, len(data)


def last_change_s(source: Path) -> float:
    """Give when an avatar's file, or the file of its folder that changed last, was written: seconds since 1970."""
    files = [path for path in source.rglob("*") if path.is_file()] if source.is_dir() else [source]
    return max((path.stat().st_mtime for path in files), default=math.inf)


def compared_with(opened: Opened, options: CompareOptions, head: HeadSource) -> Gaussians | None:
    """Give the Gaussians that a picture is compared with, or None.

    Raises:
        OptionError: they lie on another head.
        SachaError: the other avatar is damaged, or its head is missing.
        OSError: it cannot be read.
    """
    from sacha_core.cli.sources import open_avatar

    if options.against is None:
        return opened.avatar.gaussians if options.level is not None else None
    other = open_avatar(options.against, head)
    if other.head.reference.sha256 != opened.head.reference.sha256:
        raise OptionError(
            f"--against {options.against} lies on head {other.head.name!r}, the avatar on {opened.head.name!r}; expected the same head"
        )
    return other.avatar.gaussians


def draw_view(
    gaussians: Gaussians,
    frames: TriangleFrames,
    cameras: Sequence[PlacedCamera],
    colours: Float[np.ndarray, "n 3"] | None = None,
) -> View:
    """Draw an avatar on white in the pose of a mesh, once for each camera, side by side.

    Raises:
        GeometryError: a Gaussian is bound to a triangle that has no frame.
    """
    import numpy as np

    from sacha_core.raster.rasteriser import Rasteriser
    from sacha_core.raster.scene import render_avatar
    from sacha_core.rate.judging import COVERED

    images, covered = [], []
    for placed in cameras:
        rasteriser = Rasteriser(near=placed.near)
        picture = render_avatar(gaussians, frames, placed.camera, colours=colours, rasteriser=rasteriser)
        images.append(np.rint(255 * np.clip(picture.colour, 0, 1)).astype(np.uint8))
        covered.append(picture.alpha > COVERED)
    return View(np.concatenate(images, axis=1), np.concatenate(covered, axis=1))


def write_compared(view: View, truth: View, options: CompareOptions, console: Console) -> dict[str, Any]:
    """Write what was asked for of a comparison, and tell how near both pictures are.

    Returns:
        What the report says of it: PSNR over all pixels and over those that either avatar covers, decibels, null where both are the same;
        the largest error; SSIM; the files; and of a picture of the error what its colours mean.
    """
    import numpy as np

    from sacha_core.perception.difference import BRIGHTEST, covered_psnr, error_colours, error_legend, pixel_error
    from sacha_core.perception.flip import flip_map
    from sacha_core.perception.psnr import psnr
    from sacha_core.perception.ssim import ssim

    error = pixel_error(view.image, truth.image)
    brightest = BRIGHTEST[options.error_kind] if options.brightest is None else options.brightest
    told: dict[str, Any] = {
        "psnr_db": psnr(view.image, truth.image),
        "own_psnr_db": covered_psnr(view.image, truth.image, view.covered | truth.covered),
        "ssim": ssim(view.image, truth.image),
        "largest_error": float(error.max()),
        "error_kind": options.error_kind,
        "brightest": brightest,
        "identical": not error.any(),
    }
    if options.error is not None:
        painted = flip_map(view.image, truth.image) if options.error_kind == "flip" else error
        told["mean_error"] = float(np.mean(painted))
        told["legend"] = [{"error": value, "colour": colour} for value, colour in error_legend(brightest)]
        write_image(options.error, error_colours(painted, brightest))
        console.wrote("error", options.error, f"{options.error_kind}, brightest at {brightest:g}")
    if options.truth is not None:
        write_image(options.truth, truth.image)
        console.wrote("truth", options.truth)
    same = "the same" if told["identical"] else f"{told['psnr_db']:.2f} dB, {told['own_psnr_db']:.2f} dB on the avatar"
    console.say(f"compared     {same}")
    return {**told, "error": options.error, "truth": options.truth}


def require_image_name(path: Path) -> None:
    """Check that a file's name says what kind of image it is.

    Raises:
        OptionError: it does not.
    """
    from PIL import Image

    if path.suffix.lower() not in Image.registered_extensions():
        raise OptionError(f"{path}: expected the name of an image, such as {path.stem}.png")


def write_image(path: Path, image: UInt8[np.ndarray, "h w c"]) -> None:
    """Write an image, whole or not at all.

    Raises:
        OSError: it cannot be written.
    """
    from PIL import Image

    from sacha_core.files import write_aside

    with write_aside(path) as aside:
        Image.fromarray(image).save(aside)
