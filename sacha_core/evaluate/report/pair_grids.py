"""The tables of a report in which variants are held against one another, laid out to be read."""

from __future__ import annotations

from collections.abc import Sequence

from sacha_core.evaluate.ablation.result import UNCOMPRESSED
from sacha_core.evaluate.report.comparisons import BYTE_TARGETS, STEPS, Step
from sacha_core.evaluate.report.entry import SETTINGS, Entry
from sacha_core.evaluate.report.grid import Grid, Index
from sacha_core.evaluate.report.grids import SHORT_SETTINGS, TWO_LINES
from sacha_core.evaluate.report.own import BYTES
from sacha_core.evaluate.report.rates import BD_RATE, EQUAL_BYTES, TOP_BYTES
from sacha_core.evaluate.report.runs import Runs
from sacha_core.evaluate.report.targets import Outcome
from sacha_core.evaluate.report.text import DECIMALS, MISSING, difference, number
from sacha_core.regions.scheme import PAPER

__all__ = [
    "TARGETED",
    "difference_grid",
    "equal_flip_grid",
    "glance_grid",
    "rate_grid",
    "region_rate_grid",
    "tally",
    "target_grid",
]

THOUSANDTH = 1e-3
TARGETED = "sacha"
CONTROLS = ("sacha-uniform", "sacha-inverted", "sacha-random")
PAIRED = "Mean ± standard deviation of the differences by seed; in brackets how many of the pairs are above 0."


def target_grid(outcomes: Sequence[Outcome]) -> Grid:
    """Lay out targets with what was measured and whether they held, one row a target, the settings side by side."""
    by_claim: dict[str, list[Outcome]] = {}
    for outcome in outcomes:
        by_claim.setdefault(outcome.claim, []).append(outcome)
    header = (
        "sacha is meant to reach",
        *(f"{text}, {name}" for name in SHORT_SETTINGS.values() for text in ("measured", "verdict")),
    )
    rows = tuple(
        (claim, *(text for one in found for text in (_measured(one.measured), _verdict(one))))
        for claim, found in by_claim.items()
    )
    note = f"{PAIRED} Bytes by the mean BD-rate over PSNR; FLIP, in thousandths, by its mean difference at equal bytes, below 0 is better."
    return Grid("Targets", note, header, rows)


def glance_grid(outcomes: Sequence[Outcome], rates: Sequence[Entry]) -> Grid:
    """Lay out the targets of all captures in a few lines: bytes by pair, how many of FLIP's targets held, and what the controls say.

    Args:
        outcomes: of all targets.
        rates: as `rate_entries` gives them, for the controls: the same method with other modulators.
    """
    rows = []
    controls = [name for name in CONTROLS if any(entry.against == name for entry in rates)]
    for dataset, setting in dict.fromkeys((one.measured.dataset, one.measured.setting) for one in outcomes):
        here = [one for one in outcomes if (one.measured.dataset, one.measured.setting) == (dataset, setting)]
        cells = []
        for target in BYTE_TARGETS:
            (bytes_needed,) = [o for o in here if o.measured.against == target.against and o.measured.unit == "%"]
            cells.append(f"{bytes_needed.verdict}\n{_measured(bytes_needed.measured)}")
        perceived = [one for one in here if one.measured.unit != "%"]
        find = Index(rates, dataset)
        cells += [tally(perceived)]
        cells += [_rate(find(TARGETED, f"{BD_RATE} (psnr)", against=name, setting=setting)) for name in controls]
        rows.append((f"{dataset}\nnovel {SHORT_SETTINGS[setting or '']}", *cells))
    header = (
        "capture",
        *(f"bytes against {t.against}: {t.fewer_percent:g} % fewer wanted" for t in BYTE_TARGETS),
        "all targets of FLIP",
        *(f"control: bytes against {name}" for name in controls),
    )
    note = PAIRED
    if controls:
        note += (
            " Controls are sacha itself with no modulators of regions (uniform), inverted or random ones: only where it needs fewer bytes "
            "than these do the regions' modulators pay in PSNR."
        )
    return Grid("At a glance: sacha at equal PSNR", note, header, tuple(rows))


def difference_grid(runs: Runs, entries: Sequence[Entry], baseline: str) -> Grid:
    """Lay out every variant's differences from the baseline before coding, and its bytes at the finest level."""
    find = Index(entries, runs.dataset)
    finest = max(runs.levels, default=None)
    metrics = ("psnr", "ssim", "flip")
    rows = []
    for variant in runs.variants:
        if variant == baseline:
            continue
        cells = [difference(find(variant, name, against=baseline), 1) for name in ("Gaussians", "visible Gaussians")]
        cells += [_points(find(variant, "hidden share", against=baseline))]
        cells += [] if finest is None else [difference(find(variant, BYTES, against=baseline, level=finest), 1)]
        for metric in metrics:
            both = [
                find(variant, metric, against=baseline, setting=setting, level=UNCOMPRESSED) for setting in SETTINGS
            ]
            cells.append("\n".join(difference(entry, DECIMALS[metric]) for entry in both))
        rows.append((variant, *cells))
    bytes_title = () if finest is None else (f"bytes at level {finest}",)
    header = ("variant", "Gaussians", "visible", "hidden share, points", *bytes_title, "PSNR (dB)", "SSIM", "FLIP")
    return Grid(f"Differences from {baseline}, before coding", f"{PAIRED} {TWO_LINES}", header, tuple(rows))


