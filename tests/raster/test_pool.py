"""Threads that share out jobs: each job once, and none after a failure."""

from __future__ import annotations

import threading
from collections import Counter
from itertools import pairwise

import pytest
from hypothesis import given
from hypothesis import strategies as st

from sacha_core.errors import OptionError
from sacha_core.raster.pool import Pool, even_ranges

JOBS = 200


@pytest.mark.parametrize("threads", [1, 2, 5])
def test_every_job_runs_once_and_no_two_share_a_worker(threads: int) -> None:
    done: Counter[int] = Counter()
    busy = [threading.Lock() for _ in range(threads)]

    def task(worker: int, job: int) -> None:
        assert busy[worker].acquire(blocking=False)
        done[job] += 1
        busy[worker].release()

    Pool(threads).run(task, JOBS)
    assert done == Counter(range(JOBS))


@pytest.mark.parametrize("threads", [1, 3])
@pytest.mark.parametrize("error", [ValueError, KeyboardInterrupt])
def test_after_a_failure_no_job_begins_and_none_is_left_running(threads: int, error: type[BaseException]) -> None:
    begun: list[int] = []
    running = threading.Semaphore(0)

    def task(worker: int, job: int) -> None:
        begun.append(job)
        if worker == 0:  # the calling thread, which is the one that a user interrupts
            raise error
        running.acquire(timeout=0.05)

    with pytest.raises(error):
        Pool(threads).run(task, JOBS)
    count = len(begun)
    assert count <= threads
    running.acquire(timeout=0.1)
    assert len(begun) == count


def test_the_failure_of_another_thread_is_raised_too() -> None:
    both = threading.Barrier(2, timeout=10)

    def task(worker: int, job: int) -> None:
        if job < 2:
            both.wait()
        if worker == 1:
            raise ValueError(job)

    with pytest.raises(ValueError):  # noqa: PT011 - the only one there is
        Pool(2).run(task, JOBS)


def test_no_jobs_and_no_threads() -> None:
    Pool(3).run(lambda *_: pytest.fail("there is none"), 0)
    with pytest.raises(OptionError, match="0 threads"):
        Pool(0)


@given(st.integers(0, 10_000), st.integers(1, 60))
def test_ranges_are_even_and_complete(total: int, jobs: int) -> None:
    bounds = even_ranges(total, jobs)
    assert (bounds[0], bounds[-1]) == (0, total)
    lengths = [b - a for a, b in pairwise(bounds)]
    assert len(lengths) == min(total, jobs)
    assert max(lengths, default=1) - min(lengths, default=1) <= 1
    assert min(lengths, default=1) >= 1
