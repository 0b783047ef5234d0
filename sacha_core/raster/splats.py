"""What is drawn: Gaussians in world space with one colour each, and the gradients by them."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float

from sacha_core.errors import OptionError, SachaError

__all__ = ["LARGEST_COLOUR", "MAX_CHANNELS", "ColourError", "SplatGradients", "Splats"]

MAX_CHANNELS = 4
LARGEST_COLOUR = np.float32(1e30)  # beyond, gradients of what lies under a splat overflow though its image does not


class ColourError(SachaError):
    """A colour cannot be drawn.

    Args:
        row: of the Gaussian.
        colour: its channels.
    """

    def __init__(self, row: int, colour: list[float]) -> None:
        super().__init__(f"the colour of Gaussian {row} is {colour}, expected numbers between +-{LARGEST_COLOUR:g}")
        self.row = row


@dataclass(frozen=True)
class Splats:
    """n Gaussians in world space, activated, ready to be drawn.

    Means, scales, quaternions or opacities that are not finite make a Gaussian vanish; colours must be finite, and below 1e30.

    Args:
        means: (n, 3) metres.
        scales: (n, 3) standard deviations, metres.
        quaternions: (n, 4) wxyz, of any length.
        opacities: (n,) 0 to 1.
        colours: (n, c) one to four channels.
    """

    means: Float[np.ndarray, "n 3"]
    scales: Float[np.ndarray, "n 3"]
    quaternions: Float[np.ndarray, "n 4"]
    opacities: Float[np.ndarray, " n"]
    colours: Float[np.ndarray, "n c"]

    def __len__(self) -> int:
        """Give the number of Gaussians."""
        return len(self.means)

    @property
    def channels(self) -> int:
        """Number of colour channels."""
        return int(self.colours.shape[1])

    def prepared(self) -> Splats:
        """Give the same as contiguous float32, checked.

        Raises:
            OptionError: shapes disagree, or there are more than four channels.
            ColourError: a colour is not finite, or so large that gradients would not be.
        """
        arrays = {
            name: np.ascontiguousarray(getattr(self, name), np.float32)
            for name in ("means", "scales", "quaternions", "opacities", "colours")
        }
        n = len(arrays["means"])
        for name, width in (("means", 3), ("scales", 3), ("quaternions", 4)):
            if arrays[name].shape != (n, width):
                raise OptionError(f"splat {name} have shape {arrays[name].shape}, expected {(n, width)}")
        if arrays["opacities"].shape != (n,):
            raise OptionError(f"splat opacities have shape {arrays['opacities'].shape}, expected {(n,)}")
        colours = arrays["colours"]
        if colours.ndim != 2 or len(colours) != n or not 1 <= colours.shape[1] <= MAX_CHANNELS:
            raise OptionError(f"splat colours have shape {colours.shape}, expected ({n}, 1 to {MAX_CHANNELS})")
        if not (colours.min(initial=0) > -LARGEST_COLOUR and colours.max(initial=0) < LARGEST_COLOUR):  # true for NaN
            row = int(np.argmin((np.abs(colours) < LARGEST_COLOUR).all(axis=1)))
            raise ColourError(row, colours[row].tolist())
        return Splats(**arrays)


@dataclass(frozen=True)
class SplatGradients:
    """Gradients of a loss by what was drawn, each in the shape of its argument.

    Args:
        means: (n, 3) per metre.
        scales: (n, 3) per metre.
        quaternions: (n, 4) at right angles to each quaternion.
        opacities: (n,).
        colours: (n, c).
        means_2d: (n, 2) by the projected means, per pixel: what density control collects.
    """

    means: Float[np.ndarray, "n 3"]
    scales: Float[np.ndarray, "n 3"]
    quaternions: Float[np.ndarray, "n 4"]
    opacities: Float[np.ndarray, " n"]
    colours: Float[np.ndarray, "n c"]
    means_2d: Float[np.ndarray, "n 2"]
