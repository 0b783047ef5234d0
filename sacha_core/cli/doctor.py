"""`sacha doctor`: is this installation, or this capture, fit for use?"""

from __future__ import annotations

import importlib.metadata
import importlib.util
import os
import platform
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import tyro

from sacha_core.cli.common import Common, HeadSource, MaybePath
from sacha_core.cli.console import Console, table
from sacha_core.errors import OptionError, SachaError

if TYPE_CHECKING:
    from collections.abc import Sequence

    from sacha_core.evaluate.coverage import Coverage
    from sacha_core.interchange.capture import Capture, View

PACKAGES = {  # package: what it is needed for; the first ones are needed for everything
    "numpy": "everything",
    "jaxtyping": "everything",
    "PIL": "reading and writing images",
    "numba": "drawing and training",
    "constriction": "encode, decode",
    "trimesh": "reading meshes",
    "xatlas": "unwrapping heads without texture coordinates",
    "tyro": "this command line",
    "rich": "progress bars",
    "torch": "training on a CUDA device",
    "av": "render --video",
    "matplotlib": "figures",
    "flip_evaluator": "FLIP, a metric of evaluate and ablate",
    "scipy": "averages over rate-distortion curves",
    "lpips": "LPIPS, a metric of evaluate and ablate",
    "gsplat": "drawing on it",
    "bpy": "Blender's own Python module",
}
REQUIRED = 5
DISTRIBUTIONS = {"PIL": "pillow", "flip_evaluator": "flip-evaluator"}  # where the package index has another name
LOOKED_AT = 24  # views of a capture whose pixels are decoded
ENOUGH_COVERED = (
    0.8  # of the vertices inside the mask: captures are masked below a line through the neck, which hides some
)
INPUTS = ("dataset",)


@dataclass(frozen=True)
class Options:
    """Check this installation: Python, packages, the folder of heads.

    With a capture, check that too before hours go into training on it: that every file is there and makes sense, and that the tracked head
    lies where the images show the person.
    """

    dataset: Annotated[MaybePath, tyro.conf.Positional, tyro.conf.arg(metavar="DATASET")] = None
    """A capture in GaussianAvatars' layout."""

    head: HeadSource = field(default_factory=HeadSource)
    common: Common = field(default_factory=Common)


def run(options: Options, console: Console) -> dict[str, Any]:
    """Check what was asked for.

    Raises:
        SachaError: a package that everything needs is missing, or the capture is broken.
    """
    if options.dataset is not None:
        return check_capture(options.dataset, options.head, console)
    if options.head != HeadSource():
        raise OptionError("--head and --masks say whose head a capture shows; expected a DATASET beside them")
    return check_installation(console)


def check_installation(console: Console) -> dict[str, Any]:
    """Look for Python, packages, and the folder of heads.

    Raises:
        SachaError: a package that everything needs is missing.
    """
    from sacha_core import __version__
    from sacha_core.flame.shelf import shelf_folder
    from sacha_core.train.cuda.available import missing

    versions = {package: version_of(package) for package in PACKAGES}
    shelf = shelf_folder()
    heads = sorted(path.name for path in shelf.glob("*.npz")) if shelf.is_dir() else []
    console.say(
        f"SACHA {__version__}, Python {platform.python_version()}, {platform.platform()}, {os.cpu_count()} cores\n"
    )
    rows = [
        (package, found or "missing", use)
        for (package, use), found in zip(PACKAGES.items(), versions.values(), strict=True)
    ]
    console.say(table(("package", "version", "needed for"), rows, words=range(3)))
    console.say(f"\nheads        {len(heads)} in {shelf}")
    absent = [package for package in list(PACKAGES)[:REQUIRED] if versions[package] is None]
    if absent:
        raise SachaError(f"{' and '.join(absent)} missing; install with: pip install sacha")
    lack = missing()
    console.say("training     on the CUDA device" if lack is None else f"training     on the CPU; not on CUDA: {lack}")
    return {
        "sacha": __version__,
        "python": platform.python_version(),
        "platform": platform.platform(),
        "cores": os.cpu_count(),
        "packages": versions,
        "head_folder": shelf,
        "n_heads": len(heads),
        "device": "cuda" if lack is None else "cpu",
        "no_cuda_because": lack,
    }


