"""The table of skips: every row changes nothing, and its proof is a test that there is."""

from __future__ import annotations

import ast
from pathlib import Path

import pytest

from sacha_core.bench.preset import Preset
from sacha_core.bench.result import Bench
from sacha_core.bench.skips import measure
from sacha_core.progress import silent

ROOT = Path(__file__).parents[2]


@pytest.fixture(scope="module")
def bench() -> Bench:
    return measure(Preset("tiny", threads=2), silent)


def test_no_skip_changes_a_result(bench: Bench) -> None:
    assert [row["error"] for row in bench.rows] == [0] * len(bench.rows)
    assert not bench.broken


def test_every_proof_is_a_test(bench: Bench) -> None:
    for row in bench.rows:
        path, _, name = row["proof"].partition("::")
        tree = ast.parse((ROOT / path).read_text(encoding="utf-8"))
        assert name in {node.name for node in tree.body if isinstance(node, ast.FunctionDef)}, row["proof"]
        assert name.startswith("test_")


def test_rows_are_told_apart_and_say_what_both_ways_cost(bench: Bench) -> None:
    assert len({row["skip"] for row in bench.rows}) == len(bench.rows)
    for row in bench.rows:
        assert (
            min(row[f"{way}_{unit}"] for way in ("with", "without") for unit in ("ms", "kb") if f"with_{unit}" in row)
            > 0
        )
        assert ("with_ms" in row) != ("with_kb" in row)
    assert {column.key for table in bench.tables for column in table.columns} <= {
        key for row in bench.rows for key in row
    }
