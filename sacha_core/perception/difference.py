"""What a picture differs by from another, as numbers and as a picture for people."""

from __future__ import annotations

import numpy as np
from jaxtyping import Bool, Float, UInt8

from sacha_core.perception.psnr import Image, unit_range

__all__ = ["BRIGHTEST", "covered_psnr", "error_colours", "error_legend", "pixel_error"]

# What is painted brightest where nobody says: at some 40 dB a kind's median is dark but seen, and fewer than one pixel in two hundred of
# the avatar is as bright as it gets. FLIP calls visible what differs by far less than a tenth of full scale, hence a scale of its own.
BRIGHTEST = {"difference": 0.1, "flip": 0.4}

# Black for no error, then lighter and lighter over violet and orange to a pale yellow: the order is in the lightness alone, which
# people who tell few hues apart see as well, and so does a printer; sRGB.
STOPS = ((0, 0, 0), (66, 20, 110), (165, 45, 105), (235, 105, 50), (252, 190, 70), (255, 255, 205))


def pixel_error(image: Image, truth: Image) -> Float[np.ndarray, "h w"]:
    """Give the error of each pixel: the largest of its channels' differences, 0 to 1, float32.

    Raises:
        ValueError: their shapes differ.
    """
    if image.shape != truth.shape:
        raise ValueError(f"images of shapes {image.shape} and {truth.shape} cannot be compared")
    error: np.ndarray = np.abs(unit_range(image) - unit_range(truth)).max(axis=2).astype(np.float32)
    return error


def error_colours(error: Float[np.ndarray, "h w"], brightest: float) -> UInt8[np.ndarray, "h w 3"]:
    """Paint errors: black for none, brighter for more; `brightest` and all beyond have the brightest colour.

    Args:
        error: of each pixel, from 0.
        brightest: above 0, in the unit of `error`.

    Source: own.
    """
    place = np.clip(error / brightest, 0, 1) * (len(STOPS) - 1)
    stops = np.arange(len(STOPS))
    painted = np.stack([np.interp(place, stops, [stop[channel] for stop in STOPS]) for channel in range(3)], axis=-1)
    return np.rint(painted).astype(np.uint8)


def error_legend(brightest: float) -> list[tuple[float, tuple[int, int, int]]]:
    """Give errors, from none to `brightest`, each with its colour (sRGB bytes) in a painted picture.

    Args:
        brightest: above 0, in the unit of the errors.
    """
    return [(brightest * place / (len(STOPS) - 1), colour) for place, colour in enumerate(STOPS)]


def covered_psnr(image: Image, truth: Image, covered: Bool[np.ndarray, "h w"]) -> float:
    """Give the PSNR over some pixels alone, decibels: over all, an empty background would count as a success.

    Args:
        image: (h, w, c) float in [0, 1] (clamped if beyond), or uint8.
        truth: (h, w, c), likewise.
        covered: which pixels count.

    Returns:
        Decibels; infinite where both are the same there, or no pixel counts.
    """
    difference = unit_range(image)[covered] - unit_range(truth)[covered]
    error = float(np.mean(np.square(difference))) if difference.size else 0.0
    return float("inf") if error == 0 else float(-10 * np.log10(error))
