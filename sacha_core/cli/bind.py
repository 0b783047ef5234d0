"""`sacha bind`: splats that stand free in the world onto a head, which then moves them."""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, Literal

import tyro

from sacha_core.cli.common import Common, FileOption, HeadSource
from sacha_core.cli.console import Console, kilobytes, table
from sacha_core.errors import FormatError, OptionError

if TYPE_CHECKING:
    import numpy as np

    from sacha_core.avatar.gaussians import Gaussians
    from sacha_core.flame.model import HeadModel

__all__ = ["INPUTS", "OUTPUTS", "Options", "run"]

INPUTS = ("splats", "motion")
OUTPUTS = ("output",)

QUANTILES = (0.5, 0.9, 0.99, 1.0)  # of the distances that are told
LOST = 0.5  # share of Gaussians that are far, from which on the scene hardly stands where the head is


@dataclass(frozen=True)
class Options:
    """Bind a scene of 3D Gaussian Splatting (.ply) to a head, so that it moves with it.

    The splats have to stand where the head is: in metres, y up, posed alike. Each goes to the nearest triangle; what is far from all of
    them is told. Splats that are as many as the once-subdivided head has vertices (20,018 on FLAME) are LAM's and go to their own vertices.

    sacha bind scene.ply --head flame.npz --motion person.npz --frame 0 -o avatar.ply

    sacha bind offset.ply --to lam-offsets --head rig.npz -o avatar.ply
    """

    splats: Annotated[Path, tyro.conf.Positional, tyro.conf.arg(metavar="SCENE.ply")]
    """The splats, as 3D Gaussian Splatting writes them."""

    output: Annotated[Path, tyro.conf.arg(aliases=["-o"], metavar="FILE.ply")]
    """Where the bound ones go, in GaussianAvatars' layout, which every other command takes with --head."""

    to: Literal["auto", "nearest", "subdivided", "lam-offsets"] = "auto"
    """nearest: triangle; subdivided: each to its own vertex of the once-subdivided head; lam-offsets: LAM's offset.ply, which holds places
    relative to those vertices and plain colours."""

    motion: FileOption = None
    """Motion (.npz) of the person, in one of whose frames the splats stand; by default the head is at rest."""

    frame: int = 0
    """Which frame of the motion."""

    scale: Annotated[float, tyro.conf.arg(metavar="FACTOR")] = 1.0
    """Multiply places and sizes by this first, which has to make them metres."""

    y_down: bool = False
    """Turn the splats over first: in scenes of 3D Gaussian Splatting y is often down."""

    far: Annotated[float, tyro.conf.arg(metavar="METRES")] = 0.05
    """What is farther than this from the head is told as far away: hair may be, a room is."""

    drop_far: bool = False
    """Leave out what is far away."""

    head: HeadSource = field(default_factory=HeadSource)
    common: Common = field(default_factory=Common)


def run(options: Options, console: Console) -> dict[str, Any]:
    """Bind the splats, and tell what is far away.

    Raises:
        SachaError: the scene, the head or an option makes no sense.
        OSError: a file cannot be read or written.
    """
    import numpy as np

    from sacha_core.animation.splat_binding import bound_to, nearest_binding
    from sacha_core.cli.sources import keep, named_head
    from sacha_core.interchange.splat_ply import write_bound_ply

    require_consistent(options)
    head = named_head(options.head)
    if head is None:
        raise OptionError("expected --head HEAD: what the splats shall be bound to")
    keep(head)
    vertices = posed_vertices(options, head)
    gaussians, own = placed(options, head, vertices)
    nearest, distance_m = nearest_binding(gaussians.position, vertices, head.faces)
    bound = bound_to(gaussians, nearest if own is None else own, vertices, head.faces)
    far = distance_m > options.far
    if options.drop_far:
        bound = bound.select(~far)
        if not len(bound):
            raise OptionError(f"all {len(far):,} Gaussians are farther than --far {options.far:g} m from the head")
    write_bound_ply(options.output, bound, bound.sh_degree)
    how = "the nearest triangles" if own is None else "their vertices of the once-subdivided head"
    size = kilobytes(options.output.stat().st_size)
    console.wrote("gaussians", options.output, f"{len(bound):,} bound to {how} of {head.name!r}, {size}")
    found = tell(options, head, nearest, distance_m, console)
    console.hint(f"sacha render {options.output} --head {options.head.head} -o {options.output.with_suffix('.png')}")
    return {
        "file": options.output,
        "n_gaussians": len(bound),
        "n_far": int(far.sum()),
        "n_dropped": len(far) - len(bound),
        "bound_to": "nearest" if own is None else "subdivided",
        "distance_m": {f"{share:g}": float(np.quantile(distance_m, share)) for share in QUANTILES},
        "far_by_region": found,
    }


