"""Making a report from the results of an ablation."""

from __future__ import annotations

import importlib.util
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path

from sacha_core.errors import OptionError
from sacha_core.evaluate.ablation.result import RunResult
from sacha_core.evaluate.lpips import missing
from sacha_core.evaluate.report import grids, pair_grids
from sacha_core.evaluate.report.allocation_figure import draw_allocation
from sacha_core.evaluate.report.comparisons import pairs
from sacha_core.evaluate.report.content import Content, Picture, Section
from sacha_core.evaluate.report.crop_figure import draw_crops
from sacha_core.evaluate.report.curve_figure import draw_curves
from sacha_core.evaluate.report.differences import difference_entries
from sacha_core.evaluate.report.entry import Entry
from sacha_core.evaluate.report.grid import Grid
from sacha_core.evaluate.report.heat_figure import draw_heat_maps
from sacha_core.evaluate.report.markdown import markdown_report
from sacha_core.evaluate.report.own import own_entries
from sacha_core.evaluate.report.page import html_report
from sacha_core.evaluate.report.rates import RATES, dropped_points, rate_entries
from sacha_core.evaluate.report.run_files import RunFiles
from sacha_core.evaluate.report.runs import Runs
from sacha_core.evaluate.report.step_figure import draw_steps
from sacha_core.evaluate.report.store import write_csv, write_json
from sacha_core.evaluate.report.subject import Subject
from sacha_core.evaluate.report.targets import Outcome, judge_targets
from sacha_core.evaluate.report.words import TERMS, conditions_of, remarks_of, summary_of
from sacha_core.files import write_aside
from sacha_core.progress import Progress, Report, silent

__all__ = ["ReportPaths", "write_report"]

TITLE = "Where the Gaussians went, and what it bought"
FIGURES = "figures"
PACKAGES = ("scipy", "matplotlib")
NO_MODELS = "There are no heat maps: none of the runs' models was found."
NO_FILES = "There are no pictures close by: none of the runs' coded avatars was found."
NO_HEADS = "There are no pictures of heads: the capture or the folder of the runs was not given."


@dataclass(frozen=True)
class ReportPaths:
    """Where a report lies.

    Args:
        html: everything in one page.
        markdown: the same, with figures beside it.
        csv: one line a figure, for spreadsheets.
        json: the same with conditions and targets, for programs.
        figures: each as PNG.
    """

    html: Path
    markdown: Path
    csv: Path
    json: Path
    figures: tuple[Path, ...]


@dataclass(frozen=True)
class Findings:
    """What a report says of one capture.

    Args:
        runs: on the capture.
        entries: every figure.
        outcomes: of the targets.
        tables: as they are read.
        pictures: of the capture.
        remarks: what is missing.
    """

    runs: Runs
    entries: tuple[Entry, ...]
    outcomes: tuple[Outcome, ...]
    tables: tuple[Grid, ...]
    pictures: tuple[Picture, ...] = ()
    remarks: tuple[str, ...] = field(default=())


