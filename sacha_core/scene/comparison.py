"""Two avatars of one head, one against the other: what the first has more or less of, triangle by triangle and region by region."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from sacha_core.scene.measures import Measure

__all__ = ["changes"]


def changes(measures: Sequence[Measure], before: Sequence[Measure]) -> list[Measure]:
    """Give the difference of every measure that both avatars have: the first's number less the other's.

    Args:
        measures: of the avatar that is shown.
        before: of the one that it is compared with, on the same triangles and regions.

    Returns:
        Measures of the same order, `NAME_change`; not known (NaN) where one of the two is not.
    """
    known = {measure.name: measure for measure in before}
    return [_change(measure, known[measure.name]) for measure in measures if measure.name in known]


def _change(after: Measure, before: Measure) -> Measure:
    whole = np.issubdtype(after.values.dtype, np.integer)
    values = after.values.astype(np.float64) - before.values.astype(np.float64)
    by_region = None
    if after.by_region is not None and before.by_region is not None:
        by_region = after.by_region - before.by_region
    return Measure(
        f"{after.name}_change",
        f"{after.label}: Change",
        after.unit,
        f"Here less there: {after.about[0].lower()}{after.about[1:]}",
        "change",
        np.rint(values).astype(np.int32) if whole else values.astype(np.float32),
        by_region,
    )
