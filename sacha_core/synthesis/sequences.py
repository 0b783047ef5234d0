"""Scripts of the sequences that a subject performs, and the motion they become."""

from __future__ import annotations

import zlib
from dataclasses import dataclass, field

import numpy as np
from jaxtyping import Float

from sacha_core.avatar.motion import Motion
from sacha_core.errors import OptionError
from sacha_core.flame.model import HeadModel
from sacha_core.flame.synthetic import EXPRESSIONS

__all__ = ["SCRIPTS", "perform"]


@dataclass(frozen=True)
class Pose:
    """A key pose.

    Args:
        face: amount of each named movement; a name without `_left` or `_right` moves both sides.
        jaw_rad: how far the mouth is open.
        turn_deg: of the head: up (positive looks down), to the subject's left, tilt to the subject's right.
        gaze_deg: of both eyes: down, to the subject's left.
    """

    face: dict[str, float] = field(default_factory=dict)
    jaw_rad: float = 0.0
    turn_deg: tuple[float, float, float] = (0.0, 0.0, 0.0)
    gaze_deg: tuple[float, float] = (0.0, 0.0)


REST = Pose()
SMILE = Pose({"smile": 0.9, "cheek_raise": 0.7, "squint": 0.35})
LAUGH = Pose({"smile": 1.0, "cheek_raise": 0.9, "lips_part": 1.0, "upper_lip_raise": 0.5, "squint": 0.45}, 0.16)
SNEER = Pose({"sneer": 1.0, "brow_lower": 0.7, "squint": 0.4, "nostril_flare": 0.6})
SMIRK = Pose({"smile_left": 0.9, "dimple_left": 0.8, "cheek_raise_left": 0.5, "brow_outer_raise_right": 0.5})
SAD = Pose({"frown": 1.0, "brow_inner_raise": 0.9, "chin_raise": 0.7})
ANGRY = Pose({"brow_lower": 1.0, "lip_press": 0.9, "nostril_flare": 0.8, "wide": 0.4})
SURPRISE = Pose({"brow_inner_raise": 1.0, "brow_outer_raise": 1.0, "wide": 0.9, "lips_part": 0.4}, 0.24)
MOUTHS = {
    "aa": Pose({"lips_part": 0.7, "lower_lip_depress": 0.3}, 0.26),
    "ee": Pose({"mouth_stretch": 0.9, "lips_part": 0.8, "smile": 0.2}, 0.05),
    "oh": Pose({"funnel": 0.9, "lips_part": 0.4}, 0.15),
    "oo": Pose({"pucker": 1.0, "funnel": 0.3}, 0.04),
    "mm": Pose({"lip_press": 1.0}),
    "ff": Pose({"upper_lip_raise": 0.4, "lips_part": 0.3, "chin_raise": 0.5}, 0.03),
    "th": Pose({"lips_part": 0.9, "lower_lip_roll_out": 0.5}, 0.08),
}


def turned(pose: Pose, *turn_deg: float, gaze_deg: tuple[float, float] | None = None) -> Pose:
    """Give a pose with another turn of the head, and of the eyes."""
    pitch, yaw, roll = turn_deg
    return Pose(pose.face, pose.jaw_rad, (pitch, yaw, roll), pose.gaze_deg if gaze_deg is None else gaze_deg)


SCRIPTS: dict[str, tuple[Pose, ...]] = {
    "EMO-1": (
        REST,
        SMILE,
        turned(LAUGH, -4.0, 8.0, 3.0),
        turned(SNEER, 2.0, -6.0, 0.0),
        turned(SMIRK, 0.0, 10.0, 4.0),
        turned(SMILE, 3.0, -10.0, -3.0),
    ),
    "EMO-2": (
        REST,
        SAD,
        turned(SAD, 8.0, 6.0, 2.0),
        turned(ANGRY, 4.0, -8.0, 0.0),
        SURPRISE,
        turned(SURPRISE, -6.0, 6.0, 0.0),
        REST,
    ),
    "EXP-2": (REST, *MOUTHS.values(), turned(LAUGH, 0.0, -8.0, 0.0), REST),
    "EXP-3": (
        turned(REST, 0.0, 0.0, 0.0, gaze_deg=(0.0, 18.0)),
        Pose({"brow_inner_raise": 1.0, "brow_outer_raise": 1.0, "wide": 0.6}, gaze_deg=(-8.0, 0.0)),
        Pose({"brow_lower": 1.0, "squint": 0.8}, gaze_deg=(0.0, -18.0)),
        Pose({"blink": 1.0}),
        Pose({"blink_left": 1.0, "smile_left": 0.4, "cheek_raise_left": 0.6}),
        turned(ANGRY, 3.0, 8.0, 0.0, gaze_deg=(6.0, -10.0)),
        Pose({"blink_right": 1.0, "smile_right": 0.4, "cheek_raise_right": 0.6}),
        turned(SURPRISE, -3.0, -8.0, 0.0, gaze_deg=(0.0, 10.0)),
        SAD,
    ),
    "EXP-5": (
        turned(REST, 0.0, 25.0, 0.0, gaze_deg=(0.0, -12.0)),
        turned(MOUTHS["aa"], 6.0, 12.0, 4.0),
        turned(MOUTHS["oo"], -8.0, 0.0, -6.0),
        turned(SMILE, -10.0, -14.0, -4.0, gaze_deg=(6.0, 8.0)),
        turned(REST, 4.0, -25.0, 0.0, gaze_deg=(0.0, 12.0)),
        turned(Pose({"cheek_puff": 1.0, "lip_press": 0.5}), 10.0, -8.0, 6.0),
        turned(Pose({"mouth_left": 0.8, "jaw_left": 0.5}), 0.0, 6.0, -8.0),
    ),
    "FREE": (
        turned(REST, -2.0, -6.0, 1.0, gaze_deg=(-2.0, 6.0)),
        turned(MOUTHS["oh"], 2.0, 4.0, -2.0),
        turned(
            Pose({"lips_part": 0.5, "smile": 0.5, "brow_inner_raise": 0.5}, 0.12), -4.0, 12.0, 3.0, gaze_deg=(0.0, -8.0)
        ),
        turned(MOUTHS["ee"], 3.0, 16.0, 0.0),
        turned(Pose({"pucker": 0.6, "brow_lower": 0.5}, 0.03), 5.0, 2.0, -4.0, gaze_deg=(4.0, 4.0)),
        turned(MOUTHS["aa"], -3.0, -10.0, -2.0),
        turned(
            Pose({"smile": 0.7, "lips_part": 0.6, "cheek_raise": 0.5, "brow_outer_raise": 0.4}, 0.06),
            0.0,
            -18.0,
            4.0,
            gaze_deg=(0.0, 8.0),
        ),
        turned(MOUTHS["th"], 2.0, -6.0, 0.0),
    ),
}
NECK_SHARE = 0.65  # of a turn of the head; the root, under the whole bust, turns the rest
BLINKS_PER_TIMESTEP = 0.1
JITTER_DEG = 0.8  # nobody holds still
SWAY_M = 0.004