def write_report(
    results: Sequence[RunResult],
    out: Path,
    runs: Path | None = None,
    subjects: Mapping[str, Subject] | None = None,
    conditions: Mapping[str, str] | None = None,
    baseline: str = "default",
    report: Report = silent,
) -> ReportPaths:
    """Make tables, figures and a page of what an ablation found.

    Args:
        results: of any captures, variants and seeds; what is missing is said.
        out: folder for `report.html`, `report.md`, `tables.csv`, `tables.json` and `figures/`.
        runs: folder in which `DATASET/seed-S/VARIANT/` hold each run's model and `.sacha` files; without it there are no pictures of heads.
        subjects: by capture's name; a capture without one gets no pictures of heads.
        conditions: what a stranger must know, label to text, such as the machine.
        baseline: the variant that all others are held against.
        report: told after each capture.

    Returns:
        The files written.

    Raises:
        OptionError: there are no results, or two of the same run, or a package is missing.
        SachaError: a run's files are damaged.
        OSError: a file cannot be read or written.
    """
    if not results:
        raise OptionError("there are no results to report, expected at least one run's")
    for package in PACKAGES:
        if importlib.util.find_spec(package) is None:
            raise OptionError(f'a report needs {package}: python -m pip install "sacha[judge,shell]"')
    every, found = Runs.by_dataset(results), []
    for k, some in enumerate(every, 1):
        subject = (subjects or {}).get(some.dataset)
        found.append(findings(some, baseline, subject, None if runs is None else runs / some.dataset))
        report(Progress("report", k, len(every)))
    content = content_of(found, conditions_of(every, conditions or {}))
    figures = tuple(_write_picture(out / FIGURES / f"{picture.name}.png", picture) for picture in content.pictures)
    paths = ReportPaths(out / "report.html", out / "report.md", out / "tables.csv", out / "tables.json", figures)
    entries = [entry for one in found for entry in one.entries]
    outcomes = [outcome for one in found for outcome in one.outcomes]
    write_csv(paths.csv, entries)
    write_json(paths.json, content.conditions, entries, outcomes, {one.runs.dataset: one.tables for one in found})
    _write_text(paths.markdown, markdown_report(content, {path.stem: f"{FIGURES}/{path.name}" for path in figures}))
    _write_text(paths.html, html_report(content))
    return paths


def findings(runs: Runs, baseline: str, subject: Subject | None, folder: Path | None) -> Findings:
    """Work out everything about one capture; without its subject or its folder of runs, all but pictures of heads."""
    compared = pairs(runs.variants, baseline)
    own, rates = own_entries(runs), rate_entries(runs, compared)
    differences = difference_entries(runs, compared, own)
    outcomes = tuple(judge_targets(runs.dataset, rates)) if pair_grids.TARGETED in runs.variants else ()
    tables = (
        pair_grids.target_grid(outcomes),
        pair_grids.rate_grid(runs, [*differences, *rates]),
        pair_grids.equal_flip_grid(runs, rates),
        grids.variant_grid(runs, own, missing("vgg") or ""),
        pair_grids.difference_grid(runs, differences, baseline),
        grids.coded_grid(runs, own),
        pair_grids.region_rate_grid(runs, rates),
        *(grids.region_quality_grid(runs, own, metric) for metric in ("psnr", "flip")),
        grids.region_count_grid(runs, own),
    )
    filled = tuple(table for table in tables if table.rows)
    pictures = [draw_curves(runs, own), draw_steps(runs, rates), draw_allocation(runs, own)]
    remarks = [*remarks_of(runs), *dropped_points(runs)]
    if subject is None or folder is None:
        remarks.append(NO_HEADS)
    else:
        files = RunFiles(folder, subject)
        heads = {NO_MODELS: draw_heat_maps(runs, files, baseline), NO_FILES: draw_crops(runs, files)}
        pictures += heads.values()
        remarks += [lacking for lacking, drawn in heads.items() if drawn is None]
    shown = tuple(one for one in pictures if one is not None)
    return Findings(runs, (*own, *differences, *rates), outcomes, filled, shown, tuple(remarks))


def content_of(found: Sequence[Findings], conditions: Mapping[str, str]) -> Content:
    """Put the findings in the order in which they are read."""
    sections = tuple(
        Section(f"Capture {one.runs.dataset}", one.remarks, (*one.tables[:1], *one.pictures, *one.tables[1:]))
        for one in found
    )
    outcomes = [outcome for one in found for outcome in one.outcomes]
    rates = [entry for one in found for entry in one.entries if entry.table == RATES]
    return Content(
        TITLE,
        summary_of(outcomes),
        conditions,
        TERMS,
        sections,
        pair_grids.glance_grid(outcomes, rates) if outcomes else None,
    )


def _write_picture(path: Path, picture: Picture) -> Path:
    with write_aside(path) as aside:
        aside.write_bytes(picture.png)
    return path


def _write_text(path: Path, text: str) -> None:
    with write_aside(path) as aside:
        aside.write_text(text, encoding="utf-8")
