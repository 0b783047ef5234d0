"""The picture on the skin of an exported head."""

from __future__ import annotations

import io
from pathlib import Path

import numpy as np
from PIL import Image

from sacha_core.errors import FormatError, SachaError
from sacha_core.flame.model import HeadModel
from sacha_core.interchange.image_file import BROKEN_IMAGE
from sacha_core.raster.texture import paint_triangles
from sacha_core.regions.partition import Partition, partition_by
from sacha_core.regions.scheme import find_scheme
from sacha_core.regions.scheme_file import read_scheme_file

__all__ = ["skin_picture"]

MAP_SIDE, MAP_MARGIN = 1024, 4  # texels; the margin keeps smaller copies of the picture from bleeding over seams


def skin_picture(head: HeadModel, texture: Path | None, scheme: Path | None, name: str) -> tuple[bytes | None, str]:
    """Give the PNG for a head's skin, and say what it is: a picture that is named, or the map of the head's regions.

    Args:
        head: with texture coordinates.
        texture: a PNG to use instead of the map.
        scheme: a file of regions of somebody's own.
        name: of the scheme that the avatar goes by, where no file is named.

    Raises:
        FormatError: a named file is damaged or no PNG.
        HeadError: the regions that are named are another head's.
        OSError: a file cannot be read.
    """
    if texture is not None:
        picture = texture.read_bytes()
        require_png(picture, texture)
        return picture, f"skin of {texture.name}"
    if scheme is not None:
        return region_map(head, read_scheme_file(scheme, head)), f"skin painted by regions of {scheme.name}"
    try:
        return region_map(head, partition_by(head, find_scheme(name))), "skin painted by region"
    except SachaError:  # a head whose regions are not known has a skin, too
        return None, "grey skin; --masks or --scheme FILE would tell its regions"


def require_png(picture: bytes, path: Path) -> None:
    """Check that a picture, which goes into a file as it is, will be understood there.

    Raises:
        FormatError: it is damaged, or no PNG.
    """
    try:
        with Image.open(io.BytesIO(picture), formats=("PNG",)) as image:
            image.verify()
    except BROKEN_IMAGE as error:
        raise FormatError(f"{path} is no PNG that can be read, which is what goes onto the skin") from error


def region_map(head: HeadModel, regions: Partition) -> bytes:
    """Paint the regions of a head with texture coordinates into a PNG."""
    assert head.uv is not None
    assert head.uv_faces is not None
    painted = paint_triangles(head.uv[head.uv_faces], regions.triangle_colours, MAP_SIDE, MAP_MARGIN)
    stream = io.BytesIO()
    Image.fromarray(np.ascontiguousarray(painted[:, :, :3])).save(stream, "PNG")
    return stream.getvalue()
