"""A table as text, and entries found by what they are about."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

from sacha_core.evaluate.report.entry import Entry

__all__ = ["Grid", "Index"]


@dataclass(frozen=True)
class Grid:
    """A table to be read.

    Args:
        title: what it shows.
        note: what its figures mean.
        header: one title a column.
        rows: cells, as many a row as there are titles; a cell may have a second line.
        folded: whether a page hides it until asked.
    """

    title: str
    note: str
    header: tuple[str, ...]
    rows: tuple[tuple[str, ...], ...]
    folded: bool = False


class Index:
    """Entries of one capture by what they are about.

    Args:
        entries: of any captures.
        dataset: the one that is looked at.
    """

    def __init__(self, entries: Sequence[Entry], dataset: str) -> None:
        self._found = {self._key(entry): entry for entry in entries if entry.dataset == dataset}

    @staticmethod
    def _key(entry: Entry) -> tuple[object, ...]:
        return (entry.variant, entry.against, entry.quantity, entry.setting, entry.region, entry.level)

    def __call__(
        self,
        variant: str,
        quantity: str,
        *,
        against: str | None = None,
        setting: str | None = None,
        region: str | None = None,
        level: int | None = None,
    ) -> Entry | None:
        """Give an entry, or None where nothing of the kind was looked at."""
        return self._found.get((variant, against, quantity, setting, region, level))
