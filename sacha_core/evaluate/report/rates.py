"""Rate and distortion of pairs of variants: bytes at equal quality, and quality at equal bytes, by seed."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from functools import lru_cache
from itertools import product

from sacha_core.evaluate.rate_distortion import Curve, Interpolated, bd_quality, bd_rate, bytes_at, rd_curve
from sacha_core.evaluate.report.entry import SETTINGS, Entry, Seeds
from sacha_core.evaluate.report.own import NO_RUN, NOT_MEASURED, PLACES
from sacha_core.evaluate.report.quantities import PICTURE, picture_value
from sacha_core.evaluate.report.runs import Runs

__all__ = [
    "BD_RATE",
    "EQUAL_BYTES",
    "LOWER_IS_BETTER",
    "OVERLAP",
    "RATES",
    "TOP_BYTES",
    "curve_of",
    "dropped_points",
    "rate_entries",
]

RATES = "rates"
BD_RATE, EQUAL_BYTES, TOP_BYTES = "BD-rate", "difference at equal bytes", "bytes at the best common quality"
OVERLAP = "range in common"
NOT_CODED = "not coded"
LOWER_IS_BETTER = ("flip", "lpips_vgg", "lpips_alex")

Place = tuple[str, str, str | None]  # setting, measure, region


def curve_of(runs: Runs, variant: str, seed: int, place: Place) -> Curve | str:
    """Give the curve of a run over the bytes of its coded Gaussians; where there is none, say why.

    Args:
        runs: on one capture.
        variant: name of the variant.
        seed: of the run.
        place: setting, measure and region.
    """
    setting, metric, region = place
    result = runs.of(variant).get(seed)
    if result is None:
        return NO_RUN
    points = [
        (point.bytes.gaussians, picture_value(getattr(point, setting), metric, region))
        for point in result.points
        if point.level
    ]
    known = [(n_bytes, value) for n_bytes, value in points if value is not None and n_bytes]
    if not known:
        return NOT_MEASURED if points else NOT_CODED
    return rd_curve(known, metric in LOWER_IS_BETTER)


def rate_entries(runs: Runs, pairs: Sequence[tuple[str, str]]) -> list[Entry]:
    """Compare the curves of pairs of variants on one capture, over bytes of the Gaussians.

    Args:
        runs: of the capture.
        pairs: (variant, against).

    Returns:
        For each pair, setting, measure and region four entries. `BD_RATE`: percent of bytes more at equal quality, the mean over the
        qualities that both reach. `TOP_BYTES`: the same at the best quality that both reach. `EQUAL_BYTES`: how much higher the measure is
        at equal bytes, the mean over the bytes that both take; for FLIP and LPIPS less than 0 is better. `OVERLAP`: percent of the range
        of both curves' qualities that both reach; where it is small the BD-rate is little to go by.
    """
    known = lru_cache(maxsize=None)(lambda variant, seed, place: curve_of(runs, variant, seed, place))
    return [entry for pair, setting in product(pairs, SETTINGS) for entry in _of_pair(runs, pair, setting, known)]


def dropped_points(runs: Runs) -> tuple[str, ...]:
    """Say which coded levels lie on no curve, since another one is as good with no more bytes."""
    found: dict[str, list[str]] = {}
    for variant, seed, setting, metric in product(runs.variants, runs.seeds, SETTINGS, ("psnr", "flip")):
        curve = curve_of(runs, variant, seed, (setting, metric, None))
        if not isinstance(curve, str) and curve.dropped:
            name = f"{metric.upper()} of {setting.replace('_', ' ')}s"
            found.setdefault(name, []).append(f"{variant} (seed {seed}, {len(curve.dropped)})")
    return tuple(
        f"Levels that are no better than a smaller one, and left out of the curves of {name}: {', '.join(some)}."
        for name, some in found.items()
    )


def _of_pair(
    runs: Runs, pair: tuple[str, str], setting: str, known: Callable[[str, int, Place], Curve | str]
) -> Iterator[Entry]:
    variant, against = pair
    for metric, region in PLACES:
        place = (setting, metric, region)
        curves = {seed: (known(variant, seed, place), known(against, seed, place)) for seed in runs.seeds}
        for quantity, unit, compare in (
            (BD_RATE, "%", _bytes_at_equal_quality),
            (TOP_BYTES, "%", _bytes_at_best_quality),
            (EQUAL_BYTES, PICTURE[metric], _quality_at_equal_bytes),
            (OVERLAP, "%", _range_in_common),
        ):
            values, missing = {}, {}
            for seed, (one, other) in curves.items():
                found = _compared(pair, one, other, compare)
                if isinstance(found, str):
                    missing[seed] = found
                else:
                    values[seed] = found
            yield Entry(
                RATES,
                runs.dataset,
                variant,
                f"{quantity} ({metric})",
                unit,
                Seeds(values, missing),
                against,
                setting,
                region,
            )


def _compared(
    pair: tuple[str, str], one: Curve | str, other: Curve | str, compare: Callable[[Curve, Curve], Interpolated]
) -> float | str:
    if isinstance(one, str):
        return f"{pair[0]}: {one}"
    if isinstance(other, str):
        return f"{pair[1]}: {other}"
    found = compare(one, other)
    return found.reason + _who_is_better(pair, one, other) if found.value is None else found.value


def _who_is_better(pair: tuple[str, str], one: Curve, other: Curve) -> str:
    """Say of curves that miss one another which lies above; nothing where they do not."""
    (low, high), (other_low, other_high) = one.range, other.range
    if low <= other_high and other_low <= high:
        return ""
    better = (low > other_high) != one.lower_is_better
    return f", {pair[0]} is {'better' if better else 'worse'} throughout"


def _bytes_at_equal_quality(one: Curve, other: Curve) -> Interpolated:
    return bd_rate(other, one)


def _quality_at_equal_bytes(one: Curve, other: Curve) -> Interpolated:
    return bd_quality(other, one)


def _range_in_common(one: Curve, other: Curve) -> Interpolated:
    found = bd_rate(other, one)
    return found if found.value is None else Interpolated(100 * found.overlap)


def _bytes_at_best_quality(one: Curve, other: Curve) -> Interpolated:
    """Give how many percent more bytes a curve takes than another at the best quality that both reach."""
    best = max(one.range[0], other.range[0]) if one.lower_is_better else min(one.range[1], other.range[1])
    n_bytes, n_other = bytes_at(one, best), bytes_at(other, best)
    if n_bytes.value is None or n_other.value is None:
        return Interpolated(None, n_bytes.reason or n_other.reason)
    return Interpolated(100 * (n_bytes.value / n_other.value - 1))
