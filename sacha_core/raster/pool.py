"""A few threads that share out numbered jobs; the kernels they call release Python's lock."""

from __future__ import annotations

import os
from collections import deque
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor, wait

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
        self._executor = ThreadPoolExecutor(self.threads - 1, "sacha-raster") if self.threads > 1 else None

    def run(self, task: Callable[[int, int], None], jobs: int) -> None:
        """Call task(worker, job) once for every job; `worker` (0 to threads - 1) names space that no other call uses meanwhile.

        When a job fails, or whoever waits interrupts, jobs that have begun are finished, no other begins, and the error is raised.
        """
        waiting = iter(range(jobs))  # taking the next is one step under Python's lock

        def work(worker: int) -> None:
            try:
                for job in waiting:
                    task(worker, job)
            finally:
                deque(waiting, maxlen=0)  # empty already, unless a job failed

        others = []
        if self._executor is not None:
            others = [self._executor.submit(work, worker) for worker in range(1, min(self.threads, jobs))]
        try:
            work(0)
        finally:
            wait(others)
        for other in others:
            other.result()