def rate_grid(runs: Runs, entries: Sequence[Entry]) -> Grid:
    """Lay out each step's change of Gaussians, and of bytes at equal quality."""
    find = Index(entries, runs.dataset)
    quantities = {
        f"{BD_RATE} (psnr)": "bytes at equal PSNR",
        f"{TOP_BYTES} (psnr)": "at the best common PSNR",
        f"{BD_RATE} (flip)": "bytes at equal FLIP",
    }
    rows = []
    for step in _run(runs):
        cells = [difference(find(step.variant, "Gaussians", against=step.against), 1)]
        cells += [_both(find, step, quantity) for quantity in quantities]
        rows.append((_named(step), *cells))
    note = (
        f"{PAIRED} {TWO_LINES} Bytes of the Gaussians after coding; below 0 the first of the pair needs fewer. At equal PSNR or FLIP: "
        "the BD-rate."
    )
    return Grid("Steps: bytes at equal quality", note, ("step", "Gaussians", *quantities.values()), tuple(rows))


def equal_flip_grid(runs: Runs, entries: Sequence[Entry]) -> Grid:
    """Lay out each step's change of FLIP at equal bytes, overall and where people look."""
    find = Index(entries, runs.dataset)
    places = (None, "mouth", "eyes", "ears", "nose", "face")
    quantity = f"{EQUAL_BYTES} (flip)"
    rows = [(_named(step), *(_both(find, step, quantity, region) for region in places)) for step in _run(runs)]
    note = f"{PAIRED} {TWO_LINES} FLIP in thousandths; below 0 the first of the pair is better."
    return Grid("Steps: FLIP at equal bytes", note, ("step", *(region or "overall" for region in places)), tuple(rows))


def region_rate_grid(runs: Runs, entries: Sequence[Entry]) -> Grid:
    """Lay out each step's change of bytes at equal PSNR of each region."""
    find = Index(entries, runs.dataset)
    places = (None, *PAPER.regions)
    quantity = f"{BD_RATE} (psnr)"
    rows = [(_named(step), *(_both(find, step, quantity, region) for region in places)) for step in _run(runs)]
    note = f"{PAIRED} {TWO_LINES} BD-rate: bytes of all Gaussians at equal PSNR of the region."
    header = ("step", "overall", *PAPER.regions)
    return Grid("Steps: bytes at equal PSNR within each region", note, header, tuple(rows), folded=True)


def _run(runs: Runs) -> list[Step]:
    """Give the steps both of whose variants were run."""
    return [step for step in STEPS if {step.variant, step.against} <= set(runs.variants)]


def _both(find: Index, step: Step, quantity: str, region: str | None = None) -> str:
    """Set a comparison of curves in both settings, one a line."""
    entries = [
        find(step.variant, quantity, against=step.against, setting=setting, region=region) for setting in SETTINGS
    ]
    return "\n".join(_rate(entry) for entry in entries)


def _verdict(outcome: Outcome) -> str:
    return outcome.verdict + (f"\n{outcome.remark}" if outcome.remark else "")


def tally(outcomes: Sequence[Outcome]) -> str:
    """Sum several verdicts up in one: one target missed is enough to miss all."""
    count = {
        verdict: sum(one.verdict == verdict for one in outcomes) for verdict in ("held", "not held", "not decided")
    }
    whole = "not held" if count["not held"] else "not decided" if count["not decided"] else "held"
    return f"{whole}\n" + ", ".join(f"{n} {verdict}" for verdict, n in count.items() if n)


def _measured(entry: Entry) -> str:
    """Set a comparison of curves, FLIP's in thousandths."""
    return difference(entry, 1) if entry.unit == "%" else difference(entry, 1, THOUSANDTH)


def _rate(entry: Entry | None) -> str:
    """Set a comparison of curves; where none has a value, say why."""
    if entry is None:
        return MISSING
    if entry.n_seeds:
        return _measured(entry)
    reasons = {
        (reason.partition(": ")[2] or reason).removeprefix("the curves have ")
        for reason in entry.seeds.missing.values()
    }
    return "; ".join(sorted(reasons)) or MISSING


def _named(step: Step) -> str:
    if step.variant in step.name and step.against in step.name:
        return step.name
    return f"{step.name}\n{step.variant} against {step.against}"


def _points(entry: Entry | None) -> str:
    """Set a difference of percentages, which is in points and not percent."""
    if entry is None or not entry.n_seeds:
        return MISSING
    spread = f" ± {number(entry.sd, 1)}" if entry.n_seeds > 1 else ""
    return f"{number(entry.mean, 1, signed=True)}{spread} ({entry.n_positive}/{entry.n_seeds})"
