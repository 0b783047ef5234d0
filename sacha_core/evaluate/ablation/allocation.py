"""Where a run's Gaussians went, region by region, and what density control had in mind with them."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from jaxtyping import Bool

from sacha_core.avatar.gaussians import Gaussians
from sacha_core.density.events import Calibration, Event, HiddenRemoval, Pruning
from sacha_core.evaluate.ablation.result import RegionResult
from sacha_core.flame.model import HeadModel
from sacha_core.regions.labels import label_triangles, region_counts
from sacha_core.regions.scheme import PAPER
from sacha_core.train.options import TrainOptions

__all__ = ["empty_faces", "region_results"]


def region_results(
    gaussians: Gaussians,
    visible: Bool[np.ndarray, " n"],
    head: HeadModel,
    events: Sequence[Event],
    options: TrainOptions,
) -> dict[str, RegionResult]:
    """Give what became of each region.

    Args:
        gaussians: at the end.
        visible: (n,) which of them training views show.
        head: that they are bound to.
        events: of the training.
        options: of the training.
    """
    labels = label_triangles(head)
    counts = region_counts(labels, gaussians.binding)
    shown = region_counts(labels, gaussians.binding[visible])
    calibrations = [event for event in events if isinstance(event, Calibration)]
    prunings = [event for event in events if isinstance(event, Pruning)]
    removals = [event for event in events if isinstance(event, Pruning | HiddenRemoval)]
    return {
        name: RegionResult(
            n=int(counts[r]),
            n_visible=int(shown[r]),
            n_before=removals[0].before[r] if removals else None,
            modulator_first=calibrations[0].modulator[r] if calibrations else None,
            modulator_last=calibrations[-1].modulator[r] if calibrations else None,
            threshold=(calibrations[-1].threshold[r] if calibrations else None) or options.density.threshold,
            ratio=(calibrations[-1].ratio[r] if prunings else None) or 0.0,
        )
        for r, name in enumerate(PAPER.regions)
    }


def empty_faces(gaussians: Gaussians, head: HeadModel) -> int:
    """Count the triangles without a Gaussian."""
    return head.n_faces - len(np.unique(gaussians.binding))
