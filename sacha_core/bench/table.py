"""Setting rows as text."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Any

from sacha_core.bench.result import Column, Row, Table

__all__ = ["cell", "cells", "heading", "markdown", "words"]

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
    """Give the titles and the cells of a table, leaving out empty columns and those that the heading tells (see `heading`)."""
    told = {column.key for column, _ in _shared(table, rows)}
    columns = [column for column in table.columns if column.key not in told]
    filled = [[cell(row.get(column.key), column.decimals) for column in columns] for row in rows]
    kept = [i for i in range(len(columns)) if any(line[i] for line in filled)]
    return [columns[i].title for i in kept], [[line[i] for i in kept] for line in filled]


def heading(table: Table, rows: Sequence[Row]) -> str:
    """Give the caption, and what all rows have in common."""
    shared = ", ".join(f"{column.title} {text}" for column, text in _shared(table, rows))
    return f"{table.caption} In all rows: {shared}." if shared else table.caption


def markdown(table: Table, rows: Sequence[Row]) -> str:
    """Set a table in Markdown: its heading, and figures to the right."""
    titles, lines = cells(table, rows)
    left = words(lines)
    rule = ["---" if i in left else "---:" for i in range(len(titles))]
    body = "\n".join(
        "| " + " | ".join(text.replace("|", "\\|") for text in line) + " |" for line in (titles, rule, *lines)
    )
    return f"{heading(table, rows)}\n\n{body}\n"


def words(lines: Sequence[Sequence[str]]) -> set[int]:
    """Give the columns in which a cell holds something else than a figure."""
    return {i for line in lines for i, text in enumerate(line) if not _is_figure(text)}


def _shared(table: Table, rows: Sequence[Row]) -> list[tuple[Column, str]]:
    """Give the columns of the identity that say the same in each of several rows, and what they say."""
    found = []
    for column in table.columns:
        texts = {cell(row.get(column.key), column.decimals) for row in rows}
        if len(rows) > 1 and column.key in table.identity and len(texts) == 1 and texts != {""}:
            found.append((column, texts.pop()))
    return found


def _is_figure(text: str) -> bool:
    return not text or text[0].isdigit() or text[0] in "-+.<"
