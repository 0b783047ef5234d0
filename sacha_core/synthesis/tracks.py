"""Courses over time that a face and a head follow: eased moves, wandering, blinks, darting eyes, syllables."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float, Int

__all__ = ["Blinks", "darts", "draw_blinks", "eased_between", "syllables", "wandering"]

BLINK_PAUSE_S = (3.4, 5.6)  # from blink to blink: 11 to 18 a minute, as people in conversation
CLOSING_S, SHUT_S, OPENING_S = (0.10, 0.15), (0.02, 0.05), (0.15, 0.25)
LEAST_DEPTH = 0.92  # of a spontaneous blink; the lids of one differ by less than what is left
FIXATION_S, DART_S = (0.5, 1.8), 0.06
SYLLABLE_S, PHRASE_SYLLABLES, PAUSE_S = (0.20, 0.34), (4, 11), (0.3, 0.9)


def eased_between(
    key_times_s: Float[np.ndarray, " k"], keys: Float[np.ndarray, "k c"], time_s: Float[np.ndarray, " t"]
) -> Float[np.ndarray, "t c"]:
    """Move from key to key, slow at each; the first and the last hold before and after.

    Args:
        key_times_s: ascending.
        keys: values at those times.
        time_s: when they are wanted.
    """
    after = np.clip(np.searchsorted(key_times_s, time_s, side="right"), 1, max(len(keys) - 1, 1))
    before, after = after - 1, np.minimum(after, len(keys) - 1)
    length = np.maximum(key_times_s[after] - key_times_s[before], 1e-9)
    part = np.clip((time_s - key_times_s[before]) / length, 0, 1)[:, None]
    part = part * part * (3 - 2 * part)
    between: np.ndarray = keys[before] * (1 - part) + keys[after] * part
    return between


def wandering(
    rng: np.random.Generator, time_s: Float[np.ndarray, " t"], duration_s: float, period_s: float, columns: int
) -> Float[np.ndarray, "t c"]:
    """Give smooth chance in [-1, 1] that turns about every `period_s`; columns wander independently.

    Args:
        rng: of chance; what it gives depends on the duration and not on the times asked for.
        time_s: from 0 to `duration_s`.
        duration_s: of the whole.
        period_s: from turn to turn, about.
        columns: c.
    """
    knots = int(np.ceil(duration_s / period_s)) + 2
    times = (np.arange(knots) + rng.uniform(-0.3, 0.3, knots) - 0.5) * period_s
    return eased_between(times, rng.uniform(-1, 1, (knots, columns)), time_s)


@dataclass(frozen=True)
class Blinks:
    """Spontaneous blinks of both eyes.

    Args:
        start_s: (b,) when the lids begin to close.
        closing_s: (b,) how long that takes.
        shut_s: (b,) how long they stay.
        opening_s: (b,) how long they take to open again.
        depth: (b, 2) how far the left and the right lid close, 1 for wholly.
    """

    start_s: Float[np.ndarray, " b"]
    closing_s: Float[np.ndarray, " b"]
    shut_s: Float[np.ndarray, " b"]
    opening_s: Float[np.ndarray, " b"]
    depth: Float[np.ndarray, "b 2"]

    def lids(self, time_s: Float[np.ndarray, " t"]) -> Float[np.ndarray, "t 2"]:
        """Give how far the left and the right lid are closed, 0 to 1."""
        closed = np.zeros((len(time_s), 2))
        for k in range(len(self.start_s)):
            ends = self.start_s[k] + np.cumsum([0.0, self.closing_s[k], self.shut_s[k], self.opening_s[k]])
            course = eased_between(ends, np.array([[0.0], [1.0], [1.0], [0.0]]), time_s)
            closed = np.maximum(closed, course * self.depth[k])
        return closed


def draw_blinks(rng: np.random.Generator, duration_s: float) -> Blinks:
    """Draw the blinks of a stretch of time: 11 to 18 a minute, lids together, down quicker than up.

    Source: own; times as measured on people, Caffier et al., European Journal of Applied Physiology, 2003.
    """
    most = int(duration_s / BLINK_PAUSE_S[0]) + 2
    start = rng.uniform(0, BLINK_PAUSE_S[1]) + np.concatenate([[0], np.cumsum(rng.uniform(*BLINK_PAUSE_S, most))])
    n = len(start)
    closing, shut, opening = (rng.uniform(low, high, n) for low, high in (CLOSING_S, SHUT_S, OPENING_S))
    depth = rng.uniform(LEAST_DEPTH, 1, (n, 2))
    keep = start < duration_s
    return Blinks(start[keep], closing[keep], shut[keep], opening[keep], depth[keep])


def darts(
    rng: np.random.Generator, time_s: Float[np.ndarray, " t"], duration_s: float, columns: int
) -> Float[np.ndarray, "t c"]:
    """Give where eyes look: held for a while, then a quick jump elsewhere; each column in [-1, 1].

    Arguments as for `wandering`.
    """
    most = int(duration_s / FIXATION_S[0]) + 2
    ends = np.cumsum(rng.uniform(*FIXATION_S, most))
    times = np.stack([ends - DART_S, ends], axis=1).reshape(-1)
    places = rng.uniform(-1, 1, (most + 1, columns))
    return eased_between(times, np.stack([places[:-1], places[1:]], axis=1).reshape(-1, columns), time_s)


def syllables(
    rng: np.random.Generator, duration_s: float, n_vowels: int, n_consonants: int
) -> tuple[Float[np.ndarray, " k"], Int[np.ndarray, " k"], Float[np.ndarray, " k"]]:
    """Draw speech: phrases of syllables, each a consonant and a vowel, with pauses between.

    Args:
        rng: of chance.
        duration_s: how long to speak.
        n_vowels: how many different vowels there are.
        n_consonants: how many consonants.

    Returns:
        Key times, seconds; what is spoken then: a vowel, `n_vowels` and on for consonants, -1 for silence; how clearly, 0 to 1.
    """
    times, sounds, clearness = [0.0], [-1], [0.0]
    now = float(rng.uniform(0, PAUSE_S[1]))
    while now < duration_s:
        times.append(now)
        sounds.append(-1)
        clearness.append(0.0)
        for _ in range(rng.integers(*PHRASE_SYLLABLES)):
            length, clear = rng.uniform(*SYLLABLE_S), rng.uniform(0.55, 1.0)
            times += [now + 0.45 * length, now + length]
            sounds += [n_vowels + int(rng.integers(n_consonants)), int(rng.integers(n_vowels))]
            clearness += [clear, clear]
            now += length
        now += 0.15
        times.append(now)
        sounds.append(-1)
        clearness.append(0.0)
        now += float(rng.uniform(*PAUSE_S))
    return np.array(times), np.array(sounds), np.array(clearness)
