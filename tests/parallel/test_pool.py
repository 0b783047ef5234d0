"""Threads that share out jobs: each job once, and none after a failure."""

from __future__ import annotations

import gc
import os
import signal
import subprocess
import sys
import threading
import time
from collections import Counter
from collections.abc import Iterator
from itertools import pairwise

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from sacha_core.errors import OptionError
from sacha_core.parallel.pool import Pool, even_ranges

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


@pytest.mark.usefixtures("interruptible")
def test_an_interrupt_while_waiting_is_raised_when_the_others_have_ended() -> None:
    both, ended = threading.Barrier(2, timeout=10), threading.Event()

    def task(worker: int, job: int) -> None:
        both.wait()
        if worker == 1:
            time.sleep(0.05)  # the calling thread has nothing left to do and waits
            signal.pthread_kill(threading.main_thread().ident, signal.SIGINT)
            time.sleep(0.05)
            ended.set()

    pool = Pool(2)
    with pytest.raises(KeyboardInterrupt):
        pool.run(task, 2)
    assert ended.is_set()
    done: set[int] = set()
    pool.run(lambda _, job: done.add(job), JOBS)
    assert done == set(range(JOBS))


def test_a_call_within_a_call_has_its_thread_alone() -> None:
    pool, done, lock = Pool(3), Counter[int](), threading.Lock()

    def outer(_: int, job: int) -> None:
        inside = set()

        def inner(worker: int, part: int) -> None:
            inside.add((worker, threading.get_ident()))
            with lock:
                done[10 * job + part] += 1

        pool.run(inner, 10)
        assert inside == {(0, threading.get_ident())}

    pool.run(outer, 20)
    assert done == Counter(range(200))


def test_threads_are_used_again_and_end_with_their_pool() -> None:
    before, seen = set(threading.enumerate()), set()
    pool = Pool(3)
    for _ in range(5):
        pool.run(lambda *_: seen.add(threading.current_thread()) or time.sleep(0.002), 6)
    others = set(threading.enumerate()) - before
    assert len(others) == 2
    assert seen <= {threading.current_thread(), *others}
    del pool
    for thread in others:
        thread.join(10)
        assert not thread.is_alive()


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


@pytest.fixture
def interruptible() -> Iterator[None]:
    """Tests in the background of a shell ignore interrupts, and Python drops one while it finalises what others left behind."""
    before = signal.signal(signal.SIGINT, signal.default_int_handler)
    gc.collect()
    gc.disable()
    yield
    gc.enable()
    signal.signal(signal.SIGINT, before)


@pytest.mark.usefixtures("interruptible")
def test_an_interrupt_at_any_moment_leaves_the_pool_whole() -> None:
    pool, armed, over = Pool(3), threading.Event(), threading.Event()
    interrupted = 0

    def interrupt() -> None:
        for pause_s in np.random.default_rng(0).uniform(0, 5e-4, 300):
            if not armed.wait(10):  # the last one was lost, and so is the test
                break
            armed.clear()
            time.sleep(pause_s)
            signal.pthread_kill(threading.main_thread().ident, signal.SIGINT)
        over.set()
        armed.set()

    thread = threading.Thread(target=interrupt)
    thread.start()
    while not over.is_set():
        done: list[int] = []
        try:
            armed.set()
            while True:
                done.clear()
                pool.run(lambda _, job, done=done: done.append(job), 6)
                assert sorted(done) == list(range(6))
                if over.is_set():
                    break
        except KeyboardInterrupt:
            interrupted += 1
    thread.join(10)
    assert interrupted == 300
    pool.run(lambda _, job: done.append(job), JOBS)


@pytest.mark.skipif(not hasattr(os, "fork"), reason="no fork on this system")
def test_a_forked_process_has_threads_of_its_own() -> None:
    program = """
import os, sys
from sacha_core.parallel.pool import Pool
pool, done = Pool(2), []
pool.run(lambda _, job: None, 9)
child = os.fork()
pool.run(lambda _, job: done.append(job), 9)
if child:
    assert os.waitpid(child, 0)[1] == 0
os._exit(sorted(done) != list(range(9)))
"""
    subprocess.run([sys.executable, "-c", program], check=True, timeout=30)
