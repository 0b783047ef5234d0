"""Paired differences: a variant's figure less another's with the same seed, so that what the seed does to both cancels."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from itertools import product

from sacha_core.evaluate.ablation.result import UNCOMPRESSED
from sacha_core.evaluate.report.entry import SETTINGS, Entry, Seeds
from sacha_core.evaluate.report.own import BYTES, OWN
from sacha_core.evaluate.report.quantities import COUNTS, PICTURE
from sacha_core.evaluate.report.runs import Runs

__all__ = ["DIFFERENCES", "difference_entries", "paired"]

DIFFERENCES = "differences"


def difference_entries(runs: Runs, pairs: Sequence[tuple[str, str]], own: Sequence[Entry]) -> list[Entry]:
    """Give the differences of pairs of variants on one capture, by seed.

    Args:
        runs: of the capture.
        pairs: (variant, against).
        own: the variants' own figures, as `own_entries` gives them.

    Returns:
        For each pair the counts and bytes, as percent of the other's where that makes sense, and the measures of pictures, uncompressed.
    """
    found = {_key(entry): entry for entry in own if entry.dataset == runs.dataset and entry.table == OWN}
    return [entry for variant, against in pairs for entry in _of_pair(runs, variant, against, found)]


def _of_pair(runs: Runs, variant: str, against: str, found: dict[tuple[object, ...], Entry]) -> Iterator[Entry]:
    def pair(quantity: str, relative: bool, setting: str | None = None, level: int | None = None) -> Entry | None:
        one, other = (found.get((name, quantity, setting, None, level)) for name in (variant, against))
        if one is None or other is None:
            return None
        unit = "%" if relative else one.unit
        seeds = paired(one.seeds, other.seeds, _percent if relative else _less)
        return Entry(DIFFERENCES, runs.dataset, variant, quantity, unit, seeds, against, setting, level=level)

    entries = [pair(name, count.relative) for name, count in COUNTS.items()]
    entries += [pair(BYTES, True, level=level) for level in runs.levels]
    entries += [pair(metric, False, setting, UNCOMPRESSED) for setting, metric in product(SETTINGS, PICTURE)]
    yield from (entry for entry in entries if entry is not None)


def paired(one: Seeds, other: Seeds, compare: Callable[[float, float], float | None]) -> Seeds:
    """Compare two figures seed by seed; a seed counts only where both have a value that can be compared."""
    values, missing = {}, {**one.missing, **other.missing}
    for seed in sorted(one.values.keys() & other.values.keys()):
        value = compare(one.values[seed], other.values[seed])
        if value is None:
            missing[seed] = "the other is 0"
        else:
            values[seed] = value
    return Seeds(values, missing)


def _less(one: float, other: float) -> float:
    return one - other


def _percent(one: float, other: float) -> float | None:
    return 100 * (one / other - 1) if other else None


def _key(entry: Entry) -> tuple[object, ...]:
    return (entry.variant, entry.quantity, entry.setting, entry.region, entry.level)
