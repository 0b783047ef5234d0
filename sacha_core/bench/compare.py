"""Whether two runs of the benches agree."""

from __future__ import annotations

import math
from collections.abc import Mapping

import numpy as np

from sacha_core.bench.again import noise_of
from sacha_core.bench.clock import is_median
from sacha_core.bench.result import Bench, Column, Row, Table
from sacha_core.bench.speeds import Speeds, compare_speeds
from sacha_core.bench.store import Record

__all__ = ["compare_runs", "comparison"]

EXPECTED = 0.9  # of the times of two runs that agree: nineteen of twenty are within the noise, and the noise is itself an estimate


def compare_runs(first: Mapping[str, Record], second: Mapping[str, Record]) -> list[Row]:
    """Set the rows that two runs have in common side by side.

    Times agree where they differ by no more than nineteen of twenty times of the bench do between a run and its own repetition minutes
    later (`again`). Without a repetition they are taken relative to the machine's own speed in each run, where that is known, and agree
    where the ranges between the quartiles then meet. Errors, bytes, PSNR do not depend on how fast the machine is, and agree where they
    are the same number.

    Args:
        first: benches by name.
        second: likewise.

    Returns:
        A row for every bench, with the ratio of speeds and why its times cannot be compared, if so; one for every time of every common row,
        with the ratios of medians, second over first; and one for every other figure that differs.
    """
    rows: list[Row] = []
    for name in first:
        if name not in second:
            continue
        speeds = compare_speeds(first[name].machine, second[name].machine)
        noise = noise_of(*(part for run in (first[name], second[name]) for part in (run.bench.rows, run.bench.more)))
        rows.append({"table": "speeds", "bench": name, **speeds._asdict(), "noise": noise and math.exp(noise)})
        for table in first[name].bench.tables:
            theirs = {table.key_of(row): row for row in second[name].bench.of(table)}
            for row in first[name].bench.of(table):
                other = theirs.get(table.key_of(row))
                if other is not None:
                    about = {"bench": name, "part": table.name, "row": _named(table, row)}
                    rows += _compared(about, table, row, other, speeds, noise)
    return rows


def comparison(rows: list[Row]) -> Bench:
    """Give what `compare_runs` found as tables: the times, those that disagree marked, and a summary."""
    speeds, times, others = ([row for row in rows if row["table"] == name] for name in ("speeds", "times", "figures"))
    columns = (
        Column("bench", "bench"), Column("part", "table"), Column("row", "row"), Column("figure", "figure"),
        Column("first", "first"), Column("second", "second"),
    )  # fmt: skip
    identity = ("bench", "part", "row", "figure")
    tables = (
        Table("speeds", "How much longer the reference took in the second run.",
              (Column("bench", "bench"), Column("wall", "second / first", 2), Column("busy", "of processor time", 2),
               Column("noise", "nineteen of twenty times, repeated, within", 2),
               Column("why_not", "why times cannot be compared")), ("bench",)),
        Table("times", "Medians of both runs, milliseconds.",
              (*columns, Column("ratio", "second / first", 2), Column("busy_ratio", "of processor time", 2),
               Column("relative", "by speed", 2), Column("busy_relative", "of processor time", 2), Column("agree", "within noise")),
              identity),
        Table("figures", "Figures that do not depend on speed, yet differ.", columns, identity),
    )  # fmt: skip
    notes = [f"{len(times)} times compared, {len(others)} other figures differ."]
    if times:
        notes.append(f"Second over first: {_spread('ratio', times)}. {_verdict(times)}")
        for key, what in (
            ("relative", "By the machine's speed"), ("busy_ratio", "Of processor time"), ("busy_relative", "Of processor time by speed"),
        ):  # fmt: skip
            if known := [row for row in times if row[key] is not None]:
                notes.append(f"{what}: {_spread(key, known)}.")
    if doubtful := [row["bench"] for row in speeds if row["why_not"]]:
        notes.append(f"Times that cannot be compared: those of {', '.join(doubtful)}; the table of speeds says why.")
    return Bench(rows, tables, (), tuple(notes))


def _verdict(times: list[Row]) -> str:
    """Say whether times agree: by the noise where runs were repeated, else by their quartiles."""
    repeated = [row for row in times if row["repeated"]]
    if not repeated:
        apart = sum(row["agree"] is False for row in times)
        return f"The quartiles of {apart} ({apart / len(times):.0%}) do not meet, by speed where that is known."
    within = sum(row["agree"] for row in repeated) / len(repeated)
    agree = "agree" if within >= EXPECTED else "do not agree"
    return (
        f"The runs {agree} within noise: {within:.0%} of {len(repeated)} times differ by no more than nineteen of twenty do when a "
        f"run is repeated ({EXPECTED:.0%} expected)."
    )


def _spread(key: str, rows: list[Row]) -> str:
    """Say how some ratios are spread."""
    low, middle, high = np.quantile([row[key] for row in rows], (0.05, 0.5, 0.95))
    return f"median {middle:.2f}, nine tenths between {low:.2f} and {high:.2f}"


def _named(table: Table, row: Row) -> str:
    return ", ".join(f"{key} {row[key]}" for key in table.identity if row.get(key) is not None)


def _compared(about: Row, table: Table, row: Row, other: Row, speeds: Speeds, noise: float | None) -> list[Row]:
    """Give one row for each time, and one for each other figure that differs."""
    found: list[Row] = []
    for key, value in row.items():
        pair = {**about, "figure": key, "first": value, "second": other.get(key)}
        if is_median(key):
            if value and other.get(key):
                ratio, busy = other[key] / value, _busy_ratio(key, row, other)
                ratios = {
                    "ratio": ratio, "busy_ratio": busy, "relative": speeds.wall and ratio / speeds.wall,
                    "busy_relative": busy and speeds.busy and busy / speeds.busy,
                }  # fmt: skip
                met = _meet(key, row, other, speeds.wall or 1.0) if noise is None else abs(math.log(ratio)) <= noise
                found.append({"table": "times", **pair, **ratios, "repeated": noise is not None, "agree": met})
        elif not _is_timing(key) and key not in table.identity and value != other.get(key):
            found.append({"table": "figures", **pair})
    return found


def _busy_ratio(key: str, row: Row, other: Row) -> float | None:
    """Give the ratio of processor times; None where they are not known, or were too short to be measured."""
    busy = f"{key.removesuffix('_ms')}_busy_ms"
    return other[busy] / row[busy] if row.get(busy) and other.get(busy) else None


def _meet(key: str, row: Row, other: Row, slower: float) -> bool | None:
    """Tell whether the ranges between the quartiles of two times meet, the other machine being so much slower; None without quartiles."""
    stem = key.removesuffix("_ms")
    low, high = f"{stem}_q1_ms", f"{stem}_q3_ms"
    if not all(end in one for end in (low, high) for one in (row, other)):
        return None
    return bool(row[low] * slower <= other[high] and other[low] <= row[high] * slower)


def _is_timing(key: str) -> bool:
    """Tell whether a figure follows from times, so that it differs from run to run."""
    return key.endswith(("_ms", "_s", "_per_s", "_ratio", "exponent", "standard_error"))
