"""`sacha bake`: colours of triangles into a texture, for a program that shows them on its mesh, such as the Blender add-on."""

from __future__ import annotations

from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import tyro

from sacha_core.cli.common import Common
from sacha_core.cli.console import Console
from sacha_core.errors import FormatError
from sacha_core.progress import Progress

if TYPE_CHECKING:
    import numpy as np
    from jaxtyping import Float, Int

__all__ = ["INPUTS", "OUTPUTS", "Options", "run"]

INPUTS = ("folder",)
OUTPUTS = ("output",)


@dataclass(frozen=True)
class Options:
    """Paint the colours of a mesh's triangles into a texture; a mesh without texture coordinates is given some."""

    folder: Annotated[Path, tyro.conf.Positional, tyro.conf.arg(metavar="FOLDER")]
    """Holds colours.npy (f, 4) linear RGBA and uv.npy (f, 3, 2), or in its place vertices.npy (v, 3) and faces.npy (f, 3)."""

    output: Annotated[Path, tyro.conf.arg(aliases=["-o"], metavar="FILE.png")]
    """The texture to write; uv.npy is put beside the colours where it was missing."""

    size: Annotated[int, tyro.conf.arg(metavar="PIXELS")] = 2048
    """Width and height of the texture."""

    margin: Annotated[int, tyro.conf.arg(metavar="PIXELS")] = 8
    """How far charts are painted beyond their borders."""

    common: Common = field(default_factory=Common)


def run(options: Options, console: Console) -> dict[str, Any]:
    """Read the arrays, write the texture.

    Raises:
        SachaError: an array is missing or damaged, or does not fit the others.
        OSError: a file cannot be read or written.
    """
    import numpy as np

    from sacha_core.cli.comparing import require_image_name, write_image
    from sacha_core.files import write_aside
    from sacha_core.raster.texture import paint_triangles
    from sacha_core.scene.colours import srgb_bytes

    require_image_name(options.output)
    colours = array(options.folder, "colours", 4)
    console.report(Progress("unwrap", 0, 1))
    unwrapped = not (options.folder / "uv.npy").exists()
    uv = _unwrap(options.folder) if unwrapped else array(options.folder, "uv", 3, 2)
    console.report(Progress("unwrap", 1, 1))
    painted = paint_triangles(uv, srgb_bytes(colours[:, :3]), options.size, options.margin)
    console.report(Progress("paint", 1, 1))
    if unwrapped:
        with write_aside(options.folder / "uv.npy") as aside:
            np.save(aside, uv, allow_pickle=False)
    write_image(options.output, painted)
    console.wrote("texture", options.output, f"{options.size}x{options.size}")
    return {"texture": options.output, "size": options.size, "unwrapped": unwrapped, "n_triangles": len(uv)}


def array(folder: Path, name: str, *shape: int) -> Float[np.ndarray, "..."]:
    """Read an array of a mesh, float32, one row for each triangle or vertex.

    Raises:
        FormatError: it is none, or of another shape.
        OSError: it cannot be read.
    """
    import numpy as np

    path = folder / f"{name}.npy"
    try:
        found = np.load(path, allow_pickle=False)
    except (ValueError, EOFError) as error:
        raise FormatError(f"{path} is no .npy file: {error}") from error
    if found.shape[1:] != shape or found.dtype.kind not in "fiu" or not np.isfinite(found).all():
        raise FormatError(f"{path} holds {found.dtype} of shape {found.shape}, expected finite numbers of (n, {shape})")
    return np.asarray(found, np.float32)


def _unwrap(folder: Path) -> Float[np.ndarray, "f 3 2"]:
    import numpy as np

    from sacha_core.flame.unwrap import unwrap

    vertices, corners = array(folder, "vertices", 3), array(folder, "faces", 3)
    faces: Int[np.ndarray, "f 3"] = corners.astype(np.int64)
    if faces.size and not (faces.min() >= 0 and faces.max() < len(vertices)):
        raise FormatError(f"{folder / 'faces.npy'} names a vertex that {folder / 'vertices.npy'} lacks")
    uv, uv_faces = unwrap(vertices, faces)
    corners_uv: np.ndarray = uv[uv_faces]
    return corners_uv
