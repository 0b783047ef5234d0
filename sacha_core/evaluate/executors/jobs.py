"""Jobs, what becomes of them, and what an executor promises."""

from __future__ import annotations

import traceback
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from typing import Protocol, runtime_checkable

from sacha_core.errors import SachaError
from sacha_core.progress import Report

__all__ = ["Executor", "Job", "Outcome", "Unsettled", "attempt"]


@dataclass(frozen=True)
class Job:
    """Something to be done, perhaps in another process on another machine.

    Args:
        name: of its own.
        work: does it, telling how far it is; everything it needs must be picklable, and files it names must be there where it runs.
        after: names of jobs that must have succeeded before.
    """

    name: str
    work: Callable[[Report], None]
    after: tuple[str, ...] = ()


@dataclass(frozen=True)
class Outcome:
    """What became of a job.

    Args:
        name: the job's.
        error: one line that says what went wrong; None where nothing did.
        trace: where in the code, for an error that is nobody's but ours.
    """

    name: str
    error: str | None = None
    trace: str = ""


@runtime_checkable
class Executor(Protocol):
    """Works jobs off, several at once where it can."""

    @property
    def threads(self) -> int:
        """How many threads a job should use."""

    def run(self, jobs: Sequence[Job], report: Report) -> Iterator[Outcome]:
        """Work all jobs off, each once those before it have succeeded; one that fails takes only those with it that wait for it.

        Args:
            jobs: of different names.
            report: told what the jobs tell, in this process.

        Yields:
            An outcome for each job, as they end. Closing the iterator, or an interrupt, ends the jobs that are running.
        """


class Unsettled:
    """Jobs of which no outcome is known yet, in the order in which they shall begin.

    Args:
        jobs: of different names.
    """

    def __init__(self, jobs: Sequence[Job]) -> None:
        self._waiting = list(jobs)
        self._open = {job.name for job in jobs}

    def __bool__(self) -> bool:
        """Tell whether there is any."""
        return bool(self._open)

    def take(self) -> Job | None:
        """Give the next that may begin; None where all that have not begun wait for others."""
        for place, job in enumerate(self._waiting):
            if self._open.isdisjoint(job.after):
                return self._waiting.pop(place)
        return None

    def settle(self, outcome: Outcome) -> Iterator[Outcome]:
        """Note an outcome; give it, and those of all jobs that will never begin because of it."""
        self._open.discard(outcome.name)
        yield outcome
        if outcome.error is None:
            return
        doomed = [job for job in self._waiting if outcome.name in job.after]
        self._waiting = [job for job in self._waiting if job not in doomed]
        for job in doomed:
            yield from self.settle(Outcome(job.name, f"not begun, since {outcome.name} failed"))


def attempt(job: Job, report: Report) -> Outcome:
    """Do a job here; whatever it raises becomes its outcome, but for an interrupt."""
    try:
        job.work(report)
    except (SachaError, OSError) as error:
        return Outcome(job.name, " ".join(str(error).split()) or type(error).__name__)
    except Exception as error:  # noqa: BLE001 - other jobs go on, and this one's error is told at the end
        line = " ".join(f"{type(error).__name__}: {error}".split())
        return Outcome(job.name, line, traceback.format_exc())
    return Outcome(job.name)
