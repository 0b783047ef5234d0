"""Courses over time: measured on fine samples, against what is known of people and against their own definitions."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from sacha_core.synthesis.tracks import darts, draw_blinks, eased_between, syllables, wandering

STEP_S = 0.001  # of fine samples
LONG_S = 600.0


def strokes(lid: np.ndarray) -> list[tuple[int, int]]:
    """Give first and last sample of each stretch in which a lid is not wholly open."""
    moving = np.concatenate([[0], (lid > 0).astype(int), [0]])
    edges = np.diff(moving)
    return list(zip(np.flatnonzero(edges == 1), np.flatnonzero(edges == -1), strict=True))


@pytest.mark.parametrize("seed", range(4))
class TestBlinks:
    def test_ten_to_twenty_a_minute(self, seed: int) -> None:
        blinks = draw_blinks(np.random.default_rng(seed), LONG_S)
        assert 10 <= len(blinks.start_s) / (LONG_S / 60) <= 20
        assert (np.diff(blinks.start_s) > 1).all(), "one has ended before the next begins"

    def test_lids_close_quickly_and_together(self, seed: int) -> None:
        time_s = np.arange(0, 60, STEP_S)
        lids = draw_blinks(np.random.default_rng(seed), 60.0).lids(time_s)
        assert lids.min() >= 0
        assert lids.max() <= 1
        for first, last in strokes(lids[:, 0]):
            if last == len(time_s):
                continue  # cut off by the end
            stroke = lids[first:last]
            deepest = stroke[:, 0].max()
            closing_s = np.argmax(stroke[:, 0] >= deepest - 1e-9) * STEP_S
            assert 0.1 - 3 * STEP_S <= closing_s <= 0.15 + 3 * STEP_S  # a sample at either end, and rounding
            assert deepest > 0.9, "eyes are shut in a blink"
            assert 0.2 < len(stroke) * STEP_S < 0.5
            assert np.corrcoef(stroke.T)[0, 1] > 0.999
        assert (lids == 0).all(axis=1).mean() > 0.85, "eyes are open most of the time"


def test_eased_moves_pass_through_their_keys_and_stop_there() -> None:
    times, keys = np.array([0.5, 1.0, 3.0]), np.array([[0.0, 1.0], [2.0, -1.0], [1.0, 0.0]])
    assert np.array_equal(eased_between(times, keys, times), keys)
    assert np.array_equal(eased_between(times, keys, np.array([0.0, 9.0])), keys[[0, 2]])
    assert eased_between(times, keys, np.array([2.0]))[0] == pytest.approx([1.5, -0.5]), "halfway in the middle"
    h = 1e-5
    speed = (eased_between(times, keys, times + h) - eased_between(times, keys, times - h)) / (2 * h)
    assert np.abs(speed).max() < 1e-3


def test_one_key_holds() -> None:
    assert np.array_equal(
        eased_between(np.array([1.0]), np.array([[3.0]]), np.array([0.0, 1.0, 2.0])), np.full((3, 1), 3.0)
    )


@given(seed=st.integers(0, 2**31 - 1), duration_s=st.floats(0.1, 60), samples=st.integers(1, 50))
def test_chance_is_bounded_and_does_not_depend_on_the_samples(seed: int, duration_s: float, samples: int) -> None:
    time_s = np.linspace(0, duration_s, samples)
    for course in (
        lambda t: wandering(np.random.default_rng(seed), t, duration_s, 0.9, 3),
        lambda t: darts(np.random.default_rng(seed), t, duration_s, 2),
    ):
        values = course(time_s)
        assert np.abs(values).max() <= 1
        assert np.array_equal(values[::2], course(time_s[::2]))


def test_eyes_rest_between_jumps() -> None:
    time_s = np.arange(0, 30, STEP_S)
    gaze = darts(np.random.default_rng(0), time_s, 30.0, 2)
    moving = (np.abs(np.diff(gaze, axis=0)) > 1e-9).any(axis=1)  # beyond rounding
    jumps = strokes(moving)
    assert 15 < len(jumps) < 60
    assert max(last - first for first, last in jumps) * STEP_S < 0.07
    assert moving.mean() < 0.2


def test_speech_is_syllables_in_phrases_with_pauses() -> None:
    times, sounds, clearness = syllables(np.random.default_rng(1), 60.0, 5, 4)
    assert (np.diff(times) > 0).all()
    assert set(sounds) == {-1, *range(9)}
    assert np.array_equal(clearness == 0, sounds == -1), "silence is the only thing that is not clear at all"
    vowels = np.flatnonzero((sounds >= 0) & (sounds < 5))
    assert (sounds[vowels - 1] >= 5).all(), "each vowel follows its consonant"
    assert 2 < len(vowels) / 60 < 5, "syllables a second"