def version_of(package: str) -> str | None:
    """Give the version of an installed package without importing it; None where it is missing."""
    if importlib.util.find_spec(package) is None:
        return None
    try:
        return importlib.metadata.version(DISTRIBUTIONS.get(package, package))
    except importlib.metadata.PackageNotFoundError:
        return "unknown"


def check_capture(root: Path, source: HeadSource, console: Console) -> dict[str, Any]:
    """Read a capture, and see whether its tracked head lies inside its masks.

    Raises:
        SachaError: the capture is broken, or its head is not to be found.
    """
    from sacha_core.cli.sources import capture_head
    from sacha_core.evaluate.coverage import mesh_coverage
    from sacha_core.evaluate.splits import spread
    from sacha_core.interchange.capture import read_capture

    capture = read_capture(root)
    summary = summarise(capture)
    console.say(f"capture      {capture.root}")
    console.say(f"images       {summary['n_images']} of {' and '.join(summary['sizes'])}, all there")
    console.say(f"timesteps    {summary['n_timesteps']}, parameters finite")
    console.say(f"cameras      {len(summary['cameras'])}")
    console.say("splits       " + ", ".join(f"{name} {count}" for name, count in summary["splits"].items()))
    head = capture_head(capture, source)
    console.say(f"head         {head.name}: {head.n_vertices} vertices, {head.n_faces} triangles")
    views = spread((*capture.train, *capture.val, *capture.test), LOOKED_AT)
    covered = mesh_coverage(capture, head, views, console.report)
    worst, mean = min(one.inside for one in covered), sum(one.inside for one in covered) / len(covered)
    poor = tell_coverage(covered, console)
    if not poor:
        console.hint(f"sacha train {root} -o MODEL")
    return {
        **summary,
        "head": {"name": head.name, "n_vertices": head.n_vertices, "n_faces": head.n_faces},
        "coverage": [
            {
                "image": one.view.image_path,
                "timestep": one.view.timestep,
                "camera_index": one.view.camera_index,
                "inside": one.inside,
                "in_image": one.in_image,
                "mask_area": one.mask_area,
            }
            for one in covered
        ],
        "coverage_mean": mean,
        "coverage_worst": worst,
        "warnings": [f"{one.view.image_path}: {100 * one.inside:.1f} % inside the mask" for one in poor],
    }


def tell_coverage(covered: Sequence[Coverage], console: Console) -> list[Coverage]:
    """Say how much of the tracked head lies where it is seen; give the views where too little of it does."""
    worst = min(covered, key=lambda one: one.inside)
    mean = sum(one.inside for one in covered) / len(covered)
    console.say(
        f"tracking     {100 * mean:.1f} % of the head's vertices lie inside the mask over {len(covered)} views, "
        f"at worst {100 * worst.inside:.1f} % ({worst.view.image_path.name})"
    )
    poor = [one for one in covered if one.inside < ENOUGH_COVERED]
    if poor:
        console.say(
            f"warning      {len(poor)} of {len(covered)} views show the head elsewhere than tracked (under "
            f"{100 * ENOUGH_COVERED:.0f} %): wrong head, wrong cameras, or a lost track"
        )
    return poor


def summarise(capture: Capture) -> dict[str, Any]:
    """Count what a capture has."""
    splits: dict[str, tuple[View, ...]] = {"train": capture.train, "val": capture.val, "test": capture.test}
    everything = [view for views in splits.values() for view in views]
    return {
        "capture": capture.root,
        "n_images": len(everything),
        "sizes": sorted({f"{view.camera.width}x{view.camera.height}" for view in everything}),
        "n_timesteps": len(capture.motion),
        "cameras": sorted({view.camera_index for view in everything}),
        "splits": {name: len(views) for name, views in splits.items()},
    }
