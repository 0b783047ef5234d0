"""Which views and which parts of them are looked at closely, and at which levels; quality plays no part in the choice."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from itertools import product

import numpy as np
from jaxtyping import Bool

from sacha_core.evaluate.region_masks import RegionMasks
from sacha_core.evaluate.report.subject import Subject
from sacha_core.evaluate.splits import spread
from sacha_core.interchange.capture import View
from sacha_core.regions.scheme import PAPER

__all__ = ["Crop", "box_around", "closest_levels", "find_crops"]

LOOKED_AT = 48  # held-out views among which the best to see a region is sought
MARGIN = 0.15  # of the region's size, on every side
ASPECT = 3 / 2
STRAY_PERCENT = 1  # of a region's pixels on each side that may lie outside: single ones far off make no box


@dataclass(frozen=True)
class Crop:
    """Part of a view.

    Args:
        region: that it is about.
        view: held out from training.
        rows: of the image.
        columns: of the image.
        inside: (h, w) the region's pixels, of the whole image.
    """

    region: str
    view: View
    rows: slice
    columns: slice
    inside: Bool[np.ndarray, "h w"]


def find_crops(subject: Subject, regions: Sequence[str]) -> list[Crop]:
    """Find for each region the held-out view of an unseen expression that shows most of it; one that none shows is left out."""
    masks = RegionMasks(subject.capture, subject.head)
    views = spread(subject.capture.test, LOOKED_AT)
    found = []
    for region in regions:
        label = PAPER.label(region)
        sizes = [int((masks.region_of_pixel(view, subject.width, subject.height) == label).sum()) for view in views]
        if views and max(sizes) > 0:
            view = views[int(np.argmax(sizes))]
            inside = masks.region_of_pixel(view, subject.width, subject.height) == label
            found.append(Crop(region, view, *box_around(inside), inside))
    return found


def box_around(inside: Bool[np.ndarray, "h w"]) -> tuple[slice, slice]:
    """Give rows and columns of a box around the pixels of a region, with a margin, in the proportions of all crops, within the image."""
    ys, xs = np.nonzero(inside)
    top, bottom = np.percentile(ys, (STRAY_PERCENT, 100 - STRAY_PERCENT))
    left, right = np.percentile(xs, (STRAY_PERCENT, 100 - STRAY_PERCENT))
    height, width = (bottom - top + 1) * (1 + 2 * MARGIN), (right - left + 1) * (1 + 2 * MARGIN)
    width, height = max(width, height * ASPECT), max(height, width / ASPECT)
    shrink = min(1.0, inside.shape[0] / height, inside.shape[1] / width)
    return (
        _span((top + bottom + 1) / 2, round(height * shrink), inside.shape[0]),
        _span((left + right + 1) / 2, round(width * shrink), inside.shape[1]),
    )


def _span(middle: float, length: int, limit: int) -> slice:
    start = min(max(round(middle - length / 2), 0), limit - length)
    return slice(start, start + length)


def closest_levels(sizes: Mapping[str, Mapping[int, int]]) -> dict[str, int]:
    """Choose a level for each variant so that all take about the same bytes; among equals the finest.

    Args:
        sizes: bytes of each variant by level.

    Returns:
        A level by variant: the smallest ratio of the largest to the smallest.
    """
    names = list(sizes)
    best, chosen = (math.inf, 0.0), {}
    for levels in product(*(sorted(sizes[name]) for name in names)):
        logs = [math.log(sizes[name][level]) for name, level in zip(names, levels, strict=True)]
        rank = (round(max(logs) - min(logs), 9), -sum(logs))
        if rank < best:
            best, chosen = rank, dict(zip(names, levels, strict=True))
    return chosen
