"""An avatar: canonical Gaussians, the head that they are bound to, and optionally a motion."""

from __future__ import annotations

from dataclasses import dataclass

from sacha_core.avatar.gaussians import Gaussians
from sacha_core.avatar.motion import Motion
from sacha_core.flame.model import HeadReference

__all__ = ["Avatar"]


@dataclass(frozen=True)
class Avatar:
    """What one `.sacha` file holds.

    Args:
        gaussians: the canonical Gaussians, sent once.
        head: which head model they are bound to.
        motion: parameters of every frame; None for an avatar without a motion.
        scheme: name of the region scheme that was used in training.
    """

    gaussians: Gaussians
    head: HeadReference
    motion: Motion | None = None
    scheme: str = "paper"
