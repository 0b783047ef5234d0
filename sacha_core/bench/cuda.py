"""The bench of the CUDA engine: what it finds against the CPU's, how fast it is, and what the order of its sums changes."""

from __future__ import annotations

import copy
import importlib
from collections.abc import Callable
from dataclasses import replace
from functools import partial
from typing import Protocol

import numpy as np

from sacha_core.bench.clock import Times, interleave
from sacha_core.bench.preset import Preset
from sacha_core.bench.result import Bench, Column, Panel, Row, Table
from sacha_core.bench.trial import DEGREE, Trial, made_trial
from sacha_core.errors import OptionError
from sacha_core.progress import Progress, Report
from sacha_core.stopwatch import Stopwatch
from sacha_core.train.cpu_engine import CpuEngine
from sacha_core.train.cuda.available import missing
from sacha_core.train.engine import Engine

__all__ = ["TITLE", "measure"]

TITLE = "CUDA: the device against the CPU"
SIZE = (550, 802)
CAMERAS = 8
MIB = 1 << 20
ATTRIBUTE = (Column("parameter", "parameter"),)

PARITY = Table(
    "parity",
    "Gradients of one step on the device against those of the CPU: one minus the cosine, the largest difference over the largest gradient,"
    " and how many are zero on one of the two only.",
    (*ATTRIBUTE, Column("short_of_one", "1 - cosine"), Column("max_error", "largest difference"), Column("lone", "zero on one only", 0)),
    ("n", "parameter"),
)  # fmt: skip
SPEED = Table(
    "speed",
    f"Iterations of the paper's run at {SIZE[0]}x{SIZE[1]}, one camera a step, all harmonics; memory at its peak.",
    (Column("n", "Gaussians"), Column("way", "kernels launched"), Column("iteration_ms", "an iteration, ms"),
     Column("iterations_per_s", "iterations/s", 0), Column("peak_mib", "memory, MiB", 0)),
    ("n", "way"),
)  # fmt: skip
STAGES = Table(
    "stages",
    "Where an iteration goes on the device.",
    (Column("n", "Gaussians"), Column("stage", "stage"), Column("stage_ms", "ms")),
    ("n", "stage"),
)
DRIFT = Table(
    "drift",
    "Two runs from the same state: the largest difference of a parameter over the farthest that one has moved.",
    (Column("iterations", "iterations"), *ATTRIBUTE, Column("apart", "difference")),
    ("iterations", "parameter"),
)
TABLES = (PARITY, SPEED, STAGES, DRIFT)
PANELS = (
    Panel("An iteration on the device", "speed", "n", "iteration_ms", "Gaussians", "ms", series="way"),
    Panel(
        "Two runs of the same", "drift", "iterations", "apart", "iterations", "relative difference", series="parameter"
    ),
)


class Device(Protocol):
    """Where to measure."""

    @property
    def name(self) -> str:
        """What it is called."""

    def open(self, trial: Trial, graphs: bool = False) -> Engine:
        """Make the engine on it; `graphs` says whether stages are launched as recorded graphs."""

    def forget_peak(self) -> None:
        """Begin to watch memory anew."""

    def peak_bytes(self) -> int:
        """Give the most memory in use since then."""


def measure(preset: Preset, report: Report) -> Bench:
    """Measure parity, speed, stages and drift.

    Raises:
        OptionError: there is no device; the message says what to install.
    """
    if (lack := missing()) is not None:
        raise OptionError(f"no CUDA device to measure: {lack}")
    # where there is a device there is torch, too
    return measured(preset, report, importlib.import_module("sacha_core.bench.cuda_device").CudaDevice())


def measured(preset: Preset, report: Report, device: Device) -> Bench:
    """Measure on a device."""
    rows: list[Row] = []
    parts: tuple[Callable[[Preset, Device], list[Row]], ...] = (parity_rows, speed_rows, stage_rows, drift_rows)
    for done, part in enumerate(parts):
        report(Progress("bench cuda", done, len(parts)))
        rows += part(preset, device)
    report(Progress("bench cuda", len(parts), len(parts)))
    note = "Times are wall time until the device is done, medians of interleaved rounds."
    return Bench(rows, TABLES, PANELS, (f"On {device.name}.", note))


