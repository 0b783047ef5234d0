"""The bench of skips: what is left out where nothing needs it, what that saves, and the test that shows it."""

from __future__ import annotations

from collections.abc import Callable, Iterable

from sacha_core.bench.preset import Preset
from sacha_core.bench.result import Bench, Column, Row, Table
from sacha_core.bench.skips.drawing import drawing_skips
from sacha_core.bench.skips.files import file_skips, import_skips
from sacha_core.bench.skips.playing import playing_skips
from sacha_core.bench.skips.skip import Skip
from sacha_core.bench.skips.training import training_skips
from sacha_core.progress import Progress, Report

__all__ = ["TITLE", "measure"]

TITLE = "What is skipped"
SKIPS = Table(
    "skips",
    "What is left out, against the same work with it done; the error is the largest difference of the results, 0 where all bits agree.",
    (Column("skip", "left out"), Column("with_ms", "then, ms"), Column("without_ms", "else, ms"), Column("with_kb", "then, KB"),
     Column("without_kb", "else, KB"), Column("saving_ratio", "saving, times"), Column("error", "error"), Column("proof", "proof")),
    ("skip",),
)  # fmt: skip
NOTES = (
    "Each line is timed against itself alone, turn by turn; lines are of different work and do not add up.",
    "The proof is a test of this repository, which fails where the skip changes a result.",
)


def measure(preset: Preset, report: Report) -> Bench:
    """Measure every skip."""
    rounds, budget_s = preset.of(1, 31, 101), preset.of(0.0, 2.5, 15.0)
    families: tuple[Callable[[Preset], Iterable[Skip]], ...] = (
        drawing_skips, training_skips, playing_skips, file_skips, import_skips,
    )  # fmt: skip
    rows: list[Row] = []
    for done, family in enumerate(families):
        report(Progress("bench skips", done, len(families)))
        rows += [{"table": SKIPS.name, **skip.row(rounds, budget_s)} for skip in family(preset)]
    report(Progress("bench skips", len(families), len(families)))
    broken = tuple(f"skip {row['skip']!r} changes a result by {row['error']:g}" for row in rows if row["error"])
    return Bench(rows, (SKIPS,), notes=NOTES, broken=broken)
