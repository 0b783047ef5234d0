"""The crop that was drawn into the whole picture, as numbers that a screen or a video takes."""

from __future__ import annotations

import numpy as np

from sacha_core.parallel.kernels.kernel import kernel


@kernel(error_model="numpy")
def show_bytes(red, green, blue, out):
    """Write a row (w,) of each plane to `out` (3 w,), 0 to 1 as 0 to 255, rounded to the nearest, halves to the even."""
    zero, one, full = np.float32(0), np.float32(1), np.float32(255)
    for i in range(red.size):
        out[3 * i] = np.uint8(np.rint(min(max(red[i], zero), one) * full))
        out[3 * i + 1] = np.uint8(np.rint(min(max(green[i], zero), one) * full))
        out[3 * i + 2] = np.uint8(np.rint(min(max(blue[i], zero), one) * full))


@kernel
def show_floats(red, green, blue, out):
    """Write a row (w,) of each plane to `out` (3 w,), as it is."""
    for i in range(red.size):
        out[3 * i], out[3 * i + 1], out[3 * i + 2] = red[i], green[i], blue[i]


@kernel
def clear(background, out):
    """Write the background (3,) to a row (3 w,)."""
    for i in range(out.size // 3):
        out[3 * i], out[3 * i + 1], out[3 * i + 2] = background[0], background[1], background[2]


@kernel
def wipe(row, y, old, left, right, top, bottom, background):
    """Clear what an old crop (left, top, right, bottom) left in row y (3 w,) of a picture, but for the part that a new one will cover."""
    old_left, old_top, old_right, old_bottom = old
    if old_top <= y < old_bottom:
        if top <= y < bottom:
            clear(background, row[3 * old_left : 3 * max(min(old_right, left), old_left)])
            clear(background, row[3 * min(max(old_left, right), old_right) : 3 * old_right])
        else:
            clear(background, row[3 * old_left : 3 * old_right])


@kernel
def place_bytes(planes, left, top, old, background, start, stop, out):
    """Put planes (3, h, w) into the rows `start` to `stop` of `out` (H, 3 W) as bytes, and the background where only an old crop was."""
    right, bottom = left + planes.shape[2], top + planes.shape[1]
    for y in range(start, stop):
        wipe(out[y], y, old, left, right, top, bottom, background)
        if top <= y < bottom:
            show_bytes(planes[0, y - top], planes[1, y - top], planes[2, y - top], out[y, 3 * left : 3 * right])


@kernel
def place_floats(planes, left, top, old, background, start, stop, out):
    """Do the same with numbers as they are."""
    right, bottom = left + planes.shape[2], top + planes.shape[1]
    for y in range(start, stop):
        wipe(out[y], y, old, left, right, top, bottom, background)
        if top <= y < bottom:
            show_floats(planes[0, y - top], planes[1, y - top], planes[2, y - top], out[y, 3 * left : 3 * right])
