"""Whether two runs agree, on runs whose agreement is known."""

from __future__ import annotations

import copy
import math

import pytest

from sacha_core.bench.again import has_times, noise_of, with_repeat
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


def repeated(rows: int, factor: float) -> Record:
    """Give a run of so many times of 10 ms, half of which take `factor` as long when repeated, half of them that much less."""
    first = record(*({"n": n, "a_ms": 10.0, "a_busy_ms": 9.0} for n in range(rows)))
    second = record(*({"n": n, "a_ms": 10.0 * factor ** (-1) ** n, "a_busy_ms": 1.0} for n in range(rows)))
    return with_repeat(first, second, later_s=300)


def test_a_repeated_run_says_its_noise_and_keeps_its_times() -> None:
    run = repeated(40, 1.25)
    assert [row["a_ms"] for row in run.bench.rows] == [10.0] * 40
    assert {row["a_again_ms"] for row in run.bench.rows} == {12.5, 8.0}
    assert run.bench.notes == ("Run again 5 minutes later: nineteen of twenty times within a factor of 1.25.",)
    assert noise_of(run.bench.rows) == pytest.approx(math.log(1.25))
    assert noise_of(FIRST.bench.rows) is None
    assert has_times(run.bench)
    assert not has_times(record({"n": 1, "bytes": 3}).bench)


@pytest.mark.parametrize(
    ("slower", "words"), [(1.24, "The runs agree within noise: 100%"), (1.26, "The runs do not agree")]
)
def test_runs_agree_that_differ_no_more_than_each_from_itself(slower: float, words: str) -> None:
    first, second = repeated(40, 1.25), repeated(40, 1.25)
    for row in second.bench.rows:
        row["a_ms"] *= slower
        row["a_again_ms"] *= slower
    found = comparison(compare_runs({"raster": first}, {"raster": second}))
    assert {row["agree"] for row in found.rows if row["table"] == "times"} == {slower < 1.25}
    assert words in found.notes[1]
    assert found.notes[0] == "40 times compared, 0 other figures differ."


def test_rows_and_benches_of_one_run_only_are_left_out() -> None:
    second = record({"n": 2, "a_ms": 20.0}, {"n": 9, "a_ms": 1.0})
    rows = compare_runs({"raster": FIRST, "codec": FIRST}, {"raster": second, "train": second})
    assert [(row["bench"], row["row"]) for row in rows if row["table"] == "times"] == [("raster", "n 2")]
