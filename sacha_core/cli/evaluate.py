"""`sacha evaluate`: how good is an avatar on what training never saw?"""

from __future__ import annotations

from collections.abc import Collection, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, Literal

import tyro

from sacha_core.cli.common import Common, HeadSource, ImageSize, require_both_sides, require_size
from sacha_core.cli.console import Console, table
from sacha_core.errors import OptionError

if TYPE_CHECKING:
    from sacha_core.evaluate.picture_metrics import ViewScores
    from sacha_core.interchange.capture import Capture

__all__ = ["INPUTS", "Options", "run"]

INPUTS = ("avatar", "dataset")


@dataclass(frozen=True)
class Options:
    """Judge an avatar on the held-out camera and the held-out expressions of its capture.

    The avatar moves by its own motion (of a .sacha file, the decoded one); timesteps beyond its end are driven by the capture's tracked
    parameters. Figures are means over the images; within regions, over all pixels that show the region.
    """

    avatar: Annotated[Path, tyro.conf.Positional, tyro.conf.arg(metavar="AVATAR")]
    """A .sacha file or a model folder."""

    dataset: Annotated[Path, tyro.conf.Positional, tyro.conf.arg(metavar="DATASET")]
    """The capture that it was trained on."""

    images: int = 100
    """At most so many images for each of the two, evenly spread."""

    metrics: tuple[Literal["psnr", "ssim", "flip", "lpips"], ...] = ("psnr", "ssim")
    """What to measure. flip: how visible the difference is, 0 to 1; lpips: in the features of VGG and AlexNet, where weights are found."""

    table_one: bool = False
    """Also set size and figures of novel expressions beside those that papers report, in the columns of SACHA's table 1."""

    regions: bool = False
    """Also PSNR, and FLIP if asked for, within each region of the head."""

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
    from sacha_core.cli.table_one import sizes_of, table_one
    from sacha_core.evaluate.region_masks import RegionMasks
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
        metrics=options.metrics,
        masks=RegionMasks(capture, opened.head) if options.regions else None,
    )
    both = {"novel view": found.novel_view, "novel expression": found.novel_expression}
    console.say(f"{options.avatar}: {len(opened.avatar.gaussians):,} Gaussians\n")
    console.say(overall_table(both, options.metrics))
    if options.regions:
        console.say("\n" + regions_table(both, "flip" in options.metrics))
    beside = {}
    if options.table_one:
        text, beside["table_one"] = table_one(
            sizes_of(options.avatar, opened), found.novel_expression, shown_size(capture, options.size)
        )
        console.say("\n" + text)
    without = missing_metrics(options.metrics)
    if without:
        console.say("\n" + "\n".join(dict.fromkeys(without.values())))
    return {
        "avatar": options.avatar,
        "dataset": capture.root,
        "n_gaussians": len(opened.avatar.gaussians),
        "novel_view": found.novel_view.to_json(),
        "novel_expression": found.novel_expression.to_json(),
        "not_measured": without,
        **beside,
    }


def shown_size(capture: Capture, size: ImageSize) -> str:
    """Say how large the images are that are compared."""
    camera = capture.train[0].camera
    return f"{size.width or camera.width}x{size.height or camera.height}"


def overall_table(scores: Mapping[str, ViewScores], metrics: Collection[str]) -> str:
    """Set the means over all images; LPIPS that could not be measured is a dash."""
    columns = [("PSNR", "psnr", "{:.2f} dB")]
    columns += [("SSIM", "ssim", "{:.4f}")] if "ssim" in metrics else []
    columns += [("FLIP", "flip", "{:.4f}")] if "flip" in metrics else []
    if "lpips" in metrics:
        columns += [("LPIPS VGG", "lpips_vgg", "{:.4f}"), ("LPIPS Alex", "lpips_alex", "{:.4f}")]
    rows = [
        (name, str(len(found.images)), *(figure(form, getattr(found.quality, field)) for _, field, form in columns))
        for name, found in scores.items()
    ]
    return table(("", "images", *(title for title, _, _ in columns)), rows)


def regions_table(scores: Mapping[str, ViewScores], with_flip: bool) -> str:
    """Set every region's figures in each setting."""
    head, rows = ["region"], [[name] for name in next(iter(scores.values())).regions]
    for setting, found in scores.items():
        head += [f"{setting}: pixels", "PSNR", *(["FLIP"] if with_flip else [])]
        for row, region in zip(rows, found.regions.values(), strict=True):
            row.extend([f"{region.pixels:,}", figure("{:.2f} dB", region.psnr)])
            row.extend([figure("{:.4f}", region.flip)] if with_flip else [])
    return table(head, rows)


def figure(form: str, value: float | None) -> str:
    """Write a figure, or a dash where there is none."""
    return "-" if value is None else form.format(value)


def missing_metrics(metrics: Collection[str]) -> dict[str, str]:
    """Say of each metric that was asked for and cannot be measured here what it needs."""
    from sacha_core.evaluate.lpips import NETWORKS, missing

    texts = {f"lpips_{name}": missing(name) for name in NETWORKS} if "lpips" in metrics else {}
    return {name: text for name, text in texts.items() if text}
