"""Tables as JSON and CSV, for other programs."""

from __future__ import annotations

import csv
import json
from collections.abc import Mapping, Sequence
from dataclasses import asdict
from pathlib import Path

from sacha_core.evaluate.report.entry import Entry, Seeds
from sacha_core.evaluate.report.grid import Grid
from sacha_core.evaluate.report.own import NOT_MEASURED
from sacha_core.evaluate.report.targets import Outcome
from sacha_core.files import write_aside

__all__ = ["write_csv", "write_json"]

COLUMNS = tuple(Entry("", "", "", "", "", Seeds({})).record())


def write_json(
    path: Path,
    conditions: Mapping[str, str],
    entries: Sequence[Entry],
    outcomes: Sequence[Outcome],
    grids: Mapping[str, Sequence[Grid]],
) -> None:
    """Write everything: conditions, entries with the value of every seed, targets, and the tables as they are read.

    Raises:
        OSError: it cannot be written.
    """
    record = {
        "conditions": dict(conditions),
        "targets": [
            {"claim": one.claim, "verdict": one.verdict, "remark": one.remark, "measured": one.measured.record()}
            for one in outcomes
        ],
        "entries": [entry.record() for entry in entries if measured(entry)],
        "tables": {dataset: [asdict(grid) for grid in some] for dataset, some in grids.items()},
    }
    text = json.dumps(record, indent=1, ensure_ascii=False, allow_nan=False)
    with write_aside(path) as aside:
        aside.write_text(text + "\n", encoding="utf-8")


def write_csv(path: Path, entries: Sequence[Entry]) -> None:
    """Write one line an entry; `by_seed` holds `seed=value`, apart by semicolons.

    Raises:
        OSError: it cannot be written.
    """
    records = [entry.record() for entry in entries if measured(entry)]
    for record in records:
        record["by_seed"] = ";".join(f"{seed}={value!r}" for seed, value in record["by_seed"].items())
    with write_aside(path) as aside, aside.open("w", newline="", encoding="utf-8") as stream:
        writer = csv.DictWriter(stream, COLUMNS)
        writer.writeheader()
        writer.writerows(records)


def measured(entry: Entry) -> bool:
    """Whether an entry has a value, or a reason for having none that says more than that nobody measured it."""
    return entry.n_seeds > 0 or not all(reason.endswith(NOT_MEASURED) for reason in entry.seeds.missing.values())
