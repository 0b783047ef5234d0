"""The bench as a table: what is broken is named, whatever it was, and rows agree with what a run measures."""

from __future__ import annotations

import numpy as np
import pytest

from sacha_core.bench.preset import Preset
from sacha_core.bench.stability import report
from sacha_core.bench.stability.case import Case, Findings
from sacha_core.bench.stability.drift import Divergence
from sacha_core.bench.stability.matrix import Family
from sacha_core.progress import Progress


def gradients(findings: Findings) -> None:
    findings.below("position against slopes", 1e-9, 1e-6)
    findings.below("position in float32", 1e-7, 1e-4)


def raises(_) -> None:
    raise ValueError("not foreseen")


@pytest.fixture
def measured(monkeypatch: pytest.MonkeyPatch):
    cases = [
        Case("holds", "a", "b", gradients),
        Case("breaks", "a", "b", lambda f: f.require(holds=False, statement="this")),
        Case("raises", "a", "b", raises),
        Case("slow", "a", "b", lambda f: f.require(holds=True, statement="that"), slow=True),
    ]
    monkeypatch.setattr(report, "FAMILIES", {"gradients": Family("Slopes.", lambda _: cases)})
    monkeypatch.setattr(report, "divergence", lambda _: Divergence(np.ones(3), np.array([1, 1.5, 2]), np.ones(3)))
    told: list[Progress] = []
    return lambda extent: (report.measure(Preset(extent), told.append), told)


def test_every_case_has_a_row_and_what_does_not_hold_is_named(measured) -> None:
    bench, told = measured("quick")
    rows = {row["case"]: row for row in bench.rows if row["table"] == "cases: gradients"}
    assert {name: row["holds"] for name, row in rows.items()} == {
        "holds": True,
        "breaks": False,
        "raises": False,
        "slow": True,
    }
    assert bench.broken == ("gradients: breaks", "gradients: raises")
    assert "not foreseen" in rows["raises"]["happened"]
    assert [step.done for step in told] == [0, 1, 2, 3]
    assert {step.total for step in told} == {4}


def test_the_tables_hold_what_was_measured(measured) -> None:
    bench, _ = measured("quick")
    (gradient,) = (row for row in bench.rows if row["table"] == "gradients")
    assert (gradient["parameter"], gradient["slopes"], gradient["kernels"]) == ("position", 1e-9, 1e-7)
    drift = [row for row in bench.rows if row["table"] == "drift" and row["run"].startswith("shipped")]
    assert [(row["from"], row["to"], row["median"], row["largest"]) for row in drift] == [(1, 1, 0, 0), (2, 3, 0.75, 1)]
    assert {row["table"] for row in bench.rows} <= {table.name for table in bench.tables}
    for table in bench.tables:
        keys = [tuple(row.get(key) for key in table.identity) for row in bench.of(table)]
        assert len(set(keys)) == len(keys)
        assert all(column.key in row for row in bench.of(table) for column in table.columns)


def test_the_tiny_run_leaves_out_what_is_slow(measured) -> None:
    bench, _ = measured("tiny")
    assert "slow" not in {row.get("case") for row in bench.rows}
    assert not any(row["table"] == "drift" for row in bench.rows)
