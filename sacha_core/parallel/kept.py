"""Things that are made from others and hold as long as those are the same objects."""

from __future__ import annotations

from collections.abc import Callable
from typing import Generic, TypeVar

__all__ = ["Kept"]

Made = TypeVar("Made")


class Kept(Generic[Made]):
    """Keeps what was made last, and from what: for arguments of kernels that take longer to put together than to use.

    What things are made from is told apart by identity, and kept alive.
    """

    def __init__(self) -> None:
        self._sources: tuple[object, ...] | None = None
        self._made: Made

    def of(self, make: Callable[[], Made], *sources: object) -> Made:
        """Give what `make` gave when these very sources were given last, or gives now."""
        kept = self._sources
        if kept is None or len(kept) != len(sources) or any(map(_differ, kept, sources)):
            self._made, self._sources = make(), sources
        return self._made


def _differ(one: object, other: object) -> bool:
    return one is not other
