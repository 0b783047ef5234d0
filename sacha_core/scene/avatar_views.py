"""Everything that can be shown of where an avatar's Gaussians went, and the difference to another avatar."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from jaxtyping import Float

from sacha_core.avatar.gaussians import Gaussians
from sacha_core.density.events import Pruning
from sacha_core.density.scores_file import Scores
from sacha_core.regions.partition import Partition
from sacha_core.scene.allocation import allocation_measures
from sacha_core.scene.comparison import changes
from sacha_core.scene.measures import Measure, gaussian_measures, total_over, view_of
from sacha_core.scene.region_table import Before, RegionTable, region_table, whole_bytes
from sacha_core.scene.view import View

__all__ = ["Shown", "avatar_table", "avatar_views", "measures_of"]


@dataclass(frozen=True)
class Shown:
    """An avatar and what is known of it beside its Gaussians.

    Args:
        name: for people.
        gaussians: bound to f triangles.
        scores: of its Gaussians, or None.
        n_bytes: (f,) bytes that each triangle takes in its file, or None where there is no such file.
    """

    name: str
    gaussians: Gaussians
    scores: Scores | None = None
    n_bytes: Float[np.ndarray, " f"] | None = None


def measures_of(shown: Shown, area_cm2: Float[np.ndarray, " f"], regions: Partition | None) -> list[Measure]:
    """Give all that is known of an avatar, triangle by triangle and region by region."""
    count, density, opacity = gaussian_measures(shown.gaussians, area_cm2, regions)
    spent = [] if shown.n_bytes is None else [_bytes_measure(shown.n_bytes, regions)]
    allocated = allocation_measures(shown.gaussians, shown.scores, len(area_cm2), regions)
    return [count, density, *spent, opacity, *allocated]


def _bytes_measure(n_bytes: Float[np.ndarray, " f"], regions: Partition | None) -> Measure:
    return Measure(
        "bytes",
        "Bytes",
        "bytes",
        "Bytes of the file that describe the Gaussians: of the triangle, or of the whole region",
        "amount",
        n_bytes.astype(np.float32),
        None if regions is None else total_over(regions, n_bytes),
    )


def avatar_views(measures: Sequence[Measure], before: Sequence[Measure] | None) -> dict[str, View]:
    """Give the views of measures, and of their changes where there is something to compare with."""
    shown = [*measures, *(changes(measures, before) if before is not None else [])]
    return {measure.name: view_of(measure) for measure in shown}


def avatar_table(
    shown: Shown, area_cm2: Float[np.ndarray, " f"], regions: Partition, compared: Shown | None
) -> RegionTable:
    """Give the table of regions: before is what the avatar is compared with, else what its scores file holds."""
    count = np.bincount(shown.gaussians.binding, minlength=len(regions.labels))
    before = None
    if compared is not None:
        then = None if compared.n_bytes is None else whole_bytes(total_over(regions, compared.n_bytes))
        before = Before(compared.name, _counts(compared.gaussians, regions), then)
    elif shown.scores is not None:
        pruned = any(isinstance(event, Pruning) for event in shown.scores.events)
        before = Before("before pruning" if pruned else "when scored", _counts(shown.scores.gaussians, regions))
    return region_table(regions, count, area_cm2, shown.n_bytes, before)


def _counts(gaussians: Gaussians, regions: Partition) -> np.ndarray:
    return np.bincount(regions.labels[gaussians.binding], minlength=len(regions.regions))
