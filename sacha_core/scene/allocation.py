"""What decided where Gaussians went: sensitivities, and each region's modulator, threshold and ratio.

They come from the scores file beside the avatar, which holds every event of density control; without one, an avatar that keeps its
sensitivities (an archive, a model folder) still tells those and the modulators that follow from them.
"""

from __future__ import annotations

import numpy as np
from jaxtyping import Float

from sacha_core.avatar.binding import sigmoid
from sacha_core.avatar.gaussians import Gaussians
from sacha_core.density.events import Calibration
from sacha_core.density.modulators import modulators
from sacha_core.density.region_means import region_means
from sacha_core.density.scores_file import Scores
from sacha_core.regions.partition import Partition
from sacha_core.regions.scheme import SCHEMES
from sacha_core.scene.measures import Measure, mean_over
from sacha_core.scene.scales import Kind

__all__ = ["allocation_measures", "last_calibration"]

# name: label, what it is, scale
TOLD: dict[str, tuple[str, str, Kind]] = {
    "modulator": (
        "Modulator",
        "Mean sensitivity of the head over that of the region: below 1 where people look, which grows sooner and is pruned less",
        "factor",
    ),
    "threshold": (
        "Threshold",
        "Gradient in the picture above which the region's Gaussians multiply: low where people look",
        "level",
    ),
    "ratio": ("Pruning Ratio", "Share of the region's Gaussians that pruning takes: low where people look", "level"),
}


def allocation_measures(
    gaussians: Gaussians, scores: Scores | None, n_faces: int, regions: Partition | None
) -> list[Measure]:
    """Give what is known of sensitivity, modulator, threshold and ratio; what is not known is left out.

    Args:
        gaussians: of the avatar; their own sensitivities, where they have any, come before those of the scores file.
        scores: of the avatar, or None.
        n_faces: triangles of the head.
        regions: of the triangles; None leaves modulators, thresholds and ratios out, which are numbers of regions.
    """
    scored = gaussians if gaussians.sensitivity_logit is not None else None if scores is None else scores.gaussians
    measures = [] if scored is None else [_sensitivity(scored, scored is gaussians, n_faces, regions)]
    if regions is None:
        return measures
    last = last_calibration(scores, regions)
    if last is not None:
        return [*measures, *(_of_regions(name, _numbers(getattr(last, name)), regions) for name in TOLD)]
    if scored is None:
        return measures
    means = region_means(_sensitivities(scored), regions.labels[scored.binding], len(regions.regions))
    return [*measures, _of_regions("modulator", modulators(means), regions)]


def last_calibration(scores: Scores | None, regions: Partition) -> Calibration | None:
    """Give what regions were last measured to be; None where there is none, or of other regions: a user's own go by no common name."""
    if scores is None or scores.scheme != regions.name or scores.scheme not in SCHEMES:
        return None
    calibrations = [event for event in scores.events if isinstance(event, Calibration)]
    return calibrations[-1] if calibrations else None


def _sensitivities(gaussians: Gaussians) -> Float[np.ndarray, " n"]:
    assert gaussians.sensitivity_logit is not None
    return sigmoid(gaussians.sensitivity_logit.astype(np.float64))


def _sensitivity(gaussians: Gaussians, own: bool, n_faces: int, regions: Partition | None) -> Measure:
    sensitivity = _sensitivities(gaussians)
    by_region = (
        None if regions is None else mean_over(regions.labels[gaussians.binding], sensitivity, len(regions.regions))
    )
    return Measure(
        "sensitivity",
        "Sensitivity",
        "",
        "Mean perceptual sensitivity of the Gaussians, 0 to 1: how much people would notice errors there"
        + ("" if own else " (of all that were scored, before pruning)"),
        "level",
        mean_over(gaussians.binding, sensitivity, n_faces).astype(np.float32),
        by_region,
    )


def _of_regions(name: str, numbers: Float[np.ndarray, " r"], regions: Partition) -> Measure:
    label, about, kind = TOLD[name]
    return Measure(name, label, "", about, kind, numbers[regions.labels].astype(np.float32), numbers)


def _numbers(of: tuple[float | None, ...]) -> Float[np.ndarray, " r"]:
    return np.array([np.nan if number is None else number for number in of], np.float64)
