"""A warm-up that several variants share: trained once, to the point where they part."""

from __future__ import annotations

import os
from dataclasses import replace
from pathlib import Path
from typing import Any

from sacha_core.errors import OptionError
from sacha_core.flame.model import HeadModel
from sacha_core.interchange.capture import Capture
from sacha_core.progress import Report, silent
from sacha_core.train.checkpoint import AFTER_WARM_UP, ELSEWHERE, flat
from sacha_core.train.loop import Run, require_head
from sacha_core.train.options import TrainOptions, from_record
from sacha_core.train.output import WARM_UP_CHECKPOINT

__all__ = ["train_warm_up", "warm_up_facts", "warm_up_options"]

NAME = "warm-up"  # of the variant, where there is none yet


def train_warm_up(
    capture: Capture,
    head: HeadModel,
    options: TrainOptions,
    out: str | os.PathLike[str],
    report: Report = silent,
) -> Path:
    """Train as far as all runs go together that differ only in what matters after warm-up; `train` takes it as `start_from`.

    A warm-up that was interrupted goes on from its last checkpoint.

    Args:
        capture: see `train`.
        head: see `train`.
        options: of any of those runs.
        out: folder for the checkpoint.
        report: see `train`.

    Returns:
        The checkpoint's file.

    Raises:
        SachaError: see `train`; or warm-up is too short to be shared.
        OSError: `out` cannot be written.
    """
    folder = Path(out)
    require_head(capture, head)
    end = options.schedule.warm_up - 1
    if end < 1:
        raise OptionError(f"schedule.warm_up is {options.schedule.warm_up}, expected at least 2 for a warm-up to share")
    run = Run(capture, head, warm_up_options(options), folder, report)
    run.begin(resume=True, start_from=None)
    run.advance(end)
    return folder / WARM_UP_CHECKPOINT


def warm_up_facts(options: TrainOptions) -> dict[str, Any]:
    """Give what determines a run until warm-up ends, by dotted names; runs in which it is the same can share a warm-up."""
    record = flat(warm_up_options(options).record())
    return {name: value for name, value in record.items() if not _among(name, ELSEWHERE)}


def warm_up_options(options: TrainOptions) -> TrainOptions:
    """Give the options with everything at its default that matters only after warm-up."""
    stripped = replace(options, schedule=options.schedule.until_warm_up())
    record, usual = stripped.record(), TrainOptions(variant=NAME).record()
    for name in AFTER_WARM_UP:
        _copy(name.split("."), usual, record)
    return from_record(record)


def _copy(path: list[str], source: dict[str, Any], target: dict[str, Any]) -> None:
    """Copy the value under a dotted name from one record to another."""
    first, *rest = path
    if rest:
        _copy(rest, source[first], target[first])
    else:
        target[first] = source[first]


def _among(name: str, names: tuple[str, ...]) -> bool:
    """Tell whether a dotted name, or the group that it is in, is among names."""
    return name in names or name.split(".", maxsplit=1)[0] in names
