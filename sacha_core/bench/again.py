"""How far a run agrees with itself: every bench once more when all are done, and what its times were then.

Repeating at once shows little: on a machine shared with strangers, or whose clock follows its heat, speed moves over minutes.
"""

from __future__ import annotations

import math
from dataclasses import replace
from typing import Any

import numpy as np

from sacha_core.bench.clock import AGAIN, is_median
from sacha_core.bench.result import Bench, Row
from sacha_core.bench.store import Record

__all__ = ["has_times", "noise_of", "with_repeat"]

NINETEEN_OF_TWENTY = 0.95


def has_times(bench: Bench) -> bool:
    """Tell whether anything was timed."""
    return any(is_median(key) for row in (*bench.rows, *bench.more) for key in row)


def with_repeat(first: Record, second: Record, later_s: float) -> Record:
    """Put the times of a bench's second run beside those of its first, and say how far they differ.

    Args:
        first: what the tables show.
        second: the same bench, run by the same process later.
        later_s: by how many seconds.

    Returns:
        The first, with `NAME_again_ms` beside every `NAME_ms` that both have, and a note.
    """
    bench, theirs = first.bench, dict[tuple[Any, ...], Row]()
    for table in bench.tables:
        theirs |= {(table.name, table.key_of(row)): row for row in second.bench.of(table)}
    keys = {table.name: table.key_of for table in bench.tables}

    def joined(rows: list[Row]) -> list[Row]:
        return [
            {**row, **_again(row, theirs.get((name, keys[name](row)), {}))} if (name := row["table"]) in keys else row
            for row in rows
        ]

    repeated = replace(bench, rows=joined(bench.rows), more=joined(bench.more))
    noise = noise_of(repeated.rows, repeated.more)
    if noise is not None:
        note = f"Run again {later_s / 60:.0f} minutes later: nineteen of twenty times within a factor of {math.exp(noise):.2f}."
        repeated = replace(repeated, notes=(*bench.notes, note))
    return replace(first, bench=repeated)


def noise_of(*parts: list[Row]) -> float | None:
    """Give the natural logarithm of the factor that nineteen of twenty times stay within when repeated; None where nothing was."""
    pairs = [pair for rows in parts for row in rows for pair in _pairs(row)]
    if not pairs:
        return None
    return float(np.quantile([abs(math.log(again / first)) for first, again in pairs], NINETEEN_OF_TWENTY))


def _again(row: Row, other: Row) -> Row:
    return {_again_of(key): other[key] for key in row if is_median(key) and other.get(key)}


def _pairs(row: Row) -> list[tuple[float, float]]:
    return [(row[key], row[_again_of(key)]) for key in row if is_median(key) and row[key] and row.get(_again_of(key))]


def _again_of(key: str) -> str:
    return key.removesuffix("_ms") + AGAIN
