"""What `sacha ablate` says at its end: a table, and the report with its pictures."""

from __future__ import annotations

import json
import shlex
from collections.abc import Sequence
from pathlib import Path
from typing import Any

from sacha_core.bench.machine import describe, sentence
from sacha_core.cli.console import Console, table
from sacha_core.errors import FormatError
from sacha_core.evaluate.ablation.ablate import Ablated
from sacha_core.evaluate.ablation.datasets import known_datasets
from sacha_core.evaluate.ablation.plan import PlannedRun
from sacha_core.evaluate.ablation.result import Point, RunResult
from sacha_core.evaluate.report import Subject, write_report
from sacha_core.files import write_aside
from sacha_core.flame.head_file import load_head
from sacha_core.interchange.capture import read_capture

__all__ = ["make_report", "note_conditions", "tell"]

REPORT = "report"
CONDITIONS = "conditions.json"
SHOWN_LEVEL = 2  # in the table at the end; the report has all


def note_conditions(out: Path, runs: Sequence[PlannedRun], command: Sequence[str]) -> None:
    """Write down what a stranger must know of the runs, for reports to come.

    Raises:
        OSError: the file cannot be written.
    """
    first = runs[0]
    judging = first.judging
    size = (first.options.width, first.options.height)
    conditions = {
        "machine": sentence(describe()),
        "command": shlex.join(["sacha", *command[1:]]),
        "iterations": f"{first.options.schedule.iterations:,}",
        "trained on images of": "the stored size" if size[0] is None else f"{size[0]} x {size[1]} pixels",
        "judged on": f"at most {judging.images} images of the held-out camera and as many held-out expressions, at the stored size; "
        f"FLIP and LPIPS on {judging.flip_images} of each, evenly spread",
        "coded": "with nothing left out by the codec",
    }
    with write_aside(out / CONDITIONS) as aside:
        aside.write_text(json.dumps(conditions, indent=2) + "\n", encoding="utf-8")


def make_report(out: Path, results: Sequence[RunResult], console: Console) -> Path:
    """Write the report of an ablation's results into its folder; give the page.

    Raises:
        SachaError: a run's files are damaged.
        OSError: a file cannot be read or written.
    """
    subjects, wanted = {}, {result.dataset for result in results}
    for dataset in known_datasets(out):
        if dataset.name in wanted:
            capture = read_capture(dataset.root)
            size = capture.val[0].camera
            subjects[dataset.name] = Subject(capture, load_head(dataset.head), size.width, size.height)
    paths = write_report(
        results, out / REPORT, runs=out, subjects=subjects, conditions=conditions_of(out), report=console.report
    )
    return paths.html


def conditions_of(out: Path) -> dict[str, str]:
    """Read what was noted of an ablation's runs; nothing where nobody did.

    Raises:
        FormatError: the file is damaged.
    """
    path = out / CONDITIONS
    if not path.is_file():
        return {}
    try:
        return {str(label): str(text) for label, text in json.loads(path.read_bytes()).items()}
    except (ValueError, AttributeError) as error:
        raise FormatError(f"{path} does not hold conditions: {error}") from error


def tell(out: Path, done: Ablated, report: Path | None, console: Console) -> dict[str, Any]:
    """Say what came out; give it for machines."""
    if done.kept:
        console.say(f"kept         {done.kept} results that were there already")
    console.say()
    console.say(summary(done.results))
    for outcome in done.failures:
        console.say(f"failed       {outcome.name}: {outcome.error}")
    if report is not None:
        console.wrote("report", report)
    return {
        "folder": out,
        "report": report,
        "results": [result.to_json() for result in done.results],
        "broken": [f"{outcome.name}: {outcome.error}" for outcome in done.failures],
    }


def summary(results: Sequence[RunResult]) -> str:
    """Give a line for each variant of each capture: means over seeds, uncompressed and at level 2 or the nearest."""
    rows = []
    groups: dict[tuple[str, str], list[RunResult]] = {}
    for result in results:
        groups.setdefault((result.dataset, result.variant), []).append(result)
    for (dataset, variant), group in groups.items():
        point = [nearest(result, SHOWN_LEVEL) for result in group]
        cells = (
            f"{mean([r.n for r in group]):,.0f}",
            f"{mean([r.n_visible for r in group]):,.0f}",
            f"{mean([p.bytes.gaussians for p in point]) / 1000:,.1f} KB",
            f"{mean([p.novel_view.psnr for p in point]):.2f} dB",
            f"{mean([p.novel_expression.psnr for p in point]):.2f} dB",
        )
        rows.append((dataset, variant, str(len(group)), *cells))
    titles = (
        "dataset",
        "variant",
        "seeds",
        "Gaussians",
        "that show",
        f"level {SHOWN_LEVEL}",
        "view PSNR",
        "expression PSNR",
    )
    return table(titles, rows, words=(0, 1))


def nearest(result: RunResult, level: int) -> Point:
    """Give the point whose level is nearest."""
    return min(result.points, key=lambda point: (point.level == 0, abs(point.level - level)))


def mean(values: Sequence[float]) -> float:
    """Give the mean."""
    return sum(values) / len(values)
