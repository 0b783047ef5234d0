"""Carrying out an ablation: what is missing is done, what is there is kept, what fails is told."""

from __future__ import annotations

import shutil
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

from sacha_core.errors import OptionError
from sacha_core.evaluate.ablation.ledger import difference, standing
from sacha_core.evaluate.ablation.plan import Dataset, PlannedRun, shared_warm_ups
from sacha_core.evaluate.ablation.result import RunResult, read_result
from sacha_core.evaluate.ablation.work import TrainAndJudge, TrainWarmUp
from sacha_core.evaluate.executors.jobs import Executor, Job, Outcome
from sacha_core.files import write_aside
from sacha_core.flame.head_file import load_head
from sacha_core.interchange.capture import read_capture
from sacha_core.progress import Progress, Report, silent
from sacha_core.train.scene import fingerprint

__all__ = ["Ablated", "ablate", "outstanding"]

FAILURE = "failure.txt"
RUNS = "runs"


@dataclass(frozen=True)
class Ablated:
    """What an ablation came to.

    Args:
        results: of the runs that succeeded, now or before.
        kept: how many of them were there before.
        failures: of the runs and warm-ups that failed.
    """

    results: tuple[RunResult, ...]
    kept: int
    failures: tuple[Outcome, ...]


def ablate(runs: Sequence[PlannedRun], executor: Executor, report: Report = silent, restart: bool = False) -> Ablated:
    """Do all runs that are not done yet; each leaves a result in its folder.

    Args:
        runs: all of one ablation.
        executor: where they are done.
        report: told how far each is, and after each how many are done.
        restart: do those anew that lie there with other options; they are refused otherwise.

    Raises:
        OptionError: a run lies there with other options; or the executor cannot begin.
        SachaError: a capture or head is damaged.
        OSError: a file cannot be read or removed.
    """
    todo = outstanding(runs, restart)
    kept = len(runs) - len(todo)
    planned = {run.name: run for run in todo}
    failures, done = [], kept
    report(Progress(RUNS, done, len(runs)))
    for outcome in executor.run(jobs_of(runs, todo, executor.threads), report):
        run = planned.get(outcome.name)
        if outcome.error is not None:
            failures.append(outcome)
            keep_trace(run, outcome)
        if run is not None:
            done += 1
            report(Progress(RUNS, done, len(runs), {"failed": float(len(failures))} if failures else {}))
    results = tuple(read_result(run.result) for run in runs if run.result.is_file())
    return Ablated(results, kept, tuple(failures))


def outstanding(runs: Sequence[PlannedRun], restart: bool = False) -> list[PlannedRun]:
    """Give the runs that are not done.

    Args:
        runs: all of one ablation.
        restart: remove those that lie there with other options.

    Raises:
        OptionError: naming the first run that lies there with other options.
    """
    data: dict[Dataset, dict[str, Any]] = {}
    others = []
    for run in runs:
        if run.dataset not in data:
            data[run.dataset] = fingerprint(read_capture(run.dataset.root), load_head(run.dataset.head))
        found = difference(run, data[run.dataset])
        if found is not None and not restart:
            raise OptionError(
                f"{run.folder} is a run with another {found}; choose another folder, or do such runs anew with --restart"
            )
        if found is not None:
            others.append(run)
    for run in others:
        shutil.rmtree(run.folder)
    return [run for run in runs if standing(run) != "done"]


def jobs_of(runs: Sequence[PlannedRun], todo: Sequence[PlannedRun], threads: int) -> list[Job]:
    """Give the jobs that are left, each warm-up before the first run that begins with it.

    Args:
        runs: all of the ablation, since runs that are done share warm-ups too.
        todo: those that are not done.
        threads: that each shall use.
    """
    shared = shared_warm_ups(runs)
    jobs: dict[str, Job] = {}
    for run in todo:
        warm_up, after = shared.get(run), tuple[str, ...]()
        if warm_up is not None and not warm_up.checkpoint.is_file():
            jobs.setdefault(warm_up.name, Job(warm_up.name, TrainWarmUp(warm_up, threads)))
            after = (warm_up.name,)
        jobs[run.name] = Job(run.name, TrainAndJudge(run, warm_up, threads), after)
    return list(jobs.values())


def keep_trace(run: PlannedRun | None, outcome: Outcome) -> None:
    """Write down where in the code a run failed, for an error that is ours."""
    if run is not None and outcome.trace:
        with write_aside(run.folder / FAILURE) as aside:
            aside.write_text(outcome.trace, encoding="utf-8")
