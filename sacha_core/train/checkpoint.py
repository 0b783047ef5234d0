"""Checkpoints: all that a run needs to go on as if it had never stopped."""

from __future__ import annotations

import json
import os
from dataclasses import asdict, dataclass, replace
from typing import Any

import numpy as np

from sacha_core.density.events import Event, dump_events, parse_events
from sacha_core.errors import FormatError, OptionError
from sacha_core.npz import read_npz, write_npz
from sacha_core.train.faults import Fault, Faults
from sacha_core.train.options import TrainOptions, from_record
from sacha_core.train.state import ATTRIBUTES, FITTED_MOTION, MASK_LOGIT, ROWS, TrainState, lay_together

__all__ = ["Checkpoint", "differing", "read_checkpoint", "require_fit", "write_checkpoint"]

VERSION = 2
VALUES = (*ATTRIBUTES, *FITTED_MOTION)
MOMENTS = ("values", "first", "second")
PLAIN = ("binding", "gradient_sum", "gradient_count", "thresholds", "ratios")
HIGHEST = {"ratios": 1.0}

# change nothing in the result; but for the device, of which the loop takes care
ELSEWHERE = ("threads", "checkpoint_every", "image_cache_bytes", "device")
AFTER_WARM_UP = (
    "variant", "pruning", "importance", "density.by_region", "density.means", "density.modulators", "density.region_weights",
    "density.guard_faint",
)  # fmt: skip


@dataclass(frozen=True)
class Checkpoint:
    """A run at some iteration.

    Args:
        state: all that changes.
        options: of the run.
        events: what density control has done so far.
        data: what the run was given, as `scene.fingerprint` tells it; resuming with something else is refused.
    """

    state: TrainState
    options: TrainOptions
    events: tuple[Event, ...]
    data: dict[str, Any]


def write_checkpoint(path: str | os.PathLike[str], checkpoint: Checkpoint) -> None:
    """Write a checkpoint, aside and then moved into place.

    Raises:
        OSError: it cannot be written.
    """
    state = checkpoint.state
    header = {
        "version": VERSION,
        "iteration": state.iteration,
        "steps": state.steps,
        "faults": asdict(state.faults),
        "options": checkpoint.options.record(),
        "data": checkpoint.data,
    }
    names = (*VALUES, MASK_LOGIT) if MASK_LOGIT in state.values else VALUES
    arrays = {f"{kind}.{name}": getattr(state, kind)[name] for kind in MOMENTS for name in names}
    arrays |= {name: getattr(state, name) for name in PLAIN}
    texts = {"header": np.array(json.dumps(header)), "events": np.array(dump_events(checkpoint.events))}
    write_npz(path, {**texts, **arrays})


def read_checkpoint(path: str | os.PathLike[str]) -> Checkpoint:
    """Read a checkpoint.

    Raises:
        FormatError: it is damaged or none; the message says what was wrong.
        OSError: it cannot be read.
    """
    arrays = read_npz(path)
    expected = {"header", "events", *PLAIN, *(f"{kind}.{name}" for kind in MOMENTS for name in VALUES)}
    if missing := sorted(expected - arrays.keys()):
        raise FormatError(f"{path}: not a checkpoint: {missing[0]!r} is missing")
    try:
        header = brought_forward(json.loads(str(arrays["header"])))
        iteration = int(header["iteration"])
        steps = {group: int(header["steps"][group]) for group in ("gaussians", "motion")}
        options, data = from_record(header["options"]), dict(header["data"])
        events, faults = parse_events(str(arrays["events"])), parse_faults(header["faults"])
    except (ValueError, OverflowError, KeyError, TypeError, RecursionError, OptionError, FormatError) as error:
        raise FormatError(f"{path}: not a checkpoint that this version can read: {error}") from error
    masked = [MASK_LOGIT] if all(f"{kind}.{MASK_LOGIT}" in arrays for kind in MOMENTS) else []
    values, first, second = ({name: arrays[f"{kind}.{name}"] for name in (*VALUES, *masked)} for kind in MOMENTS)
    binding, gradient_sum, gradient_count, thresholds, ratios = (arrays[name] for name in PLAIN)
    statistics = (gradient_sum, gradient_count, thresholds, ratios)
    state = TrainState(iteration, values, first, second, steps, binding, *statistics, faults)
    _check(path, state)
    lay_together(state)
    return Checkpoint(state, options, events, data)


def brought_forward(header: dict[str, Any]) -> dict[str, Any]:
    """Give a header as one of this version. Version 1 knew the CPU only, one camera a step, and no faults.

    Raises:
        FormatError: it is of a version that is not known.
    """
    if header["version"] == VERSION:
        return header
    if header["version"] != 1:
        raise FormatError(f"its version is {header['version']}, expected 1 to {VERSION}")
    options = {**header["options"], "device": "cpu", "cameras_per_step": 1}
    options["density"] = {**options["density"], "gradient": "ndc"}
    return {**header, "faults": asdict(Faults()), "options": options}


