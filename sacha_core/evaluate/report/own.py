"""Each variant's own figures, by seed."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from functools import partial
from itertools import product

from sacha_core.evaluate.ablation.result import UNCOMPRESSED, RunResult
from sacha_core.evaluate.report.entry import SETTINGS, Entry, Seeds
from sacha_core.evaluate.report.quantities import COUNTS, PICTURE, REGION_METRICS, picture_value, size_bytes
from sacha_core.evaluate.report.runs import Runs
from sacha_core.regions.scheme import PAPER

__all__ = ["BYTES", "NOT_MEASURED", "NO_RUN", "OWN", "PLACES", "gather", "own_entries"]

OWN = "variants"
BYTES = "bytes"
NO_RUN, NOT_MEASURED = "no run", "not measured"
REGION_COUNTS = {
    "Gaussians": "n", "visible Gaussians": "n_visible", "Gaussians before pruning": "n_before", "first modulator": "modulator_first",
    "last modulator": "modulator_last", "threshold": "threshold", "ratio": "ratio",
}  # fmt: skip
# Every measure of a picture, with the region that it is taken in
PLACES: list[tuple[str, str | None]] = [(metric, None) for metric in PICTURE] + list(
    product(REGION_METRICS, PAPER.regions)
)


def own_entries(runs: Runs) -> list[Entry]:
    """Give counts, bytes and picture quality of every variant on one capture, uncompressed and at each level."""
    return [entry for variant in runs.variants for entry in _of_variant(runs, variant)]


def _of_variant(runs: Runs, variant: str) -> Iterator[Entry]:
    for name, count in COUNTS.items():
        yield Entry(OWN, runs.dataset, variant, name, count.unit, gather(runs, variant, count.read))
    for name, (quantity, field) in product(PAPER.regions, REGION_COUNTS.items()):
        seeds = gather(runs, variant, partial(_of_region, region=name, field=field))
        yield Entry(OWN, runs.dataset, variant, quantity, "", seeds, region=name)
    for level in (UNCOMPRESSED, *runs.levels):
        seeds = gather(runs, variant, partial(size_bytes, level=level))
        yield Entry(OWN, runs.dataset, variant, BYTES, "B", seeds, level=level)
        for setting, (metric, region) in product(SETTINGS, PLACES):
            seeds = gather(
                runs, variant, partial(_of_picture, level=level, setting=setting, metric=metric, region=region)
            )
            unit = PICTURE[metric]
            yield Entry(OWN, runs.dataset, variant, metric, unit, seeds, setting=setting, region=region, level=level)


def gather(runs: Runs, variant: str, read: Callable[[RunResult], float | None]) -> Seeds:
    """Read one figure off every seed's result, and say which seeds have none and why."""
    results, values, missing = runs.of(variant), {}, {}
    for seed in runs.seeds:
        value = read(results[seed]) if seed in results else None
        if value is not None:
            values[seed] = float(value)
        else:
            missing[seed] = NOT_MEASURED if seed in results else NO_RUN
    return Seeds(values, missing)


def _of_region(result: RunResult, region: str, field: str) -> float | None:
    part = result.regions.get(region)
    found = None if part is None else getattr(part, field)
    return None if found is None else float(found)


def _of_picture(result: RunResult, level: int, setting: str, metric: str, region: str | None) -> float | None:
    point = result.point(level)
    return picture_value(None if point is None else getattr(point, setting), metric, region)
