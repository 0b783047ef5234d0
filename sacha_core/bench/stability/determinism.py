"""The same seed, the same bytes: for any number of threads, interrupted or not."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import suppress
from dataclasses import replace
from functools import lru_cache, partial
from pathlib import Path
from tempfile import TemporaryDirectory
from unittest.mock import patch

from sacha_core.bench.stability.case import Case, Findings
from sacha_core.bench.stability.tiny import capture_of, eventful, ring, tiny_head
from sacha_core.progress import Progress, Report, silent
from sacha_core.train.loop import train
from sacha_core.train.options import TrainOptions
from sacha_core.train.output import CHECKPOINT, WARM_UP_CHECKPOINT

__all__ = ["cases"]

ITERATIONS, CHECKPOINT_EVERY, INTERRUPTED_AT = 40, 8, 27
VARIANTS = ("sacha", "default")
HOW_IT_RAN = {"options.json", CHECKPOINT, WARM_UP_CHECKPOINT}
SAME = "give the bytes of the run on one thread: model, motion, scores and events"

Files = dict[str, bytes]


class InterruptedRunError(Exception):
    """Stands for whoever ends a run before its time."""


def cases(full: bool = False) -> Iterator[Case]:
    """Give the family; `full` tries more threads."""
    for variant in VARIANTS:
        for threads in (2, 3, 5, 8) if full else (2,):
            check = partial(_same_on, threads, variant)
            yield Case(
                f"{variant} on {threads} threads", f"{ITERATIONS} iterations with every kind of event", SAME, check
            )
        given = f"after {INTERRUPTED_AT} iterations, and resumed from the checkpoint on two threads"
        yield Case(f"{variant} interrupted", given, SAME, partial(_interrupted, variant))
    yield Case("another seed", "seed 1 and not 0", "give other bytes", _another_seed)


def _same_on(threads: int, variant: str, findings: Findings) -> None:
    _compare(findings, _files(replace(eventful(ITERATIONS, variant), threads=threads)), _expected(variant))


def _interrupted(variant: str, findings: Findings) -> None:
    with TemporaryDirectory() as name:
        folder, options = Path(name), replace(eventful(ITERATIONS, variant), checkpoint_every=CHECKPOINT_EVERY)
        with patch("sacha_core.train.loop.REPORT_EVERY_S", 0.0):
            with suppress(InterruptedRunError):
                _train(folder, options, _interrupt)
            unfinished = {path.name for path in (folder / "model").iterdir()}
            findings.require(
                CHECKPOINT in unfinished and "point_cloud" not in unfinished, "leaves a checkpoint and no model"
            )
        _train(folder, replace(options, threads=2))
        _compare(findings, _read(folder / "model"), _expected(variant))


def _another_seed(findings: Findings) -> None:
    other = _files(replace(eventful(ITERATIONS), seed=1))
    findings.require(other != _expected("sacha"), "other bytes")


def _compare(findings: Findings, files: Files, expected: Files) -> None:
    differing = sorted(name for name in files.keys() | expected.keys() if files.get(name) != expected.get(name))
    findings.require(
        not differing, f"{len(expected)} files the same" + (f", but {', '.join(differing)}" if differing else "")
    )


@lru_cache(maxsize=2)
def _expected(variant: str) -> Files:
    return _files(eventful(ITERATIONS, variant))


def _files(options: TrainOptions) -> Files:
    with TemporaryDirectory() as name:
        _train(Path(name), options)
        return _read(Path(name) / "model")


def _train(folder: Path, options: TrainOptions, report: Report = silent) -> None:
    train(capture_of(folder, ring(4), 2), tiny_head(), options, folder / "model", report)


def _read(folder: Path) -> Files:
    """Give every file of a model but those that tell how it was run."""
    found = (path for path in folder.rglob("*") if path.is_file() and path.name not in HOW_IT_RAN)
    return {str(path.relative_to(folder)): path.read_bytes() for path in found}


def _interrupt(progress: Progress) -> None:
    if progress.stage == "train" and progress.done >= INTERRUPTED_AT:
        raise InterruptedRunError
