"""Where the eye would notice: the reference sensitivity map of an image."""

from __future__ import annotations

import math
from typing import Literal

import numpy as np
from jaxtyping import Bool, Int16, UInt8
from PIL import Image

__all__ = ["resized_sensitivity", "sensitivity_map"]

GAMMA = 1.5
EDGE = 0.05  # gradient magnitude, of an image in [0, 1], above which a pixel is an edge
BLOCK = 5
BAND = 64  # rows at a time
FRACTION = 0.3  # of a block's pixels that must be edges, above which the block is sensitive

_BRIGHTEN = np.rint(255 * (np.arange(256) / 255) ** (1 / GAMMA)).astype(np.uint8).tolist()
_LEAST = math.floor((EDGE * 255) ** 2) + 1  # squared length of the shortest whole-numbered gradient that is an edge
_ENOUGH = math.isqrt(_LEAST - 1) + 1  # of either part of a gradient, to be an edge whatever the other


def sensitivity_map(
    image: UInt8[np.ndarray, "h w 3"], pad: Literal["replicate", "zero"] = "replicate"
) -> Bool[np.ndarray, "h w"]:
    """Mark the 5 x 5 blocks of an image that are dense in edges.

    Luma, brightened by a gamma of 1.5; Sobel magnitude above 0.05 makes an edge; a block with more than 30 % edges is sensitive. Blocks are
    spread to the image's size by nearest neighbour, so that up to four rows and columns that fill no block share the last ones.

    Args:
        image: (h, w, 3) RGB as stored, not resized.
        pad: what lies beyond the border. "zero" is what the reference does, and marks the two top corners of a white image;
            "replicate" has no such edge.

    Returns:
        (h, w) true where sensitive; all false where an image has less than five rows or columns.

    Source: Zhou et al., Perceptual-GS, 2025.
    """
    luma = np.asarray(Image.fromarray(image).convert("L").point(_BRIGHTEN))
    padded = np.pad(luma, 1, mode="edge" if pad == "replicate" else "constant")
    height, width = luma.shape
    edges = np.empty((height, width), bool)
    for top in range(0, height, BAND):  # what lies between stays in the cache
        edges[top : top + BAND] = _edges(padded[top : top + BAND + 2].astype(np.int16))
    rows, columns = height // BLOCK, width // BLOCK
    if not rows or not columns:
        return np.zeros((height, width), bool)
    whole = edges[: rows * BLOCK, : columns * BLOCK].view(np.uint8)
    by_row = np.add.reduce([whole[step::BLOCK] for step in range(BLOCK)], dtype=np.uint8)
    counts = np.add.reduce([by_row[:, step::BLOCK] for step in range(BLOCK)], dtype=np.uint8)
    blocks = counts > FRACTION * BLOCK * BLOCK
    at_row, at_column = np.arange(height) * rows // height, np.arange(width) * columns // width
    spread: np.ndarray = blocks.take(at_row, axis=0).take(at_column, axis=1)
    return spread


def resized_sensitivity(sensitive: Bool[np.ndarray, "h w"], width: int, height: int) -> UInt8[np.ndarray, "h2 w2"]:
    """Resize a map to the resolution trained at; 255 stands for 1, and between the two where pixels were merged.

    Args:
        sensitive: (h, w) as `sensitivity_map` gives it.
        width: wanted, pixels.
        height: wanted, pixels.

    Source: Zhou et al., Perceptual-GS, 2025 (bicubic).
    """
    full = Image.fromarray(sensitive.astype(np.uint8) * 255)
    return np.asarray(full if full.size == (width, height) else full.resize((width, height), Image.Resampling.BICUBIC))


def _edges(padded: Int16[np.ndarray, "h2 w2"]) -> Bool[np.ndarray, "h w"]:
    """Mark where the 3 x 3 Sobel gradient is long, in integers: no rounding stands between a pixel and the threshold."""
    along = padded[:, 2:] - padded[:, :-2]
    x = along[1:-1] * np.int16(2)
    x += along[:-2]
    x += along[2:]
    down = padded[2:] - padded[:-2]
    y = down[:, 1:-1] * np.int16(2)
    y += down[:, :-2]
    y += down[:, 2:]
    for part in (x, y):  # cut at what is enough, so that squares stay small
        np.abs(part, out=part)
        np.minimum(part, np.int16(_ENOUGH), out=part)
        np.multiply(part, part, out=part)
    x += y
    edges: np.ndarray = x >= np.int16(_LEAST)
    return edges
