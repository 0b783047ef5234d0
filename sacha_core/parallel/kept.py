"""Things that are made from others and hold as long as those are the same objects."""

from __future__ import annotations

from collections.abc import Callable
from typing import Generic, TypeVar

__all__ = ["Kept"]

Made = TypeVar("Made")


class Kept(Generic[Made]):
    """Keeps what was made last, and from what: for arguments of kernels that take longer to put together than to use.

    What things are made from is told apart by identity, and kept alive, so that no other gets its.
    """

    def __init__(self) -> None:
        self._identities: tuple[int, ...] | None = None
        self._sources: tuple[object, ...] = ()
        self._made: Made

    def of(self, make: Callable[[], Made], *sources: object) -> Made:
        """Give what `make` gave when these very sources were given last, or gives now."""
        identities = tuple(map(id, sources))
        if identities != self._identities:
            self._made = make()
            self._sources, self._identities = sources, identities
        return self._made
