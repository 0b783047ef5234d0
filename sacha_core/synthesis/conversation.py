"""Somebody talking, as a tracker would see it: speech, moods, blinks, darting eyes, turns of the head, sway, and the tracker's noise."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float

from sacha_core.avatar.motion import Motion
from sacha_core.errors import HeadError, OptionError
from sacha_core.flame.model import HeadModel
from sacha_core.flame.synthetic import EXPRESSIONS
from sacha_core.synthesis.sequences import ANGRY, MOUTHS, NECK_SHARE, REST, SAD, SMILE, SURPRISE, coefficients
from sacha_core.synthesis.tracks import darts, draw_blinks, eased_between, syllables, wandering

__all__ = ["TrackingNoise", "converse"]

VOWELS, CONSONANTS = ("aa", "ee", "oh", "oo"), ("mm", "ff", "th")
MOODS = (REST, SMILE, SURPRISE, SAD, ANGRY)
MOOD_S, TURN_S = 3.0, (0.8, 2.5)  # a mood lasts about; a turn of the head is held for
MOOD_STRENGTH = 0.5  # of the full movement; what speaks is hardly ever at it
TURN_DEG = (8.0, 25.0, 6.0)  # at most: down or up, to a side, tilted
SWAY_DEG, SWAY_M = 1.5, (0.012, 0.006, 0.010)
GAZE_DEG = (6.0, 15.0)


@dataclass(frozen=True)
class TrackingNoise:
    """Standard deviations of what a tracker adds to every frame, independently.

    Args:
        expression: of each expression weight.
        angle_deg: of each component of a rotation.
        translation_m: of each coordinate.
    """

    expression: float = 0.01
    angle_deg: float = 0.1
    translation_m: float = 0.0002


def converse(
    head: HeadModel, n_frames: int, seed: int, frame_rate: float = 25.0, noise: TrackingNoise | None = None
) -> Motion:
    """Make a conversation of the synthetic head.

    Args:
        head: the synthetic head, of any size and person.
        n_frames: t.
        seed: of chance; the same seed gives the same bytes.
        frame_rate: frames a second.
        noise: of the tracker.

    Returns:
        The motion of the head's mean person.

    Raises:
        HeadError: the head's expression components are not those of the synthetic head.
        OptionError: there is no frame, or no rate.

    Source: own.
    """
    if head.expression_names != EXPRESSIONS:
        raise HeadError(f"head {head.name!r} does not have the synthetic head's expression components")
    if n_frames < 1 or not frame_rate > 0:
        raise OptionError(f"{n_frames} frames at {frame_rate} a second, expected at least one and a positive rate")
    noise = noise or TrackingNoise()
    rng = np.random.default_rng([seed, n_frames])
    time_s, duration_s = np.arange(n_frames) / frame_rate, n_frames / frame_rate
    expression, jaw_rad = speech_and_moods(rng, time_s, duration_s)
    lids = [EXPRESSIONS.index(f"blink_{side}") for side in ("left", "right")]
    expression[:, lids] = np.maximum(expression[:, lids], draw_blinks(rng, duration_s).lids(time_s))
    turn = np.radians(head_turns_deg(rng, time_s, duration_s))
    gaze = np.radians(np.array(GAZE_DEG) * darts(rng, time_s, duration_s, 2))
    eyes = np.tile(np.concatenate([gaze, np.zeros((n_frames, 1))], axis=1), 2)
    jaw = np.concatenate([jaw_rad[:, None], np.zeros((n_frames, 2))], axis=1)
    translation = np.array(SWAY_M) * wandering(rng, time_s, duration_s, 2.5, 3)
    angle_rad = np.radians(noise.angle_deg)

    def tracked(values: Float[np.ndarray, "t c"], deviation: float) -> Float[np.ndarray, "t c"]:
        return (values + rng.normal(0, deviation, values.shape)).astype(np.float32)

    return Motion(
        np.zeros(head.shapedirs.shape[2], np.float32),
        np.zeros((0, 3), np.float32),
        tracked(expression, noise.expression),
        rotation=tracked((1 - NECK_SHARE) * turn, angle_rad),
        neck=tracked(NECK_SHARE * turn, angle_rad),
        jaw=tracked(jaw, angle_rad),
        eyes=tracked(eyes, angle_rad),
        translation=tracked(translation, noise.translation_m),
        frame_rate=frame_rate,
    )


def speech_and_moods(
    rng: np.random.Generator, time_s: Float[np.ndarray, " t"], duration_s: float
) -> tuple[Float[np.ndarray, "t e"], Float[np.ndarray, " t"]]:
    """Give expression weights and how far the jaw is open, radians."""
    times, sounds, clearness = syllables(rng, duration_s, len(VOWELS), len(CONSONANTS))
    poses = [*(MOUTHS[name] for name in (*VOWELS, *CONSONANTS)), REST]
    mouths = np.stack([np.append(coefficients(pose), pose.jaw_rad) for pose in poses])
    moods = np.stack([np.append(coefficients(pose), pose.jaw_rad / 2) for pose in MOODS])
    count = int(duration_s / MOOD_S) + 2
    felt = moods[rng.integers(len(moods), size=count)] * rng.uniform(0, MOOD_STRENGTH, (count, 1))
    both = eased_between(times, mouths[sounds] * clearness[:, None], time_s)
    both += eased_between(MOOD_S * np.arange(count), felt, time_s)
    return np.clip(both[:, :-1], 0, 1), both[:, -1]


def head_turns_deg(
    rng: np.random.Generator, time_s: Float[np.ndarray, " t"], duration_s: float
) -> Float[np.ndarray, "t 3"]:
    """Give turns of the head: moves between poses that are held for a while, and a sway in between."""
    count = int(duration_s / TURN_S[0]) + 2
    ends = np.cumsum(rng.uniform(*TURN_S, count))
    keys = rng.uniform(-1, 1, (count, 3)) * np.array(TURN_DEG)
    times = np.stack([ends - 0.4 * np.diff(ends, prepend=0), ends], axis=1).reshape(-1)
    held = np.repeat(keys, 2, axis=0)
    return eased_between(times, held, time_s) + SWAY_DEG * wandering(rng, time_s, duration_s, 1.1, 3)