def perform(
    head: HeadModel, name: str, n_timesteps: int, seed: int, shape: Float[np.ndarray, " s"] | None = None
) -> Motion:
    """Turn a script into motion: key poses joined by smooth moves, with blinks, darting eyes and a little sway.

    A head whose expression components have no names that the scripts know moves its components by smooth chance.

    Args:
        head: who performs.
        name: of the script.
        n_timesteps: how many moments of the performance.
        seed: of chance; another one varies timing and strength.
        shape: (s,) identity of the person; the head's mean by default.

    Returns:
        The motion, its mean translation zero.

    Raises:
        OptionError: there is no such script.
    """
    if name not in SCRIPTS:
        raise OptionError(f"there is no sequence {name!r}; there are {', '.join(SCRIPTS)}")
    script = SCRIPTS[name]
    rng = np.random.default_rng([seed, zlib.crc32(name.encode())])
    time = np.linspace(0, len(script) - 1, n_timesteps) if n_timesteps > 1 else np.zeros(1)
    n_components = head.exprdirs.shape[2]
    if n_components == len(EXPRESSIONS) and head.name.startswith("synthetic"):
        keys = np.stack([coefficients(pose) for pose in script]) * rng.uniform(0.85, 1.1, (len(script), 1))
        expression = eased(keys, time)
        shut = rng.uniform(size=n_timesteps) < BLINKS_PER_TIMESTEP
        lids = [EXPRESSIONS.index(f"blink_{side}") for side in ("left", "right")]
        depth = np.where(shut, rng.uniform(0.6, 1.0, n_timesteps), 0.0)
        expression[:, lids] = np.clip(np.maximum(expression[:, lids], depth[:, None]), 0, 1)
    else:
        expression = eased(rng.normal(size=(len(script), n_components)), time)
    turn = np.radians(
        eased(np.array([pose.turn_deg for pose in script]), time) + rng.normal(0, JITTER_DEG, (n_timesteps, 3))
    )
    gaze = np.radians(
        darting(np.array([pose.gaze_deg for pose in script]), time) + rng.normal(0, 2.0, (n_timesteps, 2))
    )
    eyes = np.concatenate([gaze, np.zeros((n_timesteps, 1))], axis=1)
    jaw = np.zeros((n_timesteps, 3))
    jaw[:, 0] = eased(np.array([[pose.jaw_rad] for pose in script]), time)[:, 0]
    sway = eased(rng.normal(0, SWAY_M, (len(script), 3)), time)
    identity = np.zeros(head.shapedirs.shape[2]) if shape is None else shape
    return Motion(
        np.asarray(identity, np.float32),
        np.zeros((0, 3), np.float32),
        expression.astype(np.float32),
        rotation=((1 - NECK_SHARE) * turn).astype(np.float32),
        neck=(NECK_SHARE * turn).astype(np.float32),
        jaw=jaw.astype(np.float32),
        eyes=np.tile(eyes, 2).astype(np.float32),
        translation=(sway - sway.mean(axis=0)).astype(np.float32),
    )


def coefficients(pose: Pose) -> Float[np.ndarray, " e"]:
    """Give a pose's expression in the components of the synthetic head."""
    row = np.zeros(len(EXPRESSIONS))
    for movement, amount in pose.face.items():
        names = [movement] if movement in EXPRESSIONS else [f"{movement}_left", f"{movement}_right"]
        for name in names:
            row[EXPRESSIONS.index(name)] = amount
    return row


def eased(keys: Float[np.ndarray, "k c"], time: Float[np.ndarray, " t"]) -> Float[np.ndarray, "t c"]:
    """Move from key to key, slow at each; time counts keys."""
    before = np.minimum(time.astype(int), max(len(keys) - 2, 0))
    after = np.minimum(before + 1, len(keys) - 1)
    part = (time - before)[:, None]
    part = part * part * (3 - 2 * part)
    between: np.ndarray = keys[before] * (1 - part) + keys[after] * part
    return between


def darting(keys: Float[np.ndarray, "k c"], time: Float[np.ndarray, " t"]) -> Float[np.ndarray, "t c"]:
    """Hold each key and jump to the next halfway, as eyes do."""
    held: np.ndarray = keys[np.minimum(np.round(time).astype(int), len(keys) - 1)]
    return held
