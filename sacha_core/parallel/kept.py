"""Things that are made from others and hold as long as those are the same objects."""

from __future__ import annotations

from collections.abc import Callable
from operator import is_
from typing import Generic, TypeVar

__all__ = ["Kept", "KeptOfEach"]

Made = TypeVar("Made")


class Kept(Generic[Made]):
    """Keeps what was made last, and from what: for arguments of kernels that take longer to put together than to use.

    What things are made from is told apart by identity, and kept alive, so that no other gets its.
    """

    def __init__(self) -> None:
        self._sources: tuple[object, ...] | None = None
        self._made: Made

    def of(self, make: Callable[[], Made], *sources: object) -> Made:
        """Give what `make` gave when these very sources were given last, or gives now."""
        known = self._sources
        if known is None or len(known) != len(sources) or not all(map(is_, known, sources)):
            self._made = make()
            self._sources = sources
        return self._made


class KeptOfEach(Generic[Made]):
    """Keeps what was made from each of some things, such as cameras that come again and again.

    What things are made from is told apart by identity, and kept alive.

    Args:
        most: things that are kept; with one more, all are forgotten.
    """

    def __init__(self, most: int) -> None:
        self._most = most
        self._made: dict[int, tuple[object, Made]] = {}

    def of(self, make: Callable[[], Made], source: object) -> Made:
        """Give what `make` gave when this very source was given before, or gives now."""
        found = self._made.get(id(source))
        if found is None:
            if len(self._made) >= self._most:
                self._made.clear()
            found = self._made[id(source)] = source, make()
        return found[1]
