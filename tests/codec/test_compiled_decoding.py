"""Compiled loops give what NumPy and constriction give, to the bit, and refuse what they refuse."""

from __future__ import annotations

import json

import numpy as np
import pytest
from both_loops import compiling
from golden_streams import DIGESTS, FOLDER, digests_of
from synthetic_avatars import small_head

from sacha_core.codec import loops, places
from sacha_core.codec.kernels import contexts, gathers, prediction, tokens
from sacha_core.codec.reading import ByteReader
from sacha_core.codec.symbols import SymbolReader, SymbolWriter
from sacha_core.codec.template import template_of
from sacha_core.errors import FormatError

N_CONTEXTS = 8
PUBLISHED = json.loads(DIGESTS.read_text())
KERNELS = {"gathers": gathers, "contexts": contexts, "prediction": prediction, "tokens": tokens}


@pytest.mark.parametrize("name", sorted(KERNELS))
def test_switch_decides(name):
    with compiling(True):
        assert loops.compiled_loops(name, 1) is KERNELS[name]
    with compiling(False):
        assert loops.compiled_loops(name, 1 << 30) is None


@pytest.mark.parametrize("compiled", [True, False])
@pytest.mark.parametrize("name", sorted(PUBLISHED))
def test_published_streams_decode_to_the_same_bits(name, compiled):
    with compiling(compiled):
        assert digests_of((FOLDER / f"{name}.sacha").read_bytes()) == PUBLISHED[name]


def stream(n: int) -> tuple[bytes, np.ndarray, np.ndarray]:
    """Batches of integers of all sizes, one context of a single value, one that never occurs."""
    rng = np.random.default_rng(n)
    under = rng.integers(0, N_CONTEXTS - 1, n)
    values = np.rint(rng.laplace(0, 0.4 * 6.0**under)).astype(np.int64)
    values[under == 3] = 2
    writer = SymbolWriter(N_CONTEXTS)
    for start in range(0, n, 97):
        writer.write(values[start : start + 97], under[start : start + 97])
    return writer.finish(), values, under


def read(data: bytes, under: np.ndarray) -> np.ndarray | str:
    """Read a stream in its batches; what is wrong where it is refused."""
    try:
        reader = SymbolReader(ByteReader(data, "x"), N_CONTEXTS)
        parts = [reader.read(under[start : start + 97]) for start in range(0, len(under), 97)]
        reader.check_end()
    except FormatError as error:
        return str(error)
    return np.concatenate([np.zeros(0, np.int64), *parts])


@pytest.mark.parametrize("n", [0, 1, 2, 96, 1000, 20_000])
def test_tokens_and_raw_bits_are_those_that_were_written(n):
    data, values, under = stream(n)
    for compiled in (True, False):
        with compiling(compiled):
            assert np.array_equal(read(data, under), values)


def test_damage_is_told_alike():
    """Oracle: constriction and NumPy; both give the same integers, or the same words for what is wrong."""
    data, _, under = stream(1000)
    rng, refused = np.random.default_rng(5), 0
    for _ in range(200):
        changed = bytearray(data)
        for at in rng.integers(0, len(data), rng.integers(1, 4)):
            changed[at] = rng.integers(0, 256)
        cut = bytes(changed[: rng.integers(len(data) // 2, len(data) + 1)]) if rng.random() < 0.3 else bytes(changed)
        results = []
        for compiled in (True, False):
            with compiling(compiled):
                results.append(read(cut, under))
        assert type(results[0]) is type(results[1])
        assert np.array_equal(*results)
        refused += isinstance(results[0], str)
    assert refused > 0


@pytest.mark.parametrize("share", [0.0, 0.0005, 0.01, 0.3, 1.0])
@pytest.mark.parametrize("kind", ["triangles", "vertices"])
def test_nearest_places_are_those_of_numpy(kind, share):
    """Oracle: the array operations, to the bit, where there is trust."""
    head = small_head()
    there = getattr(template_of(head.v_template, head.faces), kind)
    rng = np.random.default_rng(7)
    known = np.append(rng.random(len(there)) < share, False)
    asked = np.flatnonzero(rng.random(len(there)) < 0.5)
    results = []
    for compiled in (True, False):
        with compiling(compiled):
            results.append(places.nearest_known(there, known, asked))
    assert np.array_equal(results[0][1], results[1][1])
    assert np.array_equal(*(np.where(trust > 0, near, 0) for near, trust in results))
