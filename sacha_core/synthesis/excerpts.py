"""Sequences cut out of one long motion."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from sacha_core.avatar.motion import Motion
from sacha_core.errors import OptionError

__all__ = ["cut_excerpts"]


def cut_excerpts(motion: Motion, counts: Sequence[int]) -> list[Motion]:
    """Cut a motion into stretches of equal length, one after another, and take evenly spaced moments of each.

    Moments lie in the middle of equal cells, so that the last of one stretch and the first of the next, which may be held out, are as far
    apart as any two neighbours.

    Args:
        motion: at least as long as all moments together.
        counts: how many moments of each stretch.

    Returns:
        A motion for each count, with its mean translation at zero, at the lower frame rate that it then has.

    Raises:
        OptionError: the motion is too short.
    """
    length = len(motion) // len(counts)
    if length < max(counts):
        raise OptionError(
            f"the motion has {len(motion)} frames, {length} for each of {len(counts)} sequences;"
            f" expected at least {max(counts)} for each, or fewer timesteps or sequences"
        )
    excerpts = []
    for number, count in enumerate(counts):
        rows = number * length + ((np.arange(count) + 0.5) * length / count).astype(np.int64)
        part = motion.frames(rows)
        translation = part.translation - part.translation.mean(axis=0, dtype=np.float64).astype(np.float32)
        excerpts.append(replace(part, translation=translation, frame_rate=motion.frame_rate * count / length))
    return excerpts
