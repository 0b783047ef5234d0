"""Hard steps of training: poisoned gradients, parameters at the ends of float32, learning rates far too high."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from copy import deepcopy
from dataclasses import replace
from functools import partial
from itertools import count
from pathlib import Path
from tempfile import TemporaryDirectory

import numpy as np

from sacha_core.bench.stability.captures import trained
from sacha_core.bench.stability.case import Case, Findings
from sacha_core.bench.stability.chain import DEGREE, Chain, chain
from sacha_core.bench.stability.poison import spoiled_gradients
from sacha_core.bench.stability.tiny import capture_of, eventful, ring, tiny_head
from sacha_core.raster.rasteriser import Frame
from sacha_core.raster.splats import SplatGradients
from sacha_core.train.cpu_engine import CpuEngine
from sacha_core.train.faults import Fault, Faults
from sacha_core.train.options import LearningRates, TrainOptions
from sacha_core.train.rates import learning_rates
from sacha_core.train.state import FITTED_MOTION, TrainState

__all__ = ["cases"]

F = np.float32
LARGEST = float(np.finfo(F).max)
ROW = 17  # of the Gaussian that is poisoned: in the last, incomplete block of sixteen
ITERATIONS, POISONED_AT = 40, 25

SKIPPED = "skip the step, to the bit; count it; name iteration, parameter and Gaussian; go on with the next"
FINITE = "end finite, and count what was skipped"
LEARNS_ON = "stay finite in every parameter, and skip no step"
SURVIVES = "stay finite in every parameter; where a step cannot be taken, skip it and name the cause"
STEPS = 5

# Which array of the rasteriser's gradients is poisoned, which number of a row, and whose gradient that makes not finite
POISONED = {
    "position": ("means", 0),
    "log_scale": ("scales", 1),
    "quaternion": ("quaternions", 2),
    "opacity_logit": ("opacities", None),
    "sh_dc": ("colours", 0),
    "sensitivity_logit": ("colours", 3),
}
# Of Gaussians that cannot be seen, or can: in both cases the others learn on
EXTREMES = {
    "position": (1e18, 1e30, LARGEST),
    "log_scale": (80.0, -80.0, 100.0, LARGEST),
    "quaternion": (0.0, 1e-30, 1e18, LARGEST),
    "opacity_logit": (100.0, -100.0, LARGEST),
    "sensitivity_logit": (100.0, -100.0, LARGEST),
    "sh_dc": (-1e30,),
    "expression": (10.0, 1e6),
    "rotation": (np.pi, 1e6, 1e18),
    "translation": (1e3,),
}
# What spoils the whole picture, or the pose
OVERFLOWING = {"sh_dc": (1e18, LARGEST), "sh_rest": (1e18, LARGEST), "expression": (1e18,), "translation": (1e9, 1e18)}


def cases(full: bool = False) -> Iterator[Case]:
    """Give the family; `full` trains ten times as long."""
    for parameter, (array, _) in POISONED.items():
        given = f"NaN, inf or 1e30 in the gradient of one splat's {array}"
        yield Case(f"{parameter} gradient that is none", given, SKIPPED, partial(_poisoned_steps, parameter))
    yield Case("one poisoned step in a run", f"NaN at iteration {POISONED_AT} of {ITERATIONS}", SKIPPED, _poisoned_run)
    for table, title, must in ((EXTREMES, "at the ends of float32", LEARNS_ON), (OVERFLOWING, "beyond use", SURVIVES)):
        for name, values in table.items():
            given = f"{', '.join(f'{value:.3g}' for value in values)} at the start; {STEPS} steps"
            yield Case(f"{name} {title}", given, must, partial(_extremes, name, values, table is EXTREMES))
    iterations = 10 * ITERATIONS if full else ITERATIONS
    for factor in (100.0, 1e4, 1e8):
        given = f"every learning rate {factor:g} times too high, {iterations} iterations"
        yield Case(f"rates x {factor:g}", given, FINITE, partial(_rates, factor, iterations))


def _poisoned_steps(parameter: str, findings: Findings) -> None:
    """One good step, one that is poisoned, and one good one."""
    for value in findings.each((np.nan, np.inf, 1e30)):
        engine, made, rates = _engine()
        with _poison(parameter, value, nth=2):
            for iteration in (1, 2, 3):
                before = deepcopy(engine.take())
                _step(engine, made, rates, iteration)
                same = _same(before, engine.take())
                findings.require(
                    same == (iteration == 2), f"step {iteration} {'skipped' if iteration == 2 else 'taken'}"
                )
        _hold_fault(findings, engine.take().faults, Fault(2, parameter, ROW))
        findings.finite("parameters", engine.take().values)


def _poisoned_run(findings: Findings) -> None:
    with TemporaryDirectory() as name, _poison("opacity_logit", np.nan, nth=POISONED_AT):
        folder = Path(name)
        model, losses = trained(capture_of(folder, ring(4), 2), eventful(ITERATIONS), folder / "model")
    _hold_fault(findings, model.faults, Fault(POISONED_AT, "opacity_logit", ROW))
    findings.require(len(losses) == ITERATIONS - 1, "every other step is taken")
    model.gaussians.validate(tiny_head().n_faces)


def _extremes(name: str, values: tuple[float, ...], learns_on: bool, findings: Findings) -> None:
    for value in findings.each(values):
        engine, made, rates = _engine()
        engine.take().values[name][0 if name in FITTED_MOTION else ROW] = value
        for iteration in range(1, STEPS + 1):
            _step(engine, made, rates, iteration)
        state = engine.take()
        moments = {**state.first, **{f"{name} squared": array for name, array in state.second.items()}}
        findings.finite(
            "parameters and moments", {**{f"{name} itself": array for name, array in state.values.items()}, **moments}
        )
        findings.require(not state.faults.count if learns_on else _is_cause(state.faults.first), str(state.faults))


def _is_cause(first: Fault | None) -> bool:
    """Tell whether a fault, if any, is of the poisoned Gaussian, or of the view and the pose as a whole."""
    return first is None or first.parameter in {"loss", "pose"} or first.row == ROW


def _rates(factor: float, iterations: int, findings: Findings) -> None:
    options = eventful(iterations)
    rates = LearningRates(**{name: factor * rate for name, rate in vars(options.rates).items()})
    with TemporaryDirectory() as name:
        folder = Path(name)
        model, losses = trained(capture_of(folder, ring(4), 2), replace(options, rates=rates), folder / "model")
    model.gaussians.validate(tiny_head().n_faces)
    model.motion.validate()
    findings.require(bool(np.isfinite(losses).all()), "every loss finite")
    findings.require(len(losses) + model.faults.count == iterations, str(model.faults))


def _engine() -> tuple[CpuEngine, Chain, dict[str, float]]:
    """Give an engine at the start of a run, its scene, and rates."""
    made, options = chain(), TrainOptions(threads=1)
    engine = CpuEngine(made.head, made.motion, options)
    engine.put(deepcopy(made.state))
    return engine, made, learning_rates(options.rates, options.schedule, 1, 1.0)


def _step(engine: CpuEngine, made: Chain, rates: dict[str, float], iteration: int) -> None:
    engine.differentiate(iteration, made.targets, DEGREE)
    engine.advance(rates, frozenset())


@contextmanager
def _poison(parameter: str, value: float, nth: int) -> Iterator[None]:
    """Let the rasteriser write a value into one number of what it gives back the n-th time."""
    array, column = POISONED[parameter]
    calls = count(1)

    def spoil(_: Frame, gradients: SplatGradients) -> None:
        if next(calls) == nth:
            getattr(gradients, array)[(ROW,) if column is None else (ROW, column)] = value

    with spoiled_gradients(spoil):
        yield


def _same(before: TrainState, after: TrainState) -> bool:
    """Tell whether all that a step changes is the same to the bit."""
    kinds = ((before.values, after.values), (before.first, after.first), (before.second, after.second))
    arrays = [(old[name], new[name]) for old, new in kinds for name in old]
    arrays += [(before.gradient_sum, after.gradient_sum), (before.gradient_count, after.gradient_count)]
    return before.steps == after.steps and all(np.array_equal(old, new) for old, new in arrays)


def _hold_fault(findings: Findings, faults: Faults, expected: Fault) -> None:
    findings.require(faults == Faults(1, expected), str(faults))
