"""Jobs taken inside kernels: each by one thread, and by no more than one."""

from __future__ import annotations

import numpy as np
import pytest

from sacha_core.parallel.kernels.kernel import kernel
from sacha_core.parallel.kernels.turns import DONE, finish_turn, new_turns, take_turn, wait_for_turns
from sacha_core.parallel.pool import Pool

JOBS = 200_000


@kernel
def mark(counter, taken):
    job = take_turn(counter)
    while job < len(taken):
        taken[job] += 1
        job = take_turn(counter)


def test_every_number_is_given_once_whoever_asks() -> None:
    counter, threads = np.zeros(1, np.int64), 3
    taken = np.zeros((threads, JOBS), np.int64)
    mark(np.full(1, JOBS), taken[0])  # compiles
    Pool(threads).run(lambda worker, _: mark(counter, taken[worker]), threads)
    assert (taken.sum(axis=0) == 1).all()
    assert counter[0] == JOBS + threads


@kernel
def smooth(turns, values, wanted):
    """Replace every value by its neighbours' sum, part after part, each from what the one before left."""
    last = values.shape[1] - 1
    for part in range(len(turns)):
        if part > 0:
            wait_for_turns(turns[part - 1], last + 1)
        job = take_turn(turns[part])
        while job <= last:
            values[part + 1, job] = values[part, max(job - 1, 0)] + values[part, min(job + 1, last)]
            finish_turn(turns[part])
            job = take_turn(turns[part])
    wanted[0] += 1


@pytest.mark.parametrize("threads", [1, 2, 5])
def test_a_part_sees_all_of_the_one_before(threads: int) -> None:
    """Exact: NumPy does the same part by part."""
    parts, jobs = 400, 37
    values, entered = np.zeros((parts + 1, jobs), np.int64), np.zeros((threads, 1), np.int64)
    values[0] = np.arange(jobs) ** 2
    turns = new_turns(parts)
    Pool(threads).run(lambda worker, _: smooth(turns, values, entered[worker]), threads)
    expected = values[0].copy()
    for _ in range(parts):
        padded = np.pad(expected, 1, mode="edge")
        expected = padded[:-2] + padded[2:]  # which wraps around at 64 bits here and there alike
    np.testing.assert_array_equal(values[-1], expected)
    assert (turns[:, DONE] == jobs).all()
    assert entered.sum() == threads


def test_nobody_waits_for_a_thread_that_never_comes() -> None:
    turns, values = new_turns(3), np.ones((4, 8), np.int64)
    smooth(turns, values, np.zeros(1, np.int64))  # alone, where others might have come
    assert (values[-1] == 8).all()
