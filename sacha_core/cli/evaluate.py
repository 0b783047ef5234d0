"""`sacha evaluate`: how good is an avatar on what training never saw?"""

from __future__ import annotations

from dataclasses import dataclass, field
from pathlib import Path
from typing import Annotated, Any

import tyro

from sacha_core.cli.common import Common, HeadSource, ImageSize, require_both_sides, require_size
from sacha_core.cli.console import Console, table
from sacha_core.errors import OptionError

__all__ = ["INPUTS", "Options", "run"]

INPUTS = ("avatar", "dataset")


@dataclass(frozen=True)
class Options:
    """Judge an avatar on the held-out camera and the held-out expressions of its capture.

    The avatar moves by its own motion (of a .sacha file, the decoded one); timesteps beyond its end are driven by the capture's tracked
    parameters. PSNR and SSIM are means over the images.
    """

    avatar: Annotated[Path, tyro.conf.Positional, tyro.conf.arg(metavar="AVATAR")]
    """A .sacha file or a model folder."""

    dataset: Annotated[Path, tyro.conf.Positional, tyro.conf.arg(metavar="DATASET")]
    """The capture that it was trained on."""

    images: int = 100
    """At most so many images for each of the two, evenly spread."""

    head: HeadSource = field(default_factory=HeadSource)
    size: ImageSize = field(default_factory=ImageSize)
    common: Common = field(default_factory=Common)


def run(options: Options, console: Console) -> dict[str, Any]:
    """Draw the held-out views and compare them.

    Raises:
        SachaError: avatar, head or capture is broken, or they do not belong together.
        OSError: a file cannot be read.
    """
    from sacha_core.cli.sources import open_avatar
    from sacha_core.evaluate.views import evaluate_avatar
    from sacha_core.interchange.capture import read_capture

    if options.images < 1:
        raise OptionError(f"--images is {options.images}, expected at least 1")
    require_size(width=options.size.width, height=options.size.height)
    require_both_sides(options.size.width, options.size.height)
    capture = read_capture(options.dataset)
    opened = open_avatar(options.avatar, options.head)
    found = evaluate_avatar(
        opened.avatar.gaussians,
        opened.head,
        capture,
        opened.avatar.motion,
        options.size.width,
        options.size.height,
        options.images,
        console.report,
    )
    both = {"novel view": found.novel_view, "novel expression": found.novel_expression}
    rows = [
        (name, str(len(scores.images)), f"{scores.psnr:.2f} dB", f"{scores.ssim:.4f}") for name, scores in both.items()
    ]
    console.say(f"{options.avatar}: {len(opened.avatar.gaussians):,} Gaussians\n")
    console.say(table(("", "images", "PSNR", "SSIM"), rows))
    return {
        "avatar": options.avatar,
        "dataset": capture.root,
        "n_gaussians": len(opened.avatar.gaussians),
        "novel_view": found.novel_view.to_json(),
        "novel_expression": found.novel_expression.to_json(),
    }