def require_consistent(options: Options) -> None:
    """Check the options that are numbers.

    Raises:
        OptionError: one makes no sense.
    """
    if options.output.suffix.lower() != ".ply":
        raise OptionError(f"-o {options.output}: expected a file whose name ends in .ply")
    if not 1e-6 <= options.scale <= 1e6:
        raise OptionError(f"--scale is {options.scale:g}, expected a factor between a millionth and a million")
    if not options.far >= 0:
        raise OptionError(f"--far is {options.far:g}, expected a distance in metres")
    if options.frame and options.motion is None:
        raise OptionError("--frame names a frame of a motion; expected --motion FILE beside it")


def posed_vertices(options: Options, head: HeadModel) -> Any:
    """Give the head's vertices in the pose in which the splats stand.

    Raises:
        OptionError: the motion has no such frame.
    """
    from sacha_core.cli.sources import open_motion
    from sacha_core.flame.posing import Poser

    if options.motion is None:
        return head.v_template
    motion = open_motion(options.motion, head)
    if not 0 <= options.frame < len(motion):
        raise OptionError(f"--frame {options.frame} does not exist; the motion has frames 0 to {len(motion) - 1}")
    return Poser(head, motion)(options.frame)


def placed(options: Options, head: HeadModel, vertices: np.ndarray) -> tuple[Gaussians, np.ndarray | None]:
    """Give the splats in metres of the world, and their triangles where these follow from their order.

    Raises:
        FormatError: the file is no scene, holds nothing, or is not on the subdivided head though it should be.
    """
    import numpy as np

    from sacha_core.animation.splat_binding import subdivided, with_colours_as_harmonics
    from sacha_core.interchange.splat_ply import read_world_ply
    from sacha_core.interchange.y_down import turned_over

    gaussians = read_world_ply(options.splats)
    if not len(gaussians):
        raise FormatError(f"{options.splats} holds no Gaussians")
    if options.scale != 1:
        grown = gaussians.log_scale + np.float32(np.log(options.scale))
        gaussians = replace(gaussians, position=gaussians.position * np.float32(options.scale), log_scale=grown)
    if options.y_down:
        gaussians = turned_over(gaussians)
    if options.to == "nearest":
        return gaussians, None
    mesh = subdivided(head)
    if len(mesh.binding) != len(gaussians):
        if options.to == "auto":
            return gaussians, None
        raise FormatError(
            f"{options.splats} holds {len(gaussians):,} Gaussians; head {head.name!r}, once subdivided, has {len(mesh.binding):,} vertices"
        )
    if options.to == "lam-offsets":
        moved = (gaussians.position + mesh.points(vertices)).astype(np.float32)
        gaussians = with_colours_as_harmonics(replace(gaussians, position=moved))
    return gaussians, mesh.binding


def tell(
    options: Options, head: HeadModel, nearest: np.ndarray, distance_m: np.ndarray, console: Console
) -> dict[str, int]:
    """Say how far from the head Gaussians are, and near which regions the far ones are; give these counts."""
    import numpy as np

    from sacha_core.errors import HeadError
    from sacha_core.regions.labels import label_triangles, region_counts
    from sacha_core.regions.scheme import PAPER

    far = distance_m > options.far
    median, most, nearly_all, farthest = (1000 * np.quantile(distance_m, share) for share in QUANTILES)
    console.say(
        f"distance     {median:.1f} mm half of them, {most:.1f} mm nine of ten, {nearly_all:.1f} mm 99 of 100, {farthest:.1f} mm all"
    )
    done = "left out" if options.drop_far else "kept; --drop-far leaves them out"
    console.say(
        f"far away     {int(far.sum()):,} of {len(far):,}, over {1000 * options.far:g} mm from the head: {done}"
    )
    if far.mean() > LOST:
        console.say(
            "             Most are: is the scene in metres, y up, and posed as the head is? --scale, --y-down and --motion help"
        )
    if not far.any():
        return {}
    try:
        counts = region_counts(label_triangles(head, PAPER), nearest[far], PAPER)
    except HeadError:  # a head without regions carries splats, too
        return {}
    rows = {name: int(count) for name, count in zip(PAPER.regions, counts, strict=True) if count}
    console.say(table(("near region", "far"), [(name, f"{count:,}") for name, count in rows.items()]))
    return rows
