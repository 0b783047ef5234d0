"""What a report's pictures of heads need."""

from __future__ import annotations

from dataclasses import dataclass

from sacha_core.flame.model import HeadModel
from sacha_core.interchange.capture import Capture

__all__ = ["Subject"]


@dataclass(frozen=True)
class Subject:
    """Who was captured.

    Args:
        capture: whose held-out views are drawn.
        head: that the avatars are bound to, with vertex masks.
        width: pixels that pictures were judged at.
        height: pixels.
    """

    capture: Capture
    head: HeadModel
    width: int
    height: int
