"""The picture on the skin of an exported head."""

from __future__ import annotations

import io
from pathlib import Path

import numpy as np
from PIL import Image

from sacha_core.errors import FormatError, HeadError
from sacha_core.flame.model import HeadModel
from sacha_core.raster.texture import paint_triangles
from sacha_core.regions.labels import label_triangles
from sacha_core.regions.scheme import PAPER

__all__ = ["skin_picture"]

MAP_SIDE, MAP_MARGIN = 1024, 4  # texels; the margin keeps smaller copies of the picture from bleeding over seams


def skin_picture(head: HeadModel, texture: Path | None) -> tuple[bytes | None, str]:
    """Give the PNG for a head's skin, and say what it is.

    Raises:
        FormatError: the named file is no PNG.
        OSError: it cannot be read.
    """
    if texture is not None:
        picture = texture.read_bytes()
        require_png(picture, texture)
        return picture, f"skin of {texture.name}"
    try:
        return region_map(head), "skin painted by region"
    except HeadError:  # a head without regions has a skin, too
        return None, "grey skin; --masks FILE would tell its regions"


def require_png(picture: bytes, path: Path) -> None:
    """Check that a picture, which goes into a file as it is, will be understood there.

    Raises:
        FormatError: it is damaged, or no PNG.
    """
    try:
        with Image.open(io.BytesIO(picture), formats=("PNG",)) as image:
            image.verify()
    except (OSError, SyntaxError, ValueError, Image.DecompressionBombError) as error:
        raise FormatError(f"{path} is no PNG that can be read, which is what goes onto the skin") from error


def region_map(head: HeadModel) -> bytes:
    """Paint the regions of a head with texture coordinates into a PNG.

    Raises:
        HeadError: its regions are not known.
    """
    colours = np.array(PAPER.colours, np.uint8)[label_triangles(head, PAPER)]
    assert head.uv is not None
    assert head.uv_faces is not None
    painted = paint_triangles(head.uv[head.uv_faces], colours, MAP_SIDE, MAP_MARGIN)
    stream = io.BytesIO()
    Image.fromarray(np.ascontiguousarray(painted[:, :, :3])).save(stream, "PNG")
    return stream.getvalue()
