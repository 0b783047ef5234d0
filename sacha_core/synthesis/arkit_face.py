"""What a face of ARKit's blend shapes does: sounds, moods, and the characters of the sequences."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from jaxtyping import Float

__all__ = ["ARKIT_SHAPES", "CHARACTERS", "CONSONANTS", "MOODS", "VOWELS", "Character", "is_arkit", "weights_of"]

# Apple's names; those of `SIDED` end in Left and Right.
SIDED = (
    "eyeBlink", "eyeLookDown", "eyeLookIn", "eyeLookOut", "eyeLookUp", "eyeSquint", "eyeWide", "mouthSmile", "mouthFrown",
    "mouthDimple", "mouthStretch", "mouthPress", "mouthLowerDown", "mouthUpperUp", "browDown", "browOuterUp", "cheekSquint", "noseSneer",
)  # fmt: skip
SINGLE = (
    "jawForward", "jawLeft", "jawRight", "jawOpen", "mouthClose", "mouthFunnel", "mouthPucker", "mouthLeft", "mouthRight",
    "mouthRollLower", "mouthRollUpper", "mouthShrugLower", "mouthShrugUpper", "browInnerUp", "cheekPuff", "tongueOut",
)  # fmt: skip
ARKIT_SHAPES = (*SINGLE, *(f"{name}{side}" for name in SIDED for side in ("Left", "Right")))
COLUMN = {name: column for column, name in enumerate(ARKIT_SHAPES)}

# Amounts of shapes; a name of `SIDED` moves both sides. An open jaw of 1 is a yawn: speech takes a third of it.
VOWELS: tuple[dict[str, float], ...] = (
    {"jawOpen": 0.32, "mouthLowerDown": 0.35, "mouthUpperUp": 0.15},  # aa
    {"jawOpen": 0.14, "mouthStretch": 0.35, "mouthSmile": 0.25, "mouthLowerDown": 0.35, "mouthUpperUp": 0.15},  # ee
    {"jawOpen": 0.26, "mouthFunnel": 0.55, "mouthPucker": 0.2},  # oh
    {"jawOpen": 0.10, "mouthPucker": 0.75, "mouthFunnel": 0.25},  # oo
    {"jawOpen": 0.20, "mouthLowerDown": 0.25, "mouthStretch": 0.12},  # eh
)
CONSONANTS: tuple[dict[str, float], ...] = (
    {"jawOpen": 0.05, "mouthClose": 0.05, "mouthPress": 0.5, "mouthRollLower": 0.2, "mouthRollUpper": 0.2},  # m, b, p
    {"jawOpen": 0.07, "mouthRollLower": 0.4, "mouthUpperUp": 0.25},  # f, v
    {"jawOpen": 0.09, "mouthFunnel": 0.5, "mouthShrugUpper": 0.2, "mouthLowerDown": 0.15},  # sh
    {"jawOpen": 0.06, "mouthStretch": 0.2, "mouthLowerDown": 0.35, "mouthUpperUp": 0.1},  # s, t
    {"jawOpen": 0.15, "mouthLowerDown": 0.3, "mouthUpperUp": 0.1, "mouthShrugLower": 0.1},  # l, th
)
MOODS: dict[str, dict[str, float]] = {
    "rest": {},
    "smile": {"mouthSmile": 0.75, "cheekSquint": 0.5, "eyeSquint": 0.25, "mouthDimple": 0.2},
    "laugh": {
        "mouthSmile": 0.85, "cheekSquint": 0.75, "eyeSquint": 0.4, "jawOpen": 0.28, "mouthUpperUp": 0.4, "mouthLowerDown": 0.35,
    },
    "smirk": {"mouthSmileLeft": 0.7, "mouthDimpleLeft": 0.5, "cheekSquintLeft": 0.4, "browOuterUpRight": 0.5},
    "sneer": {"noseSneer": 0.8, "browDown": 0.5, "eyeSquint": 0.35, "mouthUpperUp": 0.3},
    "sad": {"mouthFrown": 0.75, "browInnerUp": 0.8, "mouthShrugLower": 0.5, "eyeLookDown": 0.2},
    "angry": {"browDown": 0.9, "mouthPress": 0.7, "noseSneer": 0.4, "eyeWide": 0.3, "jawForward": 0.2},
    "surprise": {"browInnerUp": 0.9, "browOuterUp": 0.8, "eyeWide": 0.8, "jawOpen": 0.36, "mouthFunnel": 0.2},
    "brows up": {"browInnerUp": 0.9, "browOuterUp": 0.9, "eyeWide": 0.5},
    "brows down": {"browDown": 0.95, "eyeSquint": 0.6},
    "eyes shut": {"eyeBlink": 1.0},
    "eyes squeezed": {"eyeBlink": 1.0, "eyeSquint": 0.8, "cheekSquint": 0.7, "browDown": 0.6, "noseSneer": 0.3},
    "wink left": {"eyeBlinkLeft": 1.0, "cheekSquintLeft": 0.6, "mouthSmileLeft": 0.4},
    "wink right": {"eyeBlinkRight": 1.0, "cheekSquintRight": 0.6, "mouthSmileRight": 0.4},
    "puff": {"cheekPuff": 0.8, "mouthPress": 0.3},
    "kiss": {"mouthPucker": 0.9, "mouthFunnel": 0.15},
    "mouth left": {"mouthLeft": 0.7, "jawLeft": 0.4},
    "mouth right": {"mouthRight": 0.7, "jawRight": 0.4},
    "mouth open": {"jawOpen": 0.42, "mouthLowerDown": 0.3, "mouthUpperUp": 0.3},
    "lips in": {"mouthRollLower": 0.7, "mouthRollUpper": 0.7, "mouthPress": 0.3},
}  # fmt: skip


@dataclass(frozen=True)
class Character:
    """What a sequence is made of.

    Args:
        moods: one after another, each for as long.
        speech: how clearly is spoken, 0 for silence.
        brows: how much the brows move by themselves, 0 to 1.
        gaze: how far the eyes dart about, 0 to 1.
        turns_deg: of the head, one after another: down, to the subject's left, tilt to the subject's right.
    """

    moods: tuple[str, ...] = ("rest",)
    speech: float = 0.0
    brows: float = 0.15
    gaze: float = 0.2
    turns_deg: tuple[tuple[float, float, float], ...] = ((0.0, 0.0, 0.0),)


CHARACTERS: dict[str, Character] = {
    "EMO-1": Character(
        ("rest", "smile", "laugh", "sneer", "smirk", "smile"),
        turns_deg=((0, 0, 0), (-4, 8, 3), (2, -6, 0), (0, 10, 4), (3, -10, -3)),
    ),
    "EMO-2": Character(
        ("rest", "sad", "angry", "surprise", "rest"), turns_deg=((0, 0, 0), (8, 6, 2), (4, -8, 0), (-6, 6, 0))
    ),
    "EXP-2": Character(("rest",), speech=1.0, brows=0.3, turns_deg=((0, 0, 0), (2, 4, 0), (-2, -6, 2), (1, 3, -2))),
    "EXP-3": Character(
        ("rest", "brows up", "eyes shut", "brows down", "wink left", "rest", "eyes squeezed", "brows up", "wink right"),
        brows=0.2,
        gaze=0.8,
        turns_deg=((0, 0, 0), (2, 5, 0), (-3, -6, 0), (0, 0, 0)),
    ),
    "EXP-5": Character(
        ("rest", "mouth open", "kiss", "mouth left", "puff", "mouth right", "lips in"),
        gaze=0.3,
        turns_deg=((0, 26, 0), (6, 12, 4), (-8, 0, -6), (-10, -14, -4), (4, -26, 0), (10, -8, 6), (0, 6, -8)),
    ),
    "FREE": Character(
        ("rest", "smile", "brows up", "rest", "laugh", "brows down"),
        speech=0.8,
        brows=0.5,
        gaze=0.4,
        turns_deg=(
            (-2, -6, 1),
            (2, 4, -2),
            (-4, 12, 3),
            (3, 17, 0),
            (5, 2, -4),
            (-3, -10, -2),
            (0, -19, 4),
            (2, -6, 0),
        ),
    ),
}


def is_arkit(names: Sequence[str]) -> bool:
    """Tell whether a head's expression components are ARKit's blend shapes: at least half of them bear such names."""
    return 2 * sum(name in COLUMN for name in names) >= len(names) > 0


def weights_of(amounts: dict[str, float]) -> Float[np.ndarray, "52"]:
    """Give amounts as weights in the order of `ARKIT_SHAPES`."""
    row = np.zeros(len(ARKIT_SHAPES))
    for name, amount in amounts.items():
        for shape in (name,) if name in COLUMN else (f"{name}Left", f"{name}Right"):
            row[COLUMN[shape]] = amount
    return row
