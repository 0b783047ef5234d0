"""Jobs taken inside kernels: each by one thread, and by no more than one."""

from __future__ import annotations

import numpy as np

from sacha_core.parallel.kernels.kernel import kernel
from sacha_core.parallel.kernels.turns import take_turn
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
