"""`sacha inspect`: what is in a .sacha file?"""

from __future__ import annotations

from dataclasses import asdict, dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import tyro

from sacha_core.cli.common import Common, HeadSource, naming
from sacha_core.cli.console import Console, counted, kilobytes, table

if TYPE_CHECKING:
    from sacha_core.codec import Inspection

__all__ = ["INPUTS", "Options", "byte_counts", "grade", "run"]

INPUTS = ("file",)

MEANINGS = {  # of the sections that this version writes
    "Header": "what the file holds",
    "Counts": "Gaussians on each triangle",
    "Hidden": "how hidden each is",
    "Opacity": "opacities",
    "Scale": "sizes",
    "Rotation": "rotations",
    "Position": "positions",
    "Colour": "colours",
    "Harmonic": "colours' change with the direction of view",
    "Binding": "the triangle of each Gaussian",
    "Sensitiv": "perceptual sensitivities",
    "Geometry": "positions",
    "Tool": "all that an external program coded",
    "Static": "the person: shape, offsets",
    "Motion": "motion, frame by frame",
    "head": "the head model itself",
}


@dataclass(frozen=True)
class Options:
    """Show what a .sacha file holds, and where its bytes are.

    Reads the file's tables and verifies every checksum; needs no head, but for --regions, which decodes it:

    sacha inspect a.sacha --regions --head rig.npz --masks FLAME_masks.npz
    """

    file: Annotated[Path, tyro.conf.Positional, tyro.conf.arg(metavar="FILE.sacha")]
    """The file."""

    regions: bool = False
    """Also tell on which regions of the head the Gaussians and their bytes were spent."""

    head: HeadSource = field(default_factory=HeadSource)
    common: Common = field(default_factory=Common)


def run(options: Options, console: Console) -> dict[str, Any]:
    """Inspect the file.

    Raises:
        FormatError: it is damaged or no such file.
        OSError: it cannot be read.
    """
    from sacha_core.codec import inspect

    with naming(options.file):
        found = inspect(options.file)
    console.say(describe(options.file, found))
    spent = None
    if options.regions:
        from sacha_core.cli.inspect_regions import region_rows, region_table

        spent = region_rows(options.file, options.head)
        console.say(f"\n{region_table(spent)}")
    return {
        "file": options.file,
        "format": ".".join(map(str, found.version)),
        "profile": found.profile,
        "coder": found.coder,
        "level": found.level,
        "n_gaussians": found.n_gaussians,
        "sh_degree": found.sh_degree,
        "n_frames": found.n_frames,
        "frame_rate": found.frame_rate,
        "n_groups": found.n_groups,
        "scheme": found.scheme,
        "head": asdict(found.head),
        "bytes": byte_counts(found),
        "sections": [asdict(section) for section in found.sections],
        **({} if spent is None else {"regions": spent}),
    }


def byte_counts(found: Inspection) -> dict[str, Any]:
    """Give the bytes of a file by what they describe; the Gaussians' include the header and the section table."""
    return {
        "gaussians": found.gaussian_bytes,
        "motion": found.motion_bytes,
        "head": found.head_bytes,
        "total": found.total_bytes,
        "per_frame": found.dynamic_bytes_per_frame,
    }


def describe(file: Path, found: Inspection) -> str:
    """Set what a file holds as text."""
    rows = [
        (
            section.name,
            f"{section.n_bytes:,}",
            f"{100 * section.n_bytes / found.total_bytes:.1f} %",
            _density(section.name, section.n_bytes, found),
            MEANINGS.get(section.name, ""),
        )
        for section in found.sections
    ]
    named = sum(section.n_bytes for section in found.sections)
    rest = found.total_bytes - named
    rows.append(("(table)", f"{rest:,}", f"{100 * rest / found.total_bytes:.1f} %", "", "sections and checksums"))
    motion = (
        f"{counted(found.n_frames, 'frame')} at {found.frame_rate:g} a second, playable from {counted(found.n_groups, 'place')}"
        if found.frame_rate
        else "none"
    )
    sums = f"gaussians {kilobytes(found.gaussian_bytes)}, motion {kilobytes(found.motion_bytes)}"
    if found.n_frames:
        sums += f" ({found.dynamic_bytes_per_frame:.1f} bytes a frame)"
    lines = [
        f"{file}: format {found.version[0]}.{found.version[1]}, {grade(found)}, {kilobytes(found.total_bytes)}",
        f"gaussians    {found.n_gaussians:,}, spherical harmonics of degree {found.sh_degree}, region scheme {found.scheme!r}",
        f"motion       {motion}",
        f"head         {found.head.name}: {found.head.n_vertices} vertices, {found.head.n_faces} triangles, "
        + ("inside the file" if found.head_bytes else f"not inside (sha256 {found.head.sha256[:12]})"),
        f"bytes        {sums}, head {kilobytes(found.head_bytes)}",
        "",
        table(("section", "bytes", "share", "each", ""), rows, words=(0, 4)),
    ]
    return "\n".join(lines)


def grade(found: Inspection) -> str:
    """Say how finely a file is coded."""
    if found.profile == "archive":
        return "archive: every bit"
    return f"level {found.level:g}" + (f" of the paper's profile by {found.coder}" if found.profile == "paper" else "")


def _density(name: str, n_bytes: int, found: Inspection) -> str:
    """Say what one Gaussian or one frame costs in a section."""
    if name == "Motion" and found.n_frames:
        return f"{n_bytes / found.n_frames:.1f} B/frame"
    if (
        name
        in {
            "Counts",
            "Hidden",
            "Opacity",
            "Scale",
            "Rotation",
            "Position",
            "Colour",
            "Harmonic",
            "Geometry",
            "Binding",
            "Sensitiv",
        }
        and found.n_gaussians
    ):
        return f"{8 * n_bytes / found.n_gaussians:.1f} bit"
    return ""
