"""`sacha convert-head`: any head into the head model's own file."""

from __future__ import annotations

from dataclasses import asdict, dataclass, field
from pathlib import Path
from typing import Annotated, Any

import tyro

from sacha_core.cli.common import Common, FileOption
from sacha_core.cli.console import Console, kilobytes

__all__ = ["OUTPUTS", "Options", "run"]

OUTPUTS = ("output",)


@dataclass(frozen=True)
class Options:
    """Make a head model (.npz) from a FLAME pickle, from any rig with blend shapes, or from the synthetic head.

    A pickle runs no code of its own: only the arrays of a FLAME model are read from it. FLAME gets the teeth that GaussianAvatars adds; a
    head without texture coordinates is unwrapped.

    sacha convert-head flame2023.pkl --masks FLAME_masks.pkl -o flame.npz
    """

    source: Annotated[str, tyro.conf.Positional, tyro.conf.arg(metavar="HEAD")]
    """A FLAME pickle, a rig or head model (.npz), or "synthetic", "synthetic:small"."""

    output: Annotated[Path, tyro.conf.arg(aliases=["-o"], metavar="FILE.npz")]
    """Where the head model goes."""

    masks: FileOption = None
    """Vertex masks (FLAME_masks.npz or .pkl), which tell the regions of the head apart."""

    common: Common = field(default_factory=Common)


def run(options: Options, console: Console) -> dict[str, Any]:
    """Convert the head.

    Raises:
        SachaError: the source is damaged or of no known kind.
        OSError: a file cannot be read or written.
    """
    from sacha_core.cli.sources import keep
    from sacha_core.errors import HeadError
    from sacha_core.flame.head_file import save_head
    from sacha_core.flame.open import open_head
    from sacha_core.flame.unwrap import unwrapped
    from sacha_core.regions.labels import label_triangles
    from sacha_core.regions.scheme import PAPER

    opened = open_head(options.source, masks=options.masks)
    head = unwrapped(opened)
    keep(head)
    save_head(head, options.output)
    joints, shape, expression = len(head.parents), head.shapedirs.shape[2], head.exprdirs.shape[2]
    console.wrote("head", options.output, kilobytes(options.output.stat().st_size))
    console.say(f"name         {head.name} (sha256 {head.reference.sha256[:12]})")
    console.say(
        f"mesh         {head.n_vertices} vertices, {head.n_faces} triangles"
        + (f", of which {head.n_teeth_faces} are teeth" if head.n_teeth_faces else "")
    )
    console.say(f"components   {shape} of shape, {expression} of expression; {joints} joint{'s' * (joints > 1)}")
    console.say(f"texture      coordinates {'made by unwrapping' if head is not opened else 'of its own'}")
    counts: dict[str, int] = {}
    try:
        labels = label_triangles(head, PAPER)
        counts = {name: int((labels == row).sum()) for row, name in enumerate(PAPER.regions)}
        console.say("regions      " + ", ".join(f"{name} {count}" for name, count in counts.items()) + " triangles")
    except HeadError as error:  # a head without regions still carries avatars
        console.say(f"regions      unknown: {error}")
    return {
        "file": options.output,
        **asdict(head.reference),
        "n_shape": shape,
        "n_expression": expression,
        "n_joints": joints,
        "n_teeth_faces": head.n_teeth_faces,
        "unwrapped": head is not opened,
        "region_triangles": counts,
    }
