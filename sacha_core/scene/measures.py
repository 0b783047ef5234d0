"""What can be counted and measured on an avatar, triangle by triangle and region by region."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float, Int, Integer

from sacha_core.avatar.binding import sigmoid
from sacha_core.avatar.gaussians import Gaussians
from sacha_core.regions.partition import Partition
from sacha_core.scene.scales import Kind, number_text, scale_of
from sacha_core.scene.view import Numbers, RegionNumber, View

__all__ = ["Measure", "areas_cm2", "density_measure", "gaussian_measures", "mean_over", "total_over", "view_of"]

CM2 = 1e4  # in a square metre


@dataclass(frozen=True)
class Measure:
    """Numbers of triangles and of regions, before they have colours.

    Args:
        name: by which attributes and options refer to it.
        label: for people.
        unit: of the numbers; empty where they have none.
        about: what it is, in a sentence.
        kind: how it is scaled.
        values: (f,) int32 or float32; NaN where nothing is known.
        by_region: (r,) of whole regions, NaN where nothing is known; whole where `values` are. None where regions are not known.
    """

    name: str
    label: str
    unit: str
    about: str
    kind: Kind
    values: Numbers
    by_region: Float[np.ndarray, " r"] | None


def view_of(measure: Measure) -> View:
    """Give a measure its colours and legends; whole regions have a scale of their own, since totals are far above what triangles have."""
    scale = scale_of(measure.values, measure.kind)
    labels = scale.labels(signed=measure.kind == "change")
    rows = scale.levels(np.array(scale.ticks)).tolist()
    legend = [{"label": label, "level": row} for label, row in zip(labels, rows, strict=True)]
    return View(
        measure.label,
        measure.unit,
        measure.about,
        measure.values,
        scale.levels(measure.values),
        scale.palette,
        legend,
        _region_numbers(measure),
    )


def _region_numbers(measure: Measure) -> list[RegionNumber]:
    if measure.by_region is None:
        return []
    whole = bool(np.issubdtype(measure.values.dtype, np.integer))
    numbers = np.rint(measure.by_region).astype(np.int64) if whole else measure.by_region
    rows = scale_of(numbers, measure.kind).levels(numbers).tolist()
    return [
        RegionNumber(value, row, _signed(measure, value, whole))
        for value, row in zip(measure.by_region.tolist(), rows, strict=True)
    ]


def _signed(measure: Measure, value: float, whole: bool) -> str:
    text = number_text(value, whole)
    return f"+{text}" if measure.kind == "change" and value > 0 else text


def gaussian_measures(
    gaussians: Gaussians, area_cm2: Float[np.ndarray, " f"], regions: Partition | None
) -> list[Measure]:
    """Give what follows from the Gaussians alone: their count, count per area, and opacity mass.

    Args:
        gaussians: bound to f triangles.
        area_cm2: (f,) of the person's neutral triangles.
        regions: of the triangles, or None where they are not known.
    """
    count = np.bincount(gaussians.binding, minlength=len(area_cm2)).astype(np.int32)
    opacity = sigmoid(gaussians.opacity_logit.astype(np.float64))
    mass = np.bincount(gaussians.binding, opacity, len(area_cm2)).astype(np.float32)
    return [
        Measure(
            "count",
            "Count",
            "",
            "How many Gaussians there are: on the triangle, or in the whole region",
            "amount",
            count,
            None if regions is None else total_over(regions, count),
        ),
        density_measure(count, area_cm2, regions),
        Measure(
            "opacity",
            "Opacity Mass",
            "",
            "Sum of the opacities of the Gaussians, each 0 to 1: of the triangle, or of the whole region",
            "amount",
            mass,
            None if regions is None else total_over(regions, mass),
        ),
    ]


def density_measure(
    count: Int[np.ndarray, " f"], area_cm2: Float[np.ndarray, " f"], regions: Partition | None
) -> Measure:
    """Give Gaussians per square centimetre of the person's neutral head; of a region, its Gaussians over its area."""

    def over(number: Float[np.ndarray, " m"], area: Float[np.ndarray, " m"]) -> Float[np.ndarray, " m"]:
        return np.asarray(np.divide(number, area, out=np.full(len(area), np.nan), where=area > 0))

    by_region = None if regions is None else over(total_over(regions, count), total_over(regions, area_cm2))
    return Measure(
        "density",
        "Per cm²",
        "/cm²",
        "Gaussians for each square centimetre of the neutral head",
        "amount",
        over(count.astype(np.float64), area_cm2).astype(np.float32),
        by_region,
    )


def areas_cm2(vertices: Float[np.ndarray, "v 3"], faces: Int[np.ndarray, "f 3"]) -> Float[np.ndarray, " f"]:
    """Give the area of each triangle, square centimetres, of vertices in metres."""
    corners = vertices.astype(np.float64)[faces]
    cross = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    area: np.ndarray = CM2 * np.linalg.norm(cross, axis=1) / 2
    return area


def mean_over(
    groups: Integer[np.ndarray, " n"], values: Float[np.ndarray, " n"], n_groups: int
) -> Float[np.ndarray, " g"]:
    """Average numbers group by group; NaN where a group has none."""
    members = np.bincount(groups, minlength=n_groups)
    sums = np.bincount(groups, values, n_groups)
    return np.asarray(np.divide(sums, members, out=np.full(n_groups, np.nan), where=members > 0))


def total_over(regions: Partition, values: Numbers) -> Float[np.ndarray, " r"]:
    """Sum numbers of triangles by region; NaN counts for nothing."""
    return np.bincount(regions.labels, np.nan_to_num(values.astype(np.float64)), len(regions.regions))
