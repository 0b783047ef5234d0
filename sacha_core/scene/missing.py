"""What cannot be shown of an avatar, and what would help."""

from __future__ import annotations

from sacha_core.regions.partition import Partition
from sacha_core.scene.allocation import last_calibration
from sacha_core.scene.avatar_views import Shown

__all__ = ["missing_views"]


def missing_views(shown: Shown, regions: Partition | None) -> list[str]:
    """Say which views there could be, and how to get them."""
    lines = []
    if shown.n_bytes is None:
        lines.append("Bytes: encode it, and open the .sacha file")
    if shown.scores is None:
        have = shown.gaussians.sensitivity_logit is not None
        lacking = "Threshold and pruning ratio" if have else "Sensitivity, modulator, threshold and pruning ratio"
        lines.append(f"{lacking}: Measure tells (`sacha score`)")
    elif regions is not None and last_calibration(shown.scores, regions) is None:
        lines.append(
            f"Threshold and pruning ratio: its scores file has none for the regions {regions.name!r}; Measure tells (`sacha score`)"
        )
    return lines
