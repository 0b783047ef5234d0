"""ARKit's blend shapes in a sequence: moods, speech, brows, gaze and blinks put together, and how the head turns meanwhile."""

from __future__ import annotations

import zlib

import numpy as np
from jaxtyping import Float

from sacha_core.synthesis.arkit_face import (
    ARKIT_SHAPES,
    CHARACTERS,
    COLUMN,
    CONSONANTS,
    MOODS,
    VOWELS,
    Character,
    weights_of,
)
from sacha_core.synthesis.tracks import darts, draw_blinks, eased_between, syllables, wandering

__all__ = ["arkit_weights", "head_turns_rad"]

FIDGET = 0.04  # what every shape of a face at rest still does
SWAY_DEG = 1.2
GAZE_BACK = 0.025  # gaze weight for each degree that the head has turned away: people keep looking at the same place
LID_WITH_GAZE = 0.35  # lids follow eyes that look down
IS_OF_EYES = np.array([name.startswith(("eyeBlink", "eyeLook")) for name in ARKIT_SHAPES])


def head_turns_rad(
    name: str, time_s: Float[np.ndarray, " t"], duration_s: float, seed: int
) -> Float[np.ndarray, "t 3"]:
    """Give how the head turns in a sequence: down, to the subject's left, tilt to the subject's right, radians."""
    rng = np.random.default_rng([seed, zlib.crc32(name.encode()), 1])
    keys = np.array(CHARACTERS[name].turns_deg, float) * rng.uniform(0.9, 1.1, (len(CHARACTERS[name].turns_deg), 1))
    times = held(len(keys), duration_s)
    turns = eased_between(times, np.repeat(keys, 2, axis=0), time_s)
    return np.radians(turns + SWAY_DEG * wandering(rng, time_s, duration_s, 1.1, 3))


def held(count: int, duration_s: float) -> Float[np.ndarray, " k"]:
    """Give when each of `count` keys is reached and left: each holds for half of its share of the time."""
    share = duration_s / count
    first = share * (np.arange(count) + 0.25)
    return np.stack([first, first + 0.5 * share], axis=1).reshape(-1)


def arkit_weights(
    name: str, time_s: Float[np.ndarray, " t"], duration_s: float, seed: int
) -> Float[np.ndarray, "t 52"]:
    """Give the weights of ARKit's blend shapes in a sequence, in the order of `ARKIT_SHAPES`, all in [0, 1].

    Args:
        name: of the sequence.
        time_s: moments, from 0 to `duration_s`.
        duration_s: of the sequence.
        seed: of chance.
    """
    character = CHARACTERS[name]
    rng = np.random.default_rng([seed, zlib.crc32(name.encode())])
    moods = np.stack([weights_of(MOODS[mood]) for mood in character.moods])
    moods *= np.where(moods < 1, rng.uniform(0.85, 1.1, (len(moods), 1)), 1)
    weights = eased_between(held(len(moods), duration_s), np.repeat(moods, 2, axis=0), time_s)
    weights += FIDGET * np.maximum(wandering(rng, time_s, duration_s, 0.9, len(ARKIT_SHAPES)), 0) * ~IS_OF_EYES
    weights += speech(rng, character, time_s, duration_s)
    move_brows(weights, character.brows * wandering(rng, time_s, duration_s, 1.3, 2))
    turns_deg = np.degrees(head_turns_rad(name, time_s, duration_s, seed))
    gaze = character.gaze * darts(rng, time_s, duration_s, 2) - GAZE_BACK * turns_deg[:, :2]
    move_eyes(weights, np.clip(gaze, -0.9, 0.9))
    blink(weights, draw_blinks(rng, duration_s).lids(time_s))
    return reconciled(weights)


def speech(
    rng: np.random.Generator, character: Character, time_s: Float[np.ndarray, " t"], duration_s: float
) -> Float[np.ndarray, "t 52"]:
    """Give the weights of what is spoken."""
    times, sounds, clearness = syllables(rng, duration_s, len(VOWELS), len(CONSONANTS))
    mouths = np.stack([weights_of(amounts) for amounts in (*VOWELS, *CONSONANTS, {})])
    return character.speech * eased_between(times, mouths[sounds] * clearness[:, None], time_s)


def move_brows(weights: Float[np.ndarray, "t 52"], lift: Float[np.ndarray, "t 2"]) -> None:
    """Raise (positive) or lower the brows, inner and outer parts by themselves."""
    weights[:, COLUMN["browInnerUp"]] += np.maximum(lift[:, 0], 0)
    for side in ("Left", "Right"):
        weights[:, COLUMN[f"browOuterUp{side}"]] += np.maximum(lift[:, 1], 0)
        weights[:, COLUMN[f"browDown{side}"]] += np.maximum(-lift[:, 0], 0)


def move_eyes(weights: Float[np.ndarray, "t 52"], gaze: Float[np.ndarray, "t 2"]) -> None:
    """Turn both eyes: down and to the subject's left are positive; lids follow eyes that look down."""
    down, left = gaze.T
    for side, outwards in (("Left", left), ("Right", -left)):
        weights[:, COLUMN[f"eyeLookOut{side}"]] += np.maximum(outwards, 0)
        weights[:, COLUMN[f"eyeLookIn{side}"]] += np.maximum(-outwards, 0)
        weights[:, COLUMN[f"eyeLookDown{side}"]] += np.maximum(down, 0)
        weights[:, COLUMN[f"eyeLookUp{side}"]] += np.maximum(-down, 0)
        lid = weights[:, COLUMN[f"eyeBlink{side}"]]
        np.maximum(lid, LID_WITH_GAZE * np.maximum(down, 0), out=lid)


def blink(weights: Float[np.ndarray, "t 52"], lids: Float[np.ndarray, "t 2"]) -> None:
    """Close the lids as far as blinks do; eyes that are shut are not wide, and lids do not follow what they cover."""
    for k, side in enumerate(("Left", "Right")):
        lid = weights[:, COLUMN[f"eyeBlink{side}"]]
        np.maximum(lid, lids[:, k], out=lid)
        for name in ("eyeWide", "eyeLookUp", "eyeLookDown"):
            weights[:, COLUMN[f"{name}{side}"]] *= 1 - np.clip(lid, 0, 1)


def reconciled(weights: Float[np.ndarray, "t 52"]) -> Float[np.ndarray, "t 52"]:
    """Keep what faces cannot do at once apart: lips meet no further than the jaw is open, rounded lips do not smile."""
    weights = np.clip(weights, 0, 1)
    jaw, close = weights[:, COLUMN["jawOpen"]], weights[:, COLUMN["mouthClose"]]
    np.minimum(close, jaw, out=close)
    rounded = np.maximum(weights[:, COLUMN["mouthPucker"]], weights[:, COLUMN["mouthFunnel"]])
    for name in ("mouthSmile", "mouthStretch", "mouthDimple"):
        for side in ("Left", "Right"):
            weights[:, COLUMN[f"{name}{side}"]] *= 1 - 0.7 * rounded
    return weights
