"""Sequences cut out of a motion: which frames, where they lie, and what is refused."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from sacha_core.avatar.motion import Motion
from sacha_core.errors import OptionError
from sacha_core.synthesis.excerpts import cut_excerpts


def numbered(n_frames: int) -> Motion:
    """Give a motion whose only coefficient is the number of the frame, and which drifts to the side."""
    motion = Motion.rest(0, 1, n_frames, frame_rate=30.0)
    drift = np.zeros((n_frames, 3), np.float32)
    drift[:, 0] = np.arange(n_frames) * 0.01
    return replace(motion, expression=np.arange(n_frames, dtype=np.float32)[:, None], translation=drift)


def test_stretches_follow_each_other_and_moments_are_even() -> None:
    parts = cut_excerpts(numbered(60), (4, 4, 5))
    assert [part.expression[:, 0].tolist() for part in parts] == [
        [2, 7, 12, 17],
        [22, 27, 32, 37],
        [42, 46, 50, 54, 58],
    ]
    assert [part.frame_rate for part in parts] == [6.0, 6.0, 7.5]


@given(counts=st.lists(st.integers(1, 12), min_size=1, max_size=6), spare=st.integers(0, 40))
def test_laws(counts: list[int], spare: int) -> None:
    n_frames = max(counts) * len(counts) + spare
    frames = []
    for part, count in zip(cut_excerpts(numbered(n_frames), counts), counts, strict=True):
        rows = part.expression[:, 0].astype(int)
        assert len(rows) == count
        gaps = np.diff(rows)
        assert gaps.size == 0 or (gaps.min() >= 1 and np.ptp(gaps) <= 1)
        assert np.abs(part.translation.mean(axis=0)).max() < 1e-5, "the mean translation is each sequence's origin"
        frames += rows.tolist()
    assert len({*frames}) == len(frames), "no frame is in two sequences"
    assert frames == sorted(frames)
    assert max(frames) < n_frames


def test_too_short() -> None:
    with pytest.raises(OptionError, match="has 60 frames, 20 for each of 3 sequences; expected at least 21"):
        cut_excerpts(numbered(60), (4, 21, 4))