def parse_faults(record: dict[str, Any]) -> Faults:
    """Give the faults that a header tells of; raises as a wrong record does."""
    first = record["first"]
    fault = None if first is None else Fault(int(first["iteration"]), str(first["parameter"]), int(first["row"]))
    return Faults(int(record["count"]), fault)


def _check(path: str | os.PathLike[str], state: TrainState) -> None:
    """Refuse arrays that do not belong together, counts that are none, and numbers that would spoil every step to come."""
    if min(state.iteration, *state.steps.values()) < 0:
        raise FormatError(f"{path}: iteration {state.iteration} with steps {state.steps}, expected none below 0")
    if state.binding.ndim != 1 or state.binding.dtype != np.int32:
        raise FormatError(f"{path}: binding is {state.binding.dtype} {state.binding.shape}, expected (n,) int32")
    if (np.diff(state.binding) < 0).any():
        raise FormatError(f"{path}: binding falls, expected Gaussians sorted by triangle")
    for name in ("gradient_sum", "gradient_count"):
        if getattr(state, name).shape != state.binding.shape:
            raise FormatError(f"{path}: {name} is {getattr(state, name).shape}, expected {state.binding.shape}")
    for name in state.values:
        value = state.values[name]
        wrong = value.ndim == 0 or (name in ROWS and len(value) != len(state))
        for kind in MOMENTS:
            other = getattr(state, kind)[name]
            if wrong or other.shape != value.shape or other.dtype != np.float32:
                raise FormatError(
                    f"{path}: {kind} of {name} is {other.dtype} {other.shape}, which fits nothing else in it"
                )
            good = np.isfinite(other) & ((other >= 0) | (kind != "second"))
            if not good.all():
                row, expected = int(np.argwhere(~good)[0, 0]), "none below 0" if kind == "second" else "finite numbers"
                raise FormatError(f"{path}: {kind} of {name} has {other[~good][0]} in row {row}, expected {expected}")


def require_fit(path: str | os.PathLike[str], state: TrainState, fresh: TrainState, n_faces: int) -> None:
    """Refuse a state that cannot be of this run, whatever its header says.

    Args:
        path: of the checkpoint.
        state: as read.
        fresh: what the run would begin with.
        n_faces: triangles of its head.

    Raises:
        FormatError: an array has not the shape or type that this run's has, a number is out of range, or a Gaussian is bound to no
            triangle.
    """
    if odd := sorted(state.values.keys() ^ fresh.values.keys()):
        raise FormatError(f"{path}: {odd[0]} is {'missing' if odd[0] in fresh.values else 'there, expected none'}")
    for name in fresh.values:
        have, want = state.values[name].shape, fresh.values[name].shape
        if have[1:] != want[1:] or (name in FITTED_MOTION and have != want):
            raise FormatError(
                f"{path}: {name} is {have}, expected {want if name in FITTED_MOTION else ('n', *want[1:])}"
            )
    for name in ("gradient_sum", "gradient_count", "thresholds", "ratios"):
        array, like = getattr(state, name), getattr(fresh, name)
        if array.dtype != like.dtype or (name in {"thresholds", "ratios"} and array.shape != like.shape):
            raise FormatError(f"{path}: {name} is {array.dtype} {array.shape}, expected {like.dtype} {like.shape}")
        if not ((array >= 0) & (array <= HIGHEST.get(name, np.inf))).all():  # true for NaN
            raise FormatError(f"{path}: {name} holds a number that is none or out of range")
    if len(state) and not (state.binding.min() >= 0 and state.binding.max() < n_faces):
        raise FormatError(f"{path}: a Gaussian is bound to a triangle outside 0 to {n_faces - 1}")


def differing(a: TrainOptions, b: TrainOptions, until_warm_up: bool = False) -> str | None:
    """Name the first option in which two runs differ, and both values; None where they are the same to the bit.

    Args:
        a: options of one run.
        b: of the other.
        until_warm_up: whether only that counts which matters before warm-up ends.
    """
    ignored = ELSEWHERE + (AFTER_WARM_UP if until_warm_up else ())
    if until_warm_up:
        a, b = (replace(options, schedule=options.schedule.until_warm_up()) for options in (a, b))
    first, second = flat(a.record()), flat(b.record())
    for name, value in first.items():
        if name in ignored or name.split(".", maxsplit=1)[0] in ignored:
            continue
        if value != second[name]:
            return f"{name} ({value} and {second[name]})"
    return None


def flat(record: dict[str, Any], prefix: str = "") -> dict[str, Any]:
    """Give nested options by dotted names."""
    result: dict[str, Any] = {}
    for name, value in record.items():
        result |= flat(value, f"{prefix}{name}.") if isinstance(value, dict) else {f"{prefix}{name}": value}
    return result
