"""Pictures that are drawn into again and again."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float

from sacha_core.animation.kernels.picture import place_bytes, place_floats
from sacha_core.errors import OptionError
from sacha_core.parallel.pool import Pool, even_ranges

__all__ = ["Canvas"]

NOTHING = (0, 0, 0, 0)
N_SHEETS = 2  # so that a picture can still be looked at while the next is drawn


@dataclass
class Sheet:
    """One picture, and where something other than background is: left, top, right, bottom."""

    pixels: np.ndarray
    drawn: tuple[int, int, int, int] = NOTHING


class Canvas:
    """Whole pictures of which only what was drawn before is wiped, and only what is drawn now is written.

    Args:
        background: of each channel, 0 to 1.
        dtype: uint8 for 0 to 255, or float32 for what was blended.
        pool: shares out the work.

    Raises:
        OptionError: another dtype, or a background that is not finite.
    """

    def __init__(
        self, background: Float[np.ndarray, "3"], dtype: type[np.uint8] | type[np.float32], pool: Pool
    ) -> None:
        if np.dtype(dtype) not in {np.dtype(np.uint8), np.dtype(np.float32)}:
            raise OptionError(f"pictures of {np.dtype(dtype)} were asked for, expected uint8 or float32")
        if background.shape != (3,) or not np.isfinite(background).all():
            raise OptionError(f"background is {background.tolist()}, expected three finite numbers")
        self._place = place_bytes if np.dtype(dtype) == np.uint8 else place_floats
        self._background = np.empty(3, dtype)
        pixel = background.astype(np.float32).reshape(3, 1, 1)
        self._place(pixel, 0, 0, NOTHING, self._background, 0, 1, self._background.reshape(1, 3))
        self._pool = pool
        self._sheets: list[Sheet] = []

    def show(self, planes: Float[np.ndarray, "3 h w"], left: int, top: int, width: int, height: int) -> np.ndarray:
        """Give the picture of `width` x `height` pixels that has `planes` at `left`, `top`, and the background elsewhere.

        Returns:
            (height, width, 3), not to be written to; holds until the call after the next.
        """
        sheet = self._next(width, height)
        right, bottom = left + planes.shape[2], top + planes.shape[1]
        rows = sheet.pixels.reshape(height, 3 * width)
        old = sheet.drawn
        first, last = min(top, old[1]), max(bottom, old[3])
        bounds = even_ranges(last - first, self._pool.threads)

        def job(_: int, k: int) -> None:
            start, stop = first + bounds[k], first + bounds[k + 1]
            self._place(planes, left, top, old, self._background, start, stop, rows)

        sheet.drawn = (0, 0, width, height)  # until all rows are in place, whatever interrupts
        self._pool.run(job, len(bounds) - 1)
        sheet.drawn = (left, top, right, bottom)
        picture = sheet.pixels.view()
        picture.flags.writeable = False
        return picture

    def _next(self, width: int, height: int) -> Sheet:
        """Give the sheet that was shown longest ago; new ones at another size."""
        if self._sheets and self._sheets[0].pixels.shape != (height, width, 3):
            self._sheets.clear()
        if len(self._sheets) < N_SHEETS:
            fresh = np.empty((height, width, 3), self._background.dtype)
            fresh[:] = self._background
            self._sheets.append(Sheet(fresh))
        else:
            self._sheets.append(self._sheets.pop(0))
        return self._sheets[-1]
