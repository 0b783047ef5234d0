"""The machine's own speed in two runs, on machines whose speed is known."""

from __future__ import annotations

import copy

import pytest

from sacha_core.bench import reference as reference_module
from sacha_core.bench.clock import interleave
from sacha_core.bench.compare import compare_runs, comparison
from sacha_core.bench.reference import PARTS, Reference, taken, watched
from sacha_core.bench.result import Bench, Column, Table
from sacha_core.bench.speeds import compare_speeds
from sacha_core.bench.store import Record

TABLE = Table("t", "Caption.", (Column("n", "Gaussians"), Column("a_ms", "ms")), ("n",))


def machine(compute_ms: float = 1.0, memory_ms: float = 2.0, wait: float = 1.0, spread: float = 1.1, **more: object):
    """Describe a machine whose reference takes so long, waiting for the processor so many times its work."""
    speed: dict[str, float] = {"samples": 9}
    for part, ms in zip(PARTS, (compute_ms, memory_ms), strict=True):
        speed |= {
            f"{part}_ms": ms * wait, f"{part}_low_ms": ms * wait, f"{part}_high_ms": ms * wait * spread, f"{part}_busy_ms": ms,
        }  # fmt: skip
    return {"processor": "p", "cores": 2, "reference": speed, **more}


def record(about: dict[str, object], slower: float = 1.0) -> Record:
    rows = [
        {"table": "t", "n": n, "a_ms": slower * ms, "a_q1_ms": slower * ms * 0.98, "a_q3_ms": slower * ms * 1.02, "a_busy_ms": slower * ms}
        for n, ms in ((1, 10.0), (2, 30.0))
    ]  # fmt: skip
    return Record("raster", "Title", "quick", 1.0, about, Bench(rows, (TABLE,)))


def test_runs_of_a_machine_that_became_slower_agree_by_its_speed() -> None:
    """Exact: everything takes 1.5 times as long, the reference too."""
    rows = compare_runs({"raster": record(machine())}, {"raster": record(machine(1.5, 3.0), 1.5)})
    times = [row for row in rows if row["table"] == "times"]
    assert [row["ratio"] for row in times] == pytest.approx([1.5, 1.5])
    assert [row["relative"] for row in times] == pytest.approx([1, 1])
    assert [row["busy_relative"] for row in times] == pytest.approx([1, 1])
    assert all(row["agree"] for row in times)
    assert not any("cannot be compared" in note for note in comparison(rows).notes)


def test_work_that_became_slower_on_a_steady_machine_does_not_agree() -> None:
    rows = compare_runs({"raster": record(machine())}, {"raster": record(machine(), 1.5)})
    assert [row["agree"] for row in rows if row["table"] == "times"] == [False, False]


@pytest.mark.parametrize(
    ("second", "reason"),
    [
        (machine(cores=4), "another cores"),
        (machine(wait=1.4), "others had the processor in the second run (x 1.40)"),
        (machine(spread=1.8), "the machine's speed changed 1.8 times in the second run"),
        (machine(1.5, 2.0), "arithmetic and memory changed differently (x 1.50 and x 1.00)"),
        ({"processor": "p", "cores": 2}, "no reference was taken"),
        (machine(), ""),
    ],
)
def test_runs_that_cannot_be_compared_say_why(second: dict[str, object], reason: str) -> None:
    assert compare_speeds(machine(), second).why_not == reason
    rows = compare_runs({"raster": record(machine())}, {"raster": record(second)})
    assert any("cannot be compared: those of raster" in note for note in comparison(rows).notes) == bool(reason)


def test_runs_from_before_there_was_a_reference_are_compared_as_they_are() -> None:
    plain = record({})
    rows = compare_runs({"raster": plain}, {"raster": copy.deepcopy(plain)})
    assert [(row["ratio"], row["relative"]) for row in rows if row["table"] == "times"] == [(1, None), (1, None)]


def test_the_reference_is_taken_between_rounds_where_it_is_watched(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(reference_module, "EVERY_S", 0.0)
    monkeypatch.setattr(reference_module, "LARGE", 64)
    with watched() as reference:
        interleave({"a": int, "b": int}, rounds=4)
        within = reference.row()["samples"] - reference_module.ENDS
        monkeypatch.setattr(reference_module, "EVERY_S", 1e9)
        taken()
    assert within == 4
    assert reference.row()["samples"] == 4 + 2 * reference_module.ENDS
    taken()  # nobody watches any more
    assert reference.row()["samples"] == 4 + 2 * reference_module.ENDS


def test_percentiles_are_those_of_the_times() -> None:
    reference = Reference()
    reference.times = {part: [(0.001 * k, 0.0005 * k) for k in range(11)] for part in PARTS}
    row = reference.row()
    assert (row["compute_low_ms"], row["compute_ms"], row["compute_high_ms"]) == pytest.approx((1, 5, 9))
    assert row["memory_busy_ms"] == pytest.approx(2.5)
