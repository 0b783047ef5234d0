"""Bindings for codecs that carry none: what is coded comes back, and sorted ones cost what counts cost."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from sacha_core.evaluate.peers.bindings import decode_bindings, encode_bindings, how_coded
from sacha_core.evaluate.peers.peer import Ground
from sacha_core.flame.open import open_head

GROUND = Ground(open_head("synthetic"))
N_FACES = GROUND.head.n_faces


@settings(max_examples=12)  # each goes through LZMA four times
@given(st.lists(st.integers(0, N_FACES - 1), max_size=60), st.booleans())
def test_any_bindings_come_back(faces: list[int], along_the_head: bool) -> None:
    binding = np.array(faces, np.int32)
    if along_the_head:
        binding = binding[np.argsort(GROUND.place[binding], kind="stable")]
    assert np.array_equal(decode_bindings(encode_bindings(binding, GROUND), GROUND), binding)


@pytest.mark.parametrize("n", [1, 300, 20_000])
def test_many_bindings_come_back_and_take_no_more_than_bare_indices(n: int) -> None:
    rng = np.random.default_rng(n)
    binding = rng.integers(0, N_FACES, n).astype(np.int32)
    data = encode_bindings(binding, GROUND)
    assert np.array_equal(decode_bindings(data, GROUND), binding)
    bare = n * np.ceil(np.log2(N_FACES)) / 8 + N_FACES / 8
    assert len(data) < 1.02 * bare + 64  # LZMA2 stores what it cannot shorten


def test_sorted_bindings_are_told_by_counts_for_a_fraction() -> None:
    rng = np.random.default_rng(0)
    binding = rng.integers(0, N_FACES, 20_000).astype(np.int32)
    along = binding[np.argsort(GROUND.place[binding], kind="stable")]
    sorted_, mixed = encode_bindings(along, GROUND), encode_bindings(binding, GROUND)
    assert how_coded(sorted_).startswith("counts")
    assert not how_coded(mixed).startswith("counts")
    assert len(sorted_) < len(mixed) / 5
