"""Ten thousand hostile files, and every one that once broke a promise: an avatar or one of our errors, within a second and little memory.

A million run at night: `make fuzz`.
"""

from __future__ import annotations

import fuzzing
import pytest
from fuzzing import FOUND, MEMORY, SECONDS, attempt, make, run

from sacha_core.codec import loops

CHUNK = 1000
N_CHUNKS = 10
SEED = 20


@pytest.mark.slow
@pytest.mark.parametrize("chunk", range(N_CHUNKS))
def test_hostile_files(chunk):
    tally = run(SEED, chunk * CHUNK, (chunk + 1) * CHUNK)
    assert tally.broken == {}
    assert tally.total == CHUNK
    assert tally.slowest_s < SECONDS
    assert tally.grown < MEMORY
    assert any(decoded for _, decoded in tally.ends), "no input got past the checks: the fuzzer is at the door only"


def test_inputs_are_the_same_every_time():
    assert [make(SEED, number) for number in range(20)] == [make(SEED, number) for number in range(20)]


def test_loops_that_give_something_else_break_a_promise(monkeypatch):
    monkeypatch.setattr(fuzzing, "attempt", lambda _: f"digest {loops.COMPILED_FROM}")
    tally = run(SEED, 0, 3)
    assert [problem.partition(": ")[2] for problem in tally.broken.values()] == [
        "compiled loops give something else"
    ] * 3


@pytest.mark.parametrize("path", sorted(FOUND.glob("*.bin")), ids=lambda path: path.stem)
def test_inputs_that_once_broke_a_promise(path):
    attempt(path.read_bytes())
