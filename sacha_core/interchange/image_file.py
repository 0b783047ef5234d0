"""Image files as captures have them: what Pillow raises for a broken one, and transparency taken for white."""

from __future__ import annotations

from PIL import Image

__all__ = ["BROKEN_IMAGE", "on_white"]

# Pillow's ways of saying "broken": the last is a header that promises more pixels than anyone has memory for.
BROKEN_IMAGE = (OSError, SyntaxError, ValueError, Image.DecompressionBombError)


def on_white(picture: Image.Image) -> Image.Image:
    """Give a picture as RGB, with what is transparent white."""
    if picture.mode == "RGB":
        return picture.copy()  # decodes, so that the file may be closed
    if "A" not in picture.getbands() and "transparency" not in picture.info:
        return picture.convert("RGB")
    coloured = picture.convert("RGBA")
    white = Image.new("RGBA", coloured.size, (255, 255, 255, 255))
    return Image.alpha_composite(white, coloured).convert("RGB")
