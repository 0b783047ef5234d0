"""The bench of stability: every hard case with what happened, and how far float32 drifts from float64."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from sacha_core.bench.exact import one_thread
from sacha_core.bench.preset import Preset
from sacha_core.bench.result import Bench, Column, Panel, Row, Table
from sacha_core.bench.stability.case import Case, Findings
from sacha_core.bench.stability.drift import divergence, iterations_of
from sacha_core.bench.stability.matrix import FAMILIES
from sacha_core.bench.stability.posing import AMPLITUDES_RAD, WAYS, drift_mm
from sacha_core.progress import Progress, Report

__all__ = ["TITLE", "measure"]

TITLE = "Stability: hard cases, and what float32 costs"

COLUMNS = (
    Column("case", "case"), Column("given", "given"), Column("must", "must"), Column("happened", "happened"), Column("holds", "holds"),
)  # fmt: skip
CASES = {name: Table(f"cases: {name}", family.what, COLUMNS, ("case",)) for name, family in FAMILIES.items()}
GRADIENTS = Table(
    "gradients",
    "The gradient of the whole chain by each parameter, relative to its largest entry: exact against central differences of the exact loss"
    " (float64), and the kernels' (float32) against exact.",
    (
        Column("parameter", "parameter"),
        Column("pose", "pose"),
        Column("slopes", "exact against slopes"),
        Column("kernels", "kernels against exact"),
    ),
    ("parameter", "pose"),
)
POSING = Table(
    "posing",
    "How far the worst vertex is from float64 in random poses, every joint turned by the same angle; millimetres.",
    (Column("way", "posed"), Column("amplitude_rad", "turned by, rad"), Column("median_mm", "median pose, mm"),
     Column("largest_mm", "worst pose, mm")),
    ("way", "amplitude_rad"),
)  # fmt: skip
DRIFT = Table(
    "drift",
    "How far the training loss is from that of the same run in float64 with exact gradients, relative; by stretches of iterations.",
    (Column("run", "run"), Column("from", "from iteration"), Column("to", "to"), Column("loss", "exact loss"),
     Column("median", "median"), Column("largest", "largest")),
    ("run", "to"),
)  # fmt: skip
PANELS = (
    Panel("Posing in float32", "posing", "amplitude_rad", "largest_mm", "each joint turned by, rad", "worst vertex, mm", series="way"),
    Panel("Training loss", "drift", "to", "median", "iteration", "median distance from float64, relative", series="run"),
)  # fmt: skip
NOTES = (
    (
        "Every case is also a test. The exact answer is a compositor, a head and a loss in float64, written from the formulas and held to"
        " finite differences. Pixels in the boundary band are those where a decision at 1/255, 0.99 or 1e-4 is so close that float32 may"
        " take it otherwise."
    ),
    "Descent on a picture is chaotic: the float64 run that only keeps its parameters in float32 parts from the exact one, too.",
)


def measure(preset: Preset, report: Report) -> Bench:
    """Look at every case; `tiny` leaves out the slow ones, `full` looks closer."""
    full = preset.extent == "full"
    cases = [(name, case) for name, family in FAMILIES.items() for case in family.cases(full)]
    chosen = [(name, case) for name, case in cases if preset.extent != "tiny" or not case.slow]
    rows: list[Row] = []
    broken = []
    with one_thread():
        for done, (family, case) in enumerate(chosen):
            report(Progress(f"hard cases: {family}", done, len(chosen)))
            findings = _looked_at(case)
            rows.append(_case_row(family, case, findings))
            broken += [f"{family}: {case.name}"] if findings.broken else []
            if family == "gradients":
                rows += _gradient_rows(case, findings)
        rows += _posing_rows(preset.of("small", "small", "full"))
        if preset.extent != "tiny":
            rows += _drift_rows(iterations_of(full))
    return Bench(rows, (*CASES.values(), GRADIENTS, POSING, DRIFT), PANELS, NOTES, tuple(broken))


def _looked_at(case: Case) -> Findings:
    """Run a case; one that raises what it should not does not hold, and the others are looked at all the same."""
    try:
        return case.run()
    except Exception as error:  # noqa: BLE001 (whatever it is, it must not happen)
        findings = Findings()
        findings.require(holds=False, statement=f"raised {type(error).__name__}: {error}")
        return findings


def _case_row(family: str, case: Case, findings: Findings) -> Row:
    texts = {"case": case.name, "given": case.given, "must": case.must, "happened": findings.happened}
    return {"table": f"cases: {family}", **texts, "holds": not findings.broken}


def _gradient_rows(case: Case, findings: Findings) -> Iterator[Row]:
    for what, slopes in findings.figures.items():
        if what.endswith(" against slopes"):
            name = what.removesuffix(" against slopes")
            kernels = findings.figures[f"{name} in float32"]
            errors = {"slopes": slopes.value, "kernels": kernels.value}
            yield {"table": GRADIENTS.name, "parameter": name, "pose": case.given, **errors}


def _posing_rows(size: str) -> Iterator[Row]:
    for way in WAYS:
        for amplitude in AMPLITUDES_RAD:
            worst = drift_mm(size, amplitude, way)
            figures = {"median_mm": float(np.median(worst)), "largest_mm": float(worst.max())}
            yield {"table": POSING.name, "way": way, "amplitude_rad": amplitude, **figures}


def _drift_rows(iterations: int) -> Iterator[Row]:
    for stretch in divergence(iterations).rows():
        yield {"table": DRIFT.name, **stretch}
