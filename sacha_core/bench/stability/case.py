"""A hard case: what is given, what must happen, and the code that looks whether it does."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from typing import TypeVar

import numpy as np

from sacha_core.errors import SachaError

__all__ = ["Case", "Figure", "Findings"]

T = TypeVar("T")
SHOWN = 4  # figures of a case in a table; more than that nobody reads


@dataclass(frozen=True)
class Figure:
    """Something measured.

    Args:
        value: what was found.
        limit: under which it must lie; None for no limit.
        unit: with a space before it.
    """

    value: float
    limit: float | None = None
    unit: str = ""

    @property
    def share(self) -> float:
        """The value in limits; 0 where there is none."""
        return 0.0 if self.limit is None else self.value / self.limit

    @property
    def holds(self) -> bool:
        """Whether it lies under its limit; what is not a number does not."""
        return self.limit is None or bool(self.value < self.limit)

    def __str__(self) -> str:
        """Give value and limit with the digits that count."""
        limit = "" if self.limit is None else f" of {self.limit:.2g}{self.unit}"
        return f"{self.value:.2g}{self.unit}{limit}"


@dataclass
class Findings:
    """What happened in one case.

    Args:
        said: statements that held, each once.
        figures: the worst of each, by name.
        broken: what must not be; empty where the case holds.
    """

    said: list[str] = field(default_factory=list)
    figures: dict[str, Figure] = field(default_factory=dict)
    broken: list[str] = field(default_factory=list)
    _at: str = ""

    @property
    def happened(self) -> str:
        """What was seen, of figures those closest to their limits; where the case does not hold, what is wrong."""
        if self.broken:
            return "; ".join(dict.fromkeys(self.broken))
        closest = sorted(self.figures, key=lambda what: -self.figures[what].share)[:SHOWN]
        more = len(self.figures) - len(closest)
        figures = [f"{what} {self.figures[what]}" for what in self.figures if what in closest]
        return "; ".join([*self.said, *figures, *([f"{more} figures farther from their limits"] if more else [])])

    def each(self, values: Mapping[str, T] | Sequence[T]) -> Iterator[T]:
        """Give values one by one; what does not hold is told with the name of the value."""
        pairs = values.items() if isinstance(values, Mapping) else ((f"{value:.3g}", value) for value in values)
        for name, value in pairs:
            self._at = f"{name}: "
            yield value
        self._at = ""

    def require(self, holds: bool, statement: str) -> None:
        """Note whether a statement holds."""
        if not holds:
            self.broken.append(f"{self._at}NOT {statement}")
        elif statement not in self.said:
            self.said.append(statement)

    def below(self, what: str, value: float, limit: float, unit: str = "") -> None:
        """Note a figure that must lie under a limit."""
        figure = Figure(float(value), float(limit), unit)
        if not figure.holds:
            self.broken.append(f"{self._at}{what} {figure}")
        known = self.figures.get(what)
        if known is None or not figure.share <= known.share:
            self.figures[what] = figure

    def seen(self, what: str, value: float, unit: str = "") -> None:
        """Note a figure of which nothing is required."""
        self.figures[what] = Figure(float(value), None, unit)

    def finite(self, what: str, arrays: Mapping[str, np.ndarray]) -> None:
        """Require every number of some arrays to be finite."""
        faulty = [name for name, array in arrays.items() if not np.isfinite(array).all()]
        self.require(not faulty, f"{what} finite" + (f": {', '.join(faulty)}" if faulty else ""))

    def same_bits(self, what: str, given: Mapping[str, np.ndarray], expected: Mapping[str, np.ndarray]) -> None:
        """Require arrays to be the same, number for number."""
        differing = [name for name in expected if not np.array_equal(given[name], expected[name])]
        self.require(not differing, f"{what} to the bit" + (f": {', '.join(differing)}" if differing else ""))

    def refused(self, action: Callable[[], object], error: type[SachaError], words: str) -> None:
        """Require an action to be refused with an error whose message holds some words."""
        try:
            action()
        except error as refusal:
            told = f"refused: {refusal}"
            self.require(words in str(refusal), "refused by name" if words in str(refusal) else f"{words} in {told}")
        else:
            self.require(holds=False, statement=f"refused with {error.__name__}")


@dataclass(frozen=True)
class Case:
    """One row of the matrix.

    Args:
        name: unique in its family.
        given: the hard input, in words.
        must: what must happen, in words.
        check: looks whether it does, and notes what it finds.
        slow: takes more than a few seconds.
    """

    name: str
    given: str
    must: str
    check: Callable[[Findings], None]
    slow: bool = False

    def run(self) -> Findings:
        """Look what happens."""
        findings = Findings()
        self.check(findings)
        return findings
