"""A performance for any head: blend shapes by ARKit's names, components without names by smooth chance, joints where there are some."""

from __future__ import annotations

import zlib

import numpy as np
from jaxtyping import Float

from sacha_core.avatar.motion import Motion
from sacha_core.errors import OptionError
from sacha_core.flame.model import HeadModel
from sacha_core.flame.synthetic import EXPRESSIONS
from sacha_core.synthesis.arkit_acting import arkit_weights, head_turns_rad
from sacha_core.synthesis.arkit_face import CHARACTERS, COLUMN, is_arkit
from sacha_core.synthesis.sequences import perform
from sacha_core.synthesis.tracks import darts, wandering

__all__ = ["act"]

DURATION_S = 12.0  # of a sequence, if its timesteps fit
MOST_FRAMES_PER_S = 30.0
NECK_SHARE = 0.65  # of a turn of the head, where there is a neck to turn
SWAY_M = 0.003
JAW_RAD, GAZE_RAD = 0.15, 0.2  # at most, of a head whose expressions have no names but whose jaw and eyes are joints
SUM_OF_COMPONENTS_M = 0.012  # how far the nameless components together may move a vertex, about


def act(
    head: HeadModel, name: str, n_timesteps: int, seed: int, shape: Float[np.ndarray, " s"] | None = None
) -> Motion:
    """Perform a sequence with whatever the head can do.

    Args:
        head: whose components and joints are moved.
        name: of the sequence, which decides its character.
        n_timesteps: how many moments, evenly spaced over 12 s, or over longer at 30 a second.
        seed: of chance.
        shape: (s,) identity of the person; the head's mean by default.

    Returns:
        The motion, its mean translation zero.

    Raises:
        OptionError: there is no such sequence.
    """
    if head.exprdirs.shape[2] == len(EXPRESSIONS) and head.name.startswith("synthetic"):
        return perform(head, name, n_timesteps, seed, shape)
    if name not in CHARACTERS:
        raise OptionError(f"there is no sequence {name!r}; there are {', '.join(CHARACTERS)}")
    duration_s = max(DURATION_S, n_timesteps / MOST_FRAMES_PER_S)
    time_s = (np.arange(n_timesteps) + 0.5) * duration_s / n_timesteps
    turns = head_turns_rad(name, time_s, duration_s, seed)
    identity = np.zeros(head.shapedirs.shape[2]) if shape is None else shape
    motion = Motion.rest(len(identity), head.exprdirs.shape[2], n_timesteps, n_timesteps / duration_s)
    motion.shape[:] = identity
    rng = np.random.default_rng([seed, zlib.crc32(name.encode()), 3])
    if is_arkit(head.expression_names):
        weights = arkit_weights(name, time_s, duration_s, seed)
        for column, shape_name in enumerate(head.expression_names):
            if shape_name in COLUMN:
                motion.expression[:, column] = weights[:, COLUMN[shape_name]]
    else:
        motion.expression[:] = nameless(head, time_s, duration_s, rng)
        motion.jaw[:, 0] = JAW_RAD * np.maximum(wandering(rng, time_s, duration_s, 0.7, 1)[:, 0], 0)
        motion.eyes[:, [0, 1, 3, 4]] = np.tile(GAZE_RAD * darts(rng, time_s, duration_s, 2), 2)
    share = NECK_SHARE if len(head.parents) > 1 else 0.0
    motion.neck[:], motion.rotation[:] = share * turns, (1 - share) * turns
    sway = SWAY_M * wandering(rng, time_s, duration_s, 2.0, 3)
    motion.translation[:] = sway - sway.mean(axis=0)
    return motion


def nameless(
    head: HeadModel, time_s: Float[np.ndarray, " t"], duration_s: float, rng: np.random.Generator
) -> Float[np.ndarray, "t e"]:
    """Give coefficients of components that say nothing about themselves: at most 1, and less for those that move much.

    Components that vary about zero, as principal ones do, and ones that only make sense above it, as blend shapes do, cannot be told
    apart here; both bear small coefficients of either sign.
    """
    n = head.exprdirs.shape[2]
    reach_m = np.linalg.norm(head.exprdirs, axis=1).max(axis=0) if n else np.zeros(0)
    most = np.minimum(1, SUM_OF_COMPONENTS_M / np.maximum(reach_m * np.sqrt(max(n, 1)), 1e-9))
    coefficients: np.ndarray = most * wandering(rng, time_s, duration_s, 0.9, n)
    return coefficients
