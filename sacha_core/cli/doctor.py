"""`sacha doctor`: is this installation, or this capture, fit for use?"""

from __future__ import annotations

import importlib.metadata
import importlib.util
import os
import platform
from dataclasses import dataclass, field
from typing import Annotated, Any

import tyro

from sacha_core.cli.common import Common, FileOption, HeadSource, MaybePath
from sacha_core.cli.console import Console, table
from sacha_core.errors import OptionError, SachaError

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
    "viser": "view",
    "bpy": "Blender's own Python module",
}
REQUIRED = 5
DISTRIBUTIONS = {"PIL": "pillow", "flip_evaluator": "flip-evaluator"}  # where the package index has another name
INPUTS = ("dataset",)
OUTPUTS = ("picture",)


@dataclass(frozen=True)
class Options:
    """Check this installation: Python, packages, the folder of heads.

    With a capture, check that too before hours go into training on it: that every file is there and makes sense, that parameters are those
    of a head, and that the tracked mesh lies where the images show the person. Where it does not, other readings of the cameras are tried
    (axes, units, resolution), and the one that fits is named. Exit status 1: it is not fit for training.
    """

    dataset: Annotated[MaybePath, tyro.conf.Positional, tyro.conf.arg(metavar="DATASET")] = None
    """A capture in GaussianAvatars' layout, as VHAP exports it."""

    picture: Annotated[FileOption, tyro.conf.arg(metavar="FILE.png")] = None
    """Draw the tracked mesh and the edge of the mask over images of several cameras and timesteps."""

    head: HeadSource = field(default_factory=HeadSource)
    common: Common = field(default_factory=Common)


def run(options: Options, console: Console) -> dict[str, Any]:
    """Check what was asked for.

    Raises:
        SachaError: a package that everything needs is missing, or the capture is broken.
    """
    if options.dataset is not None:
        from sacha_core.cli.capture_check import check_capture

        return check_capture(options.dataset, options.head, options.picture, console)
    if options.head != HeadSource():
        raise OptionError("--head and --masks say whose head a capture shows; expected a DATASET beside them")
    if options.picture is not None:
        raise OptionError("--picture draws the mesh over a capture's images; expected a DATASET beside it")
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
