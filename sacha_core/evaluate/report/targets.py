"""What `sacha` was meant to reach, beside what was measured."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from typing import Literal

from sacha_core.evaluate.report.comparisons import BYTE_TARGETS, TARGET_REGIONS
from sacha_core.evaluate.report.entry import SETTINGS, Entry, Seeds
from sacha_core.evaluate.report.rates import BD_RATE, EQUAL_BYTES, OVERLAP, RATES

__all__ = ["Outcome", "Verdict", "judge_targets"]

Verdict = Literal["held", "not held", "not decided"]
LITTLE_PERCENT = 25  # of both curves' range: below, what both share is little to go by


@dataclass(frozen=True)
class Outcome:
    """One target on one capture in one setting.

    Args:
        claim: the target in words.
        measured: what it is judged by.
        verdict: whether the mean over the seeds reaches it.
        remark: what a reader must know besides; may be empty.
    """

    claim: str
    measured: Entry
    verdict: Verdict
    remark: str


def judge_targets(dataset: str, rates: Sequence[Entry]) -> list[Outcome]:
    """Hold the targets against what was measured on one capture, in both settings.

    Bytes are judged by the mean BD-rate over PSNR, FLIP by its mean difference at equal bytes; "by more than the seed spread" asks for a
    mean farther from 0 than the standard deviation of the paired differences. A seed without a value leaves a target undecided.

    Args:
        dataset: name of the capture.
        rates: as `rate_entries` gives them.

    Returns:
        Outcomes in the order of the targets, the settings side by side.
    """
    return list(_outcomes(dataset, rates))


def _outcomes(dataset: str, rates: Sequence[Entry]) -> Iterator[Outcome]:
    for target in BYTE_TARGETS:
        pair = (target.variant, target.against)
        for setting in SETTINGS:
            found = _find(rates, dataset, pair, f"{BD_RATE} (psnr)", setting, None)
            claim = f"{target.fewer_percent:g} % fewer bytes of Gaussians than {target.against} at equal PSNR"
            shared = _find(rates, dataset, pair, f"{OVERLAP} (psnr)", setting, None)
            yield _with_overlap(_judged(claim, found, found.mean <= -target.fewer_percent), shared)
        for region in (None, *TARGET_REGIONS):
            for setting in SETTINGS:
                found = _find(rates, dataset, pair, f"{EQUAL_BYTES} (flip)", setting, region)
                if region is None:
                    yield _judged(f"FLIP no worse than {target.against}'s at equal bytes", found, found.mean <= 0)
                else:
                    claim = f"FLIP in the {region} better than {target.against}'s at equal bytes, by more than the seed spread"
                    yield _judged(claim, found, found.mean < -found.sd, spread_needed=True)


def _find(
    rates: Sequence[Entry], dataset: str, pair: tuple[str, str], quantity: str, setting: str, region: str | None
) -> Entry:
    """Give the entry of a target; one without values where a variant was never run."""
    wanted = (RATES, dataset, *pair, quantity, setting, region)
    for entry in rates:
        if (
            entry.table,
            entry.dataset,
            entry.variant,
            entry.against,
            entry.quantity,
            entry.setting,
            entry.region,
        ) == wanted:
            return entry
    unit = "%" if quantity.startswith(BD_RATE) else ""
    return Entry(RATES, dataset, pair[0], quantity, unit, Seeds({}), pair[1], setting, region)


def _judged(claim: str, found: Entry, reached: bool, spread_needed: bool = False) -> Outcome:
    if not found.n_seeds:
        return Outcome(claim, found, "not decided", found.why_missing or "not both were run")
    if found.seeds.missing:
        return Outcome(claim, found, "not decided", found.why_missing)
    if spread_needed and found.n_seeds < 2:
        return Outcome(claim, found, "not decided", "one seed has no spread")
    return Outcome(claim, found, "held" if reached else "not held", "one seed only" if found.n_seeds == 1 else "")


def _with_overlap(outcome: Outcome, shared: Entry) -> Outcome:
    """Warn of curves that hardly reach the same qualities."""
    if not shared.n_seeds or min(shared.values) >= LITTLE_PERCENT:
        return outcome
    warning = f"the curves share only {min(shared.values):.0f} % of their range of PSNR"
    return replace(outcome, remark="; ".join(text for text in (outcome.remark, warning) if text))
