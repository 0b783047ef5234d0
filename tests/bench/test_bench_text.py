"""Figures and tables as a reader gets them."""

from __future__ import annotations

import json

import pytest

from sacha_core.bench.result import Bench, Column, Panel, Table
from sacha_core.bench.store import Record, plain
from sacha_core.bench.table import cell, cells, heading, markdown

TABLE = Table(
    "t",
    "A caption.",
    (Column("name", "who"), Column("n", "many"), Column("a_ms", "a, ms"), Column("x", "x", 2)),
    ("name",),
)
ROWS = [
    {"table": "t", "name": "one|two", "n": 12_345, "a_ms": 12.345, "a_q1_ms": 12.0, "a_q3_ms": 13.0, "x": 3.14159},
    {"table": "t", "name": "three", "n": 7, "a_ms": 1234.5},
]


@pytest.mark.parametrize(
    ("value", "decimals", "text"),
    [
        (0.0, None, "0"), (1234567, None, "1,234,567"), (1234.5, None, "1,234"), (99.96, None, "100.0"), (12.345, None, "12.3"),
        (0.12345, None, "0.123"), (0.001, None, "0.00100"), (0.00012345, None, "1.2e-04"), (-0.5, None, "-0.500"), (35.6789, 2, "35.68"),
        (None, None, ""), (float("nan"), None, ""), (float("inf"), None, "inf"),
        (True, None, "yes"), (False, None, "no"), ("text", 2, "text"),
    ],
)  # fmt: skip
def test_cells(value: object, decimals: int | None, text: str) -> None:
    assert cell(value, decimals) == text


def test_columns_without_a_figure_are_left_out() -> None:
    titles, lines = cells(TABLE, ROWS[1:])
    assert titles == ["who", "many", "a, ms"]
    assert lines == [["three", "7", "1,234"]]


def test_what_identifies_all_rows_alike_is_told_once() -> None:
    table = Table(
        "t", "A caption.", (Column("n", "Gaussians"), Column("threads", "threads"), Column("x", "x")), ("n", "threads")
    )
    rows = [{"n": 1000, "threads": 1, "x": 5}, {"n": 1000, "threads": 2, "x": 5}]
    assert heading(table, rows) == "A caption. In all rows: Gaussians 1,000."
    assert cells(table, rows) == (["threads", "x"], [["1", "5"], ["2", "5"]])  # a result is shown, be it the same
    assert heading(table, rows[:1]) == "A caption."


def test_markdown_sets_figures_to_the_right_and_escapes_bars() -> None:
    assert markdown(TABLE, ROWS) == (
        "A caption.\n\n"
        "| who | many | a, ms | x |\n"
        "| --- | ---: | ---: | ---: |\n"
        "| one\\|two | 12,345 | 12.3 | 3.14 |\n"
        "| three | 7 | 1,234 |  |\n"
    )


def test_a_record_is_the_same_after_json() -> None:
    panels = (
        Panel("p", "t", "n", "a_ms", "n", "ms"),
        Panel("q", "t", "n", {"a_ms": "a"}, "n", "ms", label="name", growth=True),
    )
    bench = Bench([*ROWS, {"table": "other", "a_ms": float("nan")}], (TABLE,), panels, ("A note.",), ("what broke",))
    record = Record("raster", "Title", "quick", 1.5, {"processor": "p"}, bench)
    again = Record.from_json(json.loads(json.dumps(plain(record.to_json()), allow_nan=False)))
    assert again.bench.rows[:2] == ROWS
    assert again.bench.rows[2]["a_ms"] is None
    assert (again.bench.tables, again.bench.panels, again.bench.notes, again.bench.broken) == (
        (TABLE,),
        panels,
        ("A note.",),
        ("what broke",),
    )
    assert (again.name, again.title, again.preset, again.seconds, again.machine) == (
        "raster",
        "Title",
        "quick",
        1.5,
        {"processor": "p"},
    )
