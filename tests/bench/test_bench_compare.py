"""Whether two runs agree, on runs whose agreement is known."""

from __future__ import annotations

import copy

import pytest

from sacha_core.bench.compare import compare_runs, comparison
from sacha_core.bench.result import Bench, Column, Table
from sacha_core.bench.store import Record

TABLE = Table("t", "Caption.", (Column("n", "Gaussians"), Column("a_ms", "ms")), ("n",))


def record(*rows: dict[str, object]) -> Record:
    return Record("raster", "Title", "quick", 1.0, {}, Bench([{"table": "t", **row} for row in rows], (TABLE,)))


FIRST = record(
    {
        "n": 1,
        "a_ms": 10.0,
        "a_min_ms": 8.0,
        "a_q1_ms": 9.0,
        "a_q3_ms": 11.0,
        "a_busy_ms": 10.0,
        "max_error": 1e-6,
        "exponent": 1.0,
    },
    {"n": 2, "a_ms": 20.0, "a_q1_ms": 19.0, "a_q3_ms": 21.0, "max_error": 2e-6, "text": "same"},
    {"n": 3, "a_ms": 5.0, "max_error": None},
)


def test_a_run_agrees_with_itself() -> None:
    found = comparison(compare_runs({"raster": FIRST}, {"raster": copy.deepcopy(FIRST)}))
    times = [row for row in found.rows if row["table"] == "times"]
    assert [row["ratio"] for row in times] == [1.0, 1.0, 1.0]
    assert [row["agree"] for row in times] == [True, True, None]  # the third has no quartiles to judge by
    assert found.notes[0] == "3 times compared, 0 other figures differ."


def test_times_beyond_the_quartiles_and_figures_that_differ_are_told() -> None:
    second = copy.deepcopy(FIRST)
    second.bench.rows[0] |= {
        "a_ms": 12.0,
        "a_q1_ms": 10.9,
        "a_q3_ms": 13.0,
        "a_min_ms": 1.0,
        "a_busy_ms": 9.0,
        "exponent": 2.0,
    }  # meets 9 to 11
    second.bench.rows[1] |= {"a_ms": 30.0, "a_q1_ms": 21.5, "a_q3_ms": 31.0, "max_error": 3e-6}
    rows = compare_runs({"raster": FIRST}, {"raster": second})
    times = {row["row"]: row for row in rows if row["table"] == "times"}
    assert times["n 1"]["ratio"] == pytest.approx(1.2)
    assert times["n 1"]["agree"]
    assert times["n 1"]["busy_ratio"] == pytest.approx(0.9)
    assert times["n 2"]["busy_ratio"] is None
    assert times["n 2"]["ratio"] == pytest.approx(1.5)
    assert times["n 2"]["agree"] is False
    others = [row for row in rows if row["table"] == "figures"]
    assert [(row["row"], row["figure"], row["first"], row["second"]) for row in others] == [
        ("n 2", "max_error", 2e-6, 3e-6)
    ]
    assert "1 (33%) do not meet" in comparison(rows).notes[1]


def test_rows_and_benches_of_one_run_only_are_left_out() -> None:
    second = record({"n": 2, "a_ms": 20.0}, {"n": 9, "a_ms": 1.0})
    rows = compare_runs({"raster": FIRST, "codec": FIRST}, {"raster": second, "train": second})
    assert [(row["bench"], row["row"]) for row in rows if row["table"] == "times"] == [("raster", "n 2")]
