"""FLIP: how visible the difference is that one sees when flipping between two images."""

from __future__ import annotations

import importlib.util
import math

import numpy as np
from jaxtyping import Float

from sacha_core.errors import OptionError
from sacha_core.perception.psnr import Image

__all__ = ["PIXELS_PER_DEGREE", "flip", "flip_map", "missing"]

PIXELS_PER_DEGREE = 67.0  # a 4K display of 0.7 m width seen from 0.7 m, which the paper takes for usual
REACH_DEGREES = 3 * math.sqrt(
    0.04 / (2 * math.pi**2)
)  # of FLIP's widest filter: three deviations of the blue-yellow one


def missing() -> str | None:
    """Say what FLIP needs and is not here; None where it can be measured."""
    if importlib.util.find_spec("flip_evaluator") is None:
        return 'FLIP needs the package flip-evaluator: python -m pip install "flip-evaluator>=1.7"'
    return None


def flip_map(drawn: Image, truth: Image, pixels_per_degree: float = PIXELS_PER_DEGREE) -> Float[np.ndarray, "h w"]:
    """Give the error of each pixel as an observer would see it who flips between both images.

    Only the rectangle in which they differ is compared, and as much around it as FLIP's filters reach; elsewhere the error is 0.

    Args:
        drawn: (h, w, 3) sRGB, float in [0, 1] (clamped if beyond), or uint8.
        truth: (h, w, 3), likewise.
        pixels_per_degree: of the observer's view.

    Returns:
        (h, w) float32 from 0, no difference, to 1.

    Raises:
        ValueError: their shapes differ.
        OptionError: the package is missing.

    Source: Andersson et al., FLIP: a difference evaluator for alternating images, 2020, by the authors' package.
    """
    if drawn.shape != truth.shape:
        raise ValueError(f"images of shapes {drawn.shape} and {truth.shape} cannot be compared")
    lacking = missing()
    if lacking:
        raise OptionError(lacking)
    from flip_evaluator.nbflip import evaluate  # noqa: PLC0415 - a package that is not everybody's

    test, reference = unit_float32(drawn), unit_float32(truth)
    errors = np.zeros(drawn.shape[:2], np.float32)
    differs = (test != reference).any(axis=2)
    if not differs.any():
        return errors
    reach = math.ceil(REACH_DEGREES * pixels_per_degree)
    looked_at, written = (tuple(span(differs.any(axis=1 - axis), r) for axis in (0, 1)) for r in (2 * reach, reach))
    options = {"ppd": float(pixels_per_degree)}
    crops = (np.ascontiguousarray(x[looked_at]) for x in (reference, test))
    found = evaluate(*crops, False, True, False, False, options)[0]  # no HDR, sRGB, no colours, no mean
    inside = tuple(slice(w.start - s.start, w.stop - s.start) for w, s in zip(written, looked_at, strict=True))
    errors[written] = found[inside][..., 0]
    return errors


def flip(drawn: Image, truth: Image, pixels_per_degree: float = PIXELS_PER_DEGREE) -> float:
    """Mean FLIP error over all pixels, 0 to 1, the lower the better; arguments and errors as of `flip_map`."""
    return float(flip_map(drawn, truth, pixels_per_degree).mean(dtype=np.float64))


def unit_float32(image: Image) -> Float[np.ndarray, "h w c"]:
    """Give the image in float32 within [0, 1]; uint8 is divided by 255."""
    if image.dtype == np.uint8:
        return np.divide(image, np.float32(255), dtype=np.float32)
    return np.clip(image, 0, 1).astype(np.float32)


def span(marked: np.ndarray, margin: int) -> slice:
    """Give the range from the first to the last marked row or column, with a margin, within the image."""
    places = np.flatnonzero(marked)
    return slice(max(int(places[0]) - margin, 0), min(int(places[-1]) + margin + 1, len(marked)))
