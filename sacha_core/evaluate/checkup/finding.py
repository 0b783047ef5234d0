"""What a check found to say."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

__all__ = ["Finding"]


@dataclass(frozen=True)
class Finding:
    """Something about a capture that its owner should know.

    Args:
        severity: "error" where training would fail or be worthless, "warning" where it may be worse than it could be.
        about: which part of the capture: "layout", "cameras", "parameters", "masks", "tracking" or "head".
        what: what is wrong and where.
        remedy: what to do about it.
    """

    severity: Literal["error", "warning"]
    about: str
    what: str
    remedy: str
