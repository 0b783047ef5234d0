"""The tables of a report, laid out to be read."""

from __future__ import annotations

from collections.abc import Sequence
from itertools import product

from sacha_core.evaluate.ablation.result import UNCOMPRESSED
from sacha_core.evaluate.report.entry import NOVEL_EXPRESSION, NOVEL_VIEW, SETTINGS, Entry
from sacha_core.evaluate.report.grid import Grid, Index
from sacha_core.evaluate.report.own import BYTES
from sacha_core.evaluate.report.runs import Runs
from sacha_core.evaluate.report.text import DECIMALS, value
from sacha_core.regions.scheme import PAPER

__all__ = ["SHORT_SETTINGS", "TWO_LINES", "coded_grid", "region_count_grid", "region_quality_grid", "variant_grid"]

SHORT_SETTINGS = {NOVEL_VIEW: "view", NOVEL_EXPRESSION: "expression"}
KILOBYTE = 1000.0
METRIC_TITLES = {
    "psnr": "PSNR (dB)",
    "ssim": "SSIM",
    "flip": "FLIP",
    "lpips_vgg": "LPIPS (VGG)",
    "lpips_alex": "LPIPS (Alex)",
}
TWO_LINES = "Of two lines in a cell the first is the novel view's, the second the novel expression's."
PLUS_MINUS = "Mean ± standard deviation over the seeds."


def variant_grid(runs: Runs, own: Sequence[Entry], lpips_hint: str) -> Grid:
    """Lay out what each variant came to before coding.

    Args:
        runs: of one capture.
        own: the variants' own figures.
        lpips_hint: how to get LPIPS, said where it was not measured.
    """
    find = Index(own, runs.dataset)
    names = ("Gaussians", "visible Gaussians", "hidden share", "empty faces", "training time")

    def pictures(variant: str, metric: str) -> list[Entry | None]:
        return [find(variant, metric, setting=setting, level=UNCOMPRESSED) for setting in SETTINGS]

    shown = [
        m for m in METRIC_TITLES if any(_has(entry) for variant in runs.variants for entry in pictures(variant, m))
    ]
    lacking = [title for metric, title in METRIC_TITLES.items() if metric not in shown]
    note = f"{PLUS_MINUS} {TWO_LINES} Pictures are drawn from the trained avatars themselves."
    if lacking:
        note += f" Not measured: {', '.join(lacking)}." + (f" {lpips_hint}" if "LPIPS" in lacking[-1] else "")
    header = (
        "variant",
        "seeds",
        "Gaussians",
        "visible",
        "hidden %",
        "empty faces",
        "training (s)",
        *(METRIC_TITLES[m] for m in shown),
    )
    rows = []
    for variant in runs.variants:
        cells = [value(find(variant, name), DECIMALS[name]) for name in names]
        cells += ["\n".join(value(entry, DECIMALS[m]) for entry in pictures(variant, m)) for m in shown]
        rows.append((variant, _seeds(runs, variant), *cells))
    return Grid("Each variant before coding", note, header, tuple(rows))


def coded_grid(runs: Runs, own: Sequence[Entry]) -> Grid:
    """Lay out what each variant came to at each level of the codec."""
    find = Index(own, runs.dataset)
    metrics = ("psnr", "ssim", "flip")
    rows = []
    for variant, level in product(runs.variants, runs.levels):
        size = value(find(variant, BYTES, level=level), 1, KILOBYTE)
        cells = [
            "\n".join(
                value(find(variant, metric, setting=setting, level=level), DECIMALS[metric]) for setting in SETTINGS
            )
            for metric in metrics
        ]
        rows.append((variant, str(level), size, *cells))
    note = f"{PLUS_MINUS} {TWO_LINES} 1 KB is 1000 bytes; bytes of the Gaussians alone, motion not counted."
    header = ("variant", "level", "Gaussians (KB)", *(METRIC_TITLES[metric] for metric in metrics))
    return Grid("Each variant at each level of the codec", note, header, tuple(rows), folded=True)


def region_quality_grid(runs: Runs, own: Sequence[Entry], metric: str) -> Grid:
    """Lay out a measure within each region, before coding."""
    find = Index(own, runs.dataset)
    rows = [
        (
            variant,
            SHORT_SETTINGS[setting],
            *(
                value(find(variant, metric, setting=setting, region=region, level=UNCOMPRESSED), DECIMALS[metric])
                for region in PAPER.regions
            ),
        )
        for variant, setting in product(runs.variants, SETTINGS)
    ]
    title = f"{METRIC_TITLES[metric]} within each region, before coding"
    return Grid(title, PLUS_MINUS, ("variant", "setting", *PAPER.regions), tuple(rows), folded=True)


def region_count_grid(runs: Runs, own: Sequence[Entry]) -> Grid:
    """Lay out how many Gaussians each region has, and what steered them."""
    find = Index(own, runs.dataset)
    quantities = {
        "Gaussians": 0, "visible Gaussians": 0, "Gaussians before pruning": 0, "first modulator": 2, "last modulator": 2,
        "threshold": 6, "ratio": 3,
    }  # fmt: skip
    rows = [
        (variant, quantity, *(value(find(variant, quantity, region=region), decimals) for region in PAPER.regions))
        for variant, (quantity, decimals) in product(runs.variants, quantities.items())
    ]
    note = f"{PLUS_MINUS} A modulator below 1 spends more on a region; threshold and ratio are those at the end."
    return Grid(
        "Gaussians and modulators by region", note, ("variant", "quantity", *PAPER.regions), tuple(rows), folded=True
    )


def _has(entry: Entry | None) -> bool:
    return entry is not None and entry.n_seeds > 0


def _seeds(runs: Runs, variant: str) -> str:
    """Say how many seeds a variant was run with, and which are missing."""
    there = runs.of(variant).keys()
    lacking = [str(seed) for seed in runs.seeds if seed not in there]
    return str(len(there)) + (f" of {len(runs.seeds)} (no {', '.join(lacking)})" if lacking else "")
