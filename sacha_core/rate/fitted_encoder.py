"""Files of what was fitted.

Source: own.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from jaxtyping import Int

from sacha_core.avatar.avatar import Avatar
from sacha_core.codec.encoder import encode_traced
from sacha_core.codec.importance import GaussianImportance
from sacha_core.codec.in_turn import Remaining
from sacha_core.codec.levels import Level
from sacha_core.flame.model import HeadModel
from sacha_core.rate.encoding import Encoded

__all__ = ["FittedEncoder"]


class FittedEncoder:
    """Encodes what was fitted, at any level near the one that it was fitted for; attributes in turn, each making up for those before.

    Args:
        avatar: the m Gaussians that are left.
        head: that it is bound to.
        embed_head: add the head itself to the files.
        importance: of these.
        remaining: moves what is not coded yet.
        rows: (m,) which Gaussians of the whole avatar they were.
        quality: of the level that they were fitted for.
        number: that files name as their level; None for its own.
    """

    def __init__(
        self,
        avatar: Avatar,
        head: HeadModel,
        embed_head: bool,
        importance: GaussianImportance,
        remaining: Remaining,
        rows: Int[np.ndarray, " m"],
        quality: float,
        number: float | None = None,
    ) -> None:
        self._avatar, self.head, self._embed = avatar, head, embed_head
        self._importance, self._remaining, self._rows = importance, remaining, rows
        self.quality, self._number = quality, number

    def encode(self, level: Level) -> Encoded:
        """Encode at a level."""
        level = level if self._number is None else replace(level, number=self._number)
        data, order = encode_traced(
            self._avatar,
            level,
            head=self.head,
            embed_head=self._embed,
            importance=self._importance,
            remaining=self._remaining,
        )
        return Encoded(data, level, self._rows[order])
