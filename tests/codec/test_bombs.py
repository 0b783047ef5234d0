"""Files that say as much as so few bytes may: read within a second, in the memory that the format states."""

from __future__ import annotations

import time
import tracemalloc
from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest
from fuzzing import SECONDS
from synthetic_avatars import random_gaussians

from sacha_core.avatar.avatar import Avatar
from sacha_core.avatar.motion import Motion
from sacha_core.codec import decode, encode, encode_archive, encode_paper
from sacha_core.flame.model import HeadReference

N = 4600  # Gaussians without harmonics: what the free budget holds
# as docs state it
FREE_MEMORY = 16 << 20  # bytes; what reading takes whatever the file, the free budgets included
BYTES_A_NUMBER = 48  # of memory, for each number of Gaussians and motion that the header claims
BYTES_A_BYTE = 16  # of memory, for each byte of the file


def one_and_the_same(n: int, n_faces: int = 40, n_harmonics: int = 0) -> Avatar:
    """Give one Gaussian n times: next to nothing to code."""
    gaussians = random_gaussians(1, 1, n_harmonics).select(np.zeros(n, np.int64))
    return Avatar(gaussians, HeadReference("bomb", "ab" * 32, 3 * n_faces, n_faces))


def moving(t: int, e: int, s: int) -> Avatar:
    """Give a motion that repeats one frame of large numbers."""
    still = Motion.rest(s, e, t)
    return replace(
        one_and_the_same(1), motion=replace(still, expression=still.expression + 900, shape=still.shape + 0.15)
    )


BOMBS: dict[str, Callable[[], bytes]] = {
    "gaussians": lambda: encode(one_and_the_same(N), 2),
    "harmonics": lambda: encode(one_and_the_same(N // 5, n_harmonics=15), 2),
    "archive": lambda: encode_archive(one_and_the_same(N)),
    "paper": lambda: encode_paper(one_and_the_same(N)),
    "triangles": lambda: encode(one_and_the_same(1, n_faces=32_000), 2),
    "frames": lambda: encode(moving(1600, 2, 0), 4),
    "expressions": lambda: encode(moving(1, 16_000, 0), 4),
    "identity": lambda: encode(moving(0, 0, 30_000), 4),
    "frames of an archive": lambda: encode_archive(moving(1600, 2, 0)),
    "frames of the paper": lambda: encode_paper(moving(1600, 2, 0)),
    "expressions of the paper": lambda: encode_paper(moving(1, 16_000, 0)),
    "large": lambda: encode(Avatar(random_gaussians(20_000, 200, 15), HeadReference("bomb", "ab" * 32, 600, 200)), 3),
    "large archive": lambda: encode_archive(
        Avatar(random_gaussians(8_000, 200, 15), HeadReference("bomb", "ab" * 32, 600, 200))
    ),
    "large paper": lambda: encode_paper(
        Avatar(random_gaussians(20_000, 200, 15), HeadReference("bomb", "ab" * 32, 600, 200))
    ),
}


@pytest.mark.parametrize("name", BOMBS)
def test_time_and_memory(name):
    data = BOMBS[name]()
    decode(data)
    before = time.process_time()
    avatar = decode(data)
    spent = time.process_time() - before
    tracemalloc.start()
    try:
        decode(data)
        peak = tracemalloc.get_traced_memory()[1]
    finally:
        tracemalloc.stop()
    g, motion = avatar.gaussians, avatar.motion
    numbers = len(g) * (14 + 3 * g.sh_rest.shape[1]) + (
        0 if motion is None else motion.expression.size + 18 * len(motion) + motion.shape.size
    )
    allowed = FREE_MEMORY + BYTES_A_NUMBER * numbers + BYTES_A_BYTE * len(data)
    assert peak < allowed
    assert spent < SECONDS or "large" in name
