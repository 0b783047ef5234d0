"""A few threads that share out numbered jobs; the kernels they call release Python's lock."""

from __future__ import annotations

import os
import weakref
from collections import deque
from collections.abc import Callable, Iterable
from threading import Lock, Thread

from sacha_core.errors import OptionError

__all__ = ["Pool", "available_threads", "even_ranges"]


def available_threads() -> int:
    """Give the number of processors that this process may run on."""
    if hasattr(os, "sched_getaffinity"):
        return len(os.sched_getaffinity(0))
    return os.cpu_count() or 1


def even_ranges(total: int, jobs: int) -> list[int]:
    """Give bounds of at most `jobs` ranges of about equal length."""
    jobs = min(total, jobs)
    return [total * k // jobs for k in range(jobs + 1)] if jobs else [0]


class Pool:
    """Runs jobs on a fixed number of threads, the calling one among them.

    Args:
        threads: how many; None for one on each processor. Torch's own threads beside these want as many processors again.

    Raises:
        OptionError: `threads` is below 1.
    """

    def __init__(self, threads: int | None = None) -> None:
        if threads is not None and threads < 1:
            raise OptionError(f"{threads} threads were asked for, expected 1 or more")
        self.threads = threads or available_threads()
        self._workers: list[Worker] = []
        self._process: int | None = None  # that the workers live in
        self._free = Lock()

    def run(self, task: Callable[[int, int], None], jobs: int) -> None:
        """Call task(worker, job) once for every job; `worker` (0 to threads - 1) names space that no other call uses meanwhile.

        When a job fails, or whoever waits interrupts, jobs that have begun are finished, no other begins, and the error is raised.
        A call during another one, from a job or from a thread of its own, has the calling thread alone.
        """
        waiting = iter(range(jobs))  # taking the next is one step under Python's lock

        def work(worker: int) -> None:
            try:
                for job in waiting:
                    task(worker, job)
            finally:
                deque(waiting, maxlen=0)  # empty already, unless a job failed

        if self.threads == 1 or jobs < 2 or not self._free.acquire(blocking=False):
            work(0)
            return
        try:
            errors = self._share(work, min(self.threads, jobs) - 1)
        finally:
            self._free.release()
        for error in errors:
            raise error

    def _share(self, work: Callable[[int], None], others: int) -> list[BaseException]:
        """Call work(0) here and work(1) to work(others) elsewhere; give the errors, the own one first, when all have ended."""
        if (
            self._process != os.getpid()
        ):  # threads begin with the first need of them, end with the pool, and are not forked
            self._workers = [Worker(number) for number in range(1, self.threads)]
            self._process = os.getpid()
            weakref.finalize(self, dismiss, self._workers)
        busy, errors = self._workers[:others], list[BaseException]()
        try:
            for worker in busy:
                worker.begin(work)
            work(0)
        except BaseException as error:  # noqa: BLE001 - `run` raises it when nobody is at work any more
            errors.append(error)
            for worker in busy:
                worker.wake()  # who was to begin when an interrupt came
        while True:
            try:
                for worker in busy:
                    worker.wait()
                break
            except KeyboardInterrupt as interrupt:
                errors.insert(0, interrupt)
        return [*errors, *(error for worker in busy for error in worker.errors)]


class Worker:
    """A thread that sleeps until it is given something to do.

    An interrupt may come between any two steps of who gives it: waking it twice, or waiting twice, does no harm.

    Args:
        number: that it works under.

    Attributes:
        errors: of what it did last, one or none.
    """

    def __init__(self, number: int) -> None:
        self.errors: list[BaseException] = []
        self._number = number
        self._task: tuple[Callable[[int], None] | None, Lock] | None = None
        self._begun, self._ended = (
            Lock(),
            Lock(),
        )  # quicker than semaphores; taken until there is something to do, or all is done
        self._begun.acquire()
        Thread(target=self._live, name=f"sacha-{number}", daemon=True).start()

    def begin(self, work: Callable[[int], None] | None) -> None:
        """Give it something to do, which must have ended before the next; None lets it go."""
        self.errors, ended = [], Lock()
        ended.acquire()
        self._task, self._ended = (work, ended), ended
        self.wake()

    def wake(self) -> None:
        """Have it look whether there is something to do."""
        if self._begun.locked():
            self._begun.release()

    def wait(self) -> None:
        """Wait for the end of what was begun."""
        with self._ended:
            pass

    def _live(self) -> None:
        while True:
            self._begun.acquire()
            task, self._task = self._task, None
            if task is None:
                continue
            work, ended = task
            if work is None:
                return
            try:
                work(self._number)
            except BaseException as error:  # noqa: BLE001 - the thread that waits raises it
                self.errors = [error]
            del task, work  # what it holds is not kept while there is nothing to do
            ended.release()


def dismiss(workers: Iterable[Worker]) -> None:
    """Let threads end."""
    for worker in workers:
        worker.begin(None)