def parity_rows(preset: Preset, device: Device) -> list[Row]:
    """Compare the gradients of one step with the CPU's."""
    trial = made_trial(preset.of(300, 20_000, 50_000), preset.of((32, 40), SIZE, SIZE), CAMERAS, preset.seed)
    cpu = CpuEngine(trial.head, trial.motion, replace(trial.options, threads=preset.threads))
    found = []
    for engine in (device.open(trial), cpu):
        engine.put(copy.deepcopy(trial.state))
        engine.differentiate(1, trial.targets[:1], DEGREE)
        found.append(engine.gradients())
    ours, expected = found
    return [
        {"table": "parity", "n": len(trial.state), "parameter": name, "short_of_one": 1 - cosine(ours[name], gradient),
         "max_error": apart(ours[name], gradient, gradient), "lone": int(((ours[name] == 0) != (gradient == 0)).sum())}
        for name, gradient in expected.items()
    ]  # fmt: skip


def speed_rows(preset: Preset, device: Device) -> list[Row]:
    """Time iterations, launched kernel by kernel and as graphs."""
    rows: list[Row] = []
    count = preset.of(1, 100, 500)
    for n in preset.of((300,), (50_000, 100_000), (10_000, 20_000, 50_000, 100_000, 200_000)):
        trial = made_trial(n, preset.of((32, 40), SIZE, SIZE), CAMERAS, preset.seed)
        tasks, peaks = {}, {}
        for way, graphs in (("one by one", False), ("as graphs", True)):
            device.forget_peak()
            engine = device.open(trial, graphs)
            engine.put(copy.deepcopy(trial.state))
            tasks[way] = partial(trial.run, engine, count)
            tasks[way]()
            peaks[way] = device.peak_bytes() / MIB
        for way, times in interleave(tasks, rounds=preset.of(3, 9, 15), warm_up=0).items():
            each = Times(times.wall_s / count, times.busy_s / count)
            rows.append({"table": "speed", "n": n, "way": way, **each.row("iteration"),
                         "iterations_per_s": 1000 / each.median_ms, "peak_mib": peaks[way]})  # fmt: skip
    return rows


def stage_rows(preset: Preset, device: Device) -> list[Row]:
    """Take an iteration apart."""
    rows: list[Row] = []
    count = preset.of(1, 100, 500)
    for n in preset.of((300,), (50_000, 100_000), (50_000, 100_000)):
        trial = made_trial(n, preset.of((32, 40), SIZE, SIZE), CAMERAS, preset.seed)
        engine = device.open(trial)
        engine.put(copy.deepcopy(trial.state))
        trial.run(engine, count)
        engine.stopwatch = Stopwatch()
        trial.run(engine, count)
        seconds = engine.stopwatch.seconds
        rows += [
            {"table": "stages", "n": n, "stage": stage, "stage_ms": 1000 * s / count} for stage, s in seconds.items()
        ]
    return rows


def drift_rows(preset: Preset, device: Device) -> list[Row]:
    """Run the same twice, and look how far the two go apart."""
    trial = made_trial(preset.of(300, 20_000, 50_000), preset.of((32, 40), SIZE, SIZE), CAMERAS, preset.seed)
    engines = [device.open(trial) for _ in range(2)]
    for engine in engines:
        engine.put(copy.deepcopy(trial.state))
    rows: list[Row] = []
    done = 0
    for iterations in preset.of((1, 2), (1, 10, 100), (1, 10, 100, 1000)):
        states = []
        for engine in engines:
            trial.run(engine, iterations - done, done + 1)
            states.append(engine.take().values)
        done = iterations
        rows += [
            {"table": "drift", "iterations": iterations, "parameter": name,
             "apart": apart(states[0][name], value, value - trial.state.values[name])}
            for name, value in states[1].items()
        ]  # fmt: skip
    return rows


def cosine(one: np.ndarray, other: np.ndarray) -> float:
    """Give the cosine between two arrays of numbers; 1 between two of zeros."""
    a, b = one.ravel().astype(np.float64), other.ravel().astype(np.float64)
    length = float(np.sqrt((a @ a) * (b @ b)))
    return float(a @ b) / length if length else float(not a.any() and not b.any())


def apart(one: np.ndarray, other: np.ndarray, scale: np.ndarray) -> float:
    """Give the largest difference of two arrays over the largest number of a third; 0 where nothing differs."""
    difference, largest = float(np.abs(one - other).max(initial=0)), float(np.abs(scale).max(initial=0))
    return difference / largest if difference else 0.0
