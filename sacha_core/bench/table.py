"""Setting rows as text."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Any

from sacha_core.bench.result import Row, Table

__all__ = ["cell", "cells", "markdown"]

DIGITS = 3
SMALLEST_PLAIN = 1e-3  # below, powers of ten read better than zeros


def cell(value: Any, decimals: int | None = None) -> str:
    """Give a value as a reader wants it: thousands apart, three digits that count, nothing for what is missing."""
    if isinstance(value, float):
        return number(value, decimals)
    if isinstance(value, bool):
        return "yes" if value else "no"
    if isinstance(value, int):
        return f"{value:,}"
    return "" if value is None else str(value)


def number(value: float, decimals: int | None) -> str:
    """Set a number with so many decimals, or by default with three digits that count."""
    if math.isnan(value):
        return ""
    size = abs(value)
    if decimals is None and 0 < size < SMALLEST_PLAIN:
        return f"{value:.1e}"
    if decimals is None:
        decimals = 0 if size in {0, math.inf} else max(DIGITS - 1 - math.floor(math.log10(size)), 0)
    return f"{value:,.{decimals}f}"


def cells(table: Table, rows: Sequence[Row]) -> tuple[list[str], list[list[str]]]:
    """Give the titles and the cells of a table, leaving out columns in which every cell is empty."""
    filled = [[cell(row.get(column.key), column.decimals) for column in table.columns] for row in rows]
    kept = [i for i in range(len(table.columns)) if any(line[i] for line in filled)]
    return [table.columns[i].title for i in kept], [[line[i] for i in kept] for line in filled]


def markdown(table: Table, rows: Sequence[Row]) -> str:
    """Set a table in Markdown: its caption, and figures to the right."""
    titles, lines = cells(table, rows)
    right = [all(_is_figure(line[i]) for line in lines) for i in range(len(titles))]
    rule = ["---:" if figures else "---" for figures in right]
    body = "\n".join(
        "| " + " | ".join(text.replace("|", "\\|") for text in line) + " |" for line in (titles, rule, *lines)
    )
    return f"{table.caption}\n\n{body}\n"


def _is_figure(text: str) -> bool:
    return not text or text[0].isdigit() or text[0] in "-+.<"
