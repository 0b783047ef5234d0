"""The tables of a report in which variants are held against one another, laid out to be read."""

from __future__ import annotations

from collections.abc import Sequence
from itertools import product

from sacha_core.evaluate.ablation.result import UNCOMPRESSED
from sacha_core.evaluate.report.comparisons import STEPS
from sacha_core.evaluate.report.entry import SETTINGS, Entry
from sacha_core.evaluate.report.grid import Grid, Index
from sacha_core.evaluate.report.grids import SHORT_SETTINGS
from sacha_core.evaluate.report.own import BYTES
from sacha_core.evaluate.report.rates import BD_RATE, EQUAL_BYTES, TOP_BYTES
from sacha_core.evaluate.report.runs import Runs
from sacha_core.evaluate.report.targets import Outcome
from sacha_core.evaluate.report.text import DECIMALS, MISSING, difference, number
from sacha_core.regions.scheme import PAPER

__all__ = ["difference_grid", "equal_flip_grid", "rate_grid", "region_rate_grid", "target_grid"]

PAIRED = "Mean ± standard deviation of the differences by seed; in brackets how many of the pairs are above 0."


def target_grid(outcomes: Sequence[Outcome]) -> Grid:
    """Lay out targets with what was measured and whether they held, one row a target, the settings side by side."""
    by_claim: dict[str, list[Outcome]] = {}
    for outcome in outcomes:
        by_claim.setdefault(outcome.claim, []).append(outcome)
    header = (
        "sacha is meant to reach",
        *(text for name in SHORT_SETTINGS.values() for text in (f"measured, {name}", f"{name}")),
    )
    rows = tuple(
        (claim, *(text for one in found for text in (_measured(one.measured), _verdict(one))))
        for claim, found in by_claim.items()
    )
    note = (
        f"{PAIRED} Bytes by the mean BD-rate over PSNR; FLIP by its mean difference at equal bytes, below 0 is better."
    )
    return Grid("Targets", note, header, rows)


def difference_grid(runs: Runs, entries: Sequence[Entry], baseline: str) -> Grid:
    """Lay out every variant's differences from the baseline before coding, and its bytes at the finest level."""
    find = Index(entries, runs.dataset)
    finest = max(runs.levels, default=None)
    pictures = list(product(("psnr", "ssim", "flip"), SETTINGS))
    header = ["variant", "Gaussians", "visible", "hidden share, points"]
    header += [] if finest is None else [f"bytes at level {finest}"]
    header += [f"{metric.upper()}, {SHORT_SETTINGS[setting]}" for metric, setting in pictures]
    rows = []
    for variant in runs.variants:
        if variant == baseline:
            continue
        cells = [difference(find(variant, name, against=baseline), 1) for name in ("Gaussians", "visible Gaussians")]
        cells += [_points(find(variant, "hidden share", against=baseline))]
        cells += [] if finest is None else [difference(find(variant, BYTES, against=baseline, level=finest), 1)]
        cells += [
            difference(find(variant, metric, against=baseline, setting=setting, level=UNCOMPRESSED), DECIMALS[metric])
            for metric, setting in pictures
        ]
        rows.append((variant, *cells))
    return Grid(f"Differences from {baseline}, before coding", PAIRED, tuple(header), tuple(rows))


def rate_grid(runs: Runs, entries: Sequence[Entry]) -> Grid:
    """Lay out each step's change of Gaussians, and of bytes at equal quality."""
    find = Index(entries, runs.dataset)
    rows = []
    for step in STEPS:
        if not {step.variant, step.against} <= set(runs.variants):
            continue
        cells = [difference(find(step.variant, "Gaussians", against=step.against), 1)]
        for quantity, setting in product((f"{BD_RATE} (psnr)", f"{TOP_BYTES} (psnr)", f"{BD_RATE} (flip)"), SETTINGS):
            cells.append(_rate(find(step.variant, quantity, against=step.against, setting=setting)))
        rows.append((step.name, f"{step.variant} against {step.against}", *cells))
    header: tuple[str, ...] = ("step", "pair", "Gaussians")
    for title in ("bytes at equal PSNR", "at the best common PSNR", "bytes at equal FLIP"):
        header += tuple(f"{title}, {name}" for name in SHORT_SETTINGS.values())
    note = f"{PAIRED} Bytes of the Gaussians after coding; below 0 the first of the pair needs fewer. At equal quality is the BD-rate."
    return Grid("Steps: bytes at equal quality", note, header, tuple(rows))


def equal_flip_grid(runs: Runs, entries: Sequence[Entry]) -> Grid:
    """Lay out each step's change of FLIP at equal bytes, overall and where people look."""
    find = Index(entries, runs.dataset)
    places = list(product((None, "mouth", "eyes", "ears"), SETTINGS))
    rows = [
        (
            step.name,
            f"{step.variant} against {step.against}",
            *(
                _rate(
                    find(step.variant, f"{EQUAL_BYTES} (flip)", against=step.against, setting=setting, region=region), 4
                )
                for region, setting in places
            ),
        )
        for step in STEPS
        if {step.variant, step.against} <= set(runs.variants)
    ]
    header = ("step", "pair", *(f"{region or 'overall'}, {SHORT_SETTINGS[setting]}" for region, setting in places))
    return Grid("Steps: FLIP at equal bytes", f"{PAIRED} Below 0 the first of the pair is better.", header, tuple(rows))


def region_rate_grid(runs: Runs, entries: Sequence[Entry]) -> Grid:
    """Lay out each step's change of bytes at equal PSNR of each region."""
    find = Index(entries, runs.dataset)
    rows = [
        (
            f"{step.variant} against {step.against}",
            SHORT_SETTINGS[setting],
            *(
                _rate(find(step.variant, f"{BD_RATE} (psnr)", against=step.against, setting=setting, region=region))
                for region in (None, *PAPER.regions)
            ),
        )
        for step, setting in product(STEPS, SETTINGS)
        if {step.variant, step.against} <= set(runs.variants)
    ]
    header = ("pair", "setting", "overall", *PAPER.regions)
    note = f"{PAIRED} BD-rate: bytes of all Gaussians at equal PSNR of the region."
    return Grid("Steps: bytes at equal PSNR within each region", note, header, tuple(rows), folded=True)


def _measured(entry: Entry) -> str:
    return _rate(entry, 1 if entry.unit == "%" else 4)


def _verdict(outcome: Outcome) -> str:
    return outcome.verdict + (f": {outcome.remark}" if outcome.remark else "")


def _rate(entry: Entry | None, decimals: int = 1) -> str:
    """Set a comparison of curves; where none has a value, say why."""
    if entry is None:
        return MISSING
    if entry.n_seeds:
        return difference(entry, decimals)
    reasons = {reason.partition(": ")[2] or reason for reason in entry.seeds.missing.values()}
    return "; ".join(sorted(reasons)) or MISSING


def _points(entry: Entry | None) -> str:
    """Set a difference of percentages, which is in points and not percent."""
    if entry is None or not entry.n_seeds:
        return MISSING
    spread = f" ± {number(entry.sd, 1)}" if entry.n_seeds > 1 else ""
    return f"{number(entry.mean, 1, signed=True)}{spread} ({entry.n_positive}/{entry.n_seeds})"
