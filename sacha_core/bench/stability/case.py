"""A hard case: what is given, what must happen, and the code that looks whether it does."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field

import numpy as np

from sacha_core.errors import SachaError

__all__ = ["Case", "Findings"]


@dataclass
class Findings:
    """What happened in one case, statement by statement.

    Args:
        said: what was seen, in order.
        broken: which of it must not be; empty where the case holds.
        figures: what was measured, by name.
    """

    said: list[str] = field(default_factory=list)
    broken: list[str] = field(default_factory=list)
    figures: dict[str, float] = field(default_factory=dict)

    def require(self, holds: bool, statement: str) -> None:
        """Note whether a statement holds."""
        self._say(statement if holds else f"NOT {statement}", holds)

    def below(self, what: str, value: float, limit: float, unit: str = "") -> None:
        """Note a figure that must lie under a limit; what is not a number does not."""
        self.figures[what] = float(value)
        self._say(f"{what} {_figure(value)}{unit} (limit {_figure(limit)}{unit})", bool(value < limit))

    def seen(self, what: str, value: float, unit: str = "") -> None:
        """Note a figure of which nothing is required."""
        self.figures[what] = float(value)
        self._say(f"{what} {_figure(value)}{unit}", holds=True)

    def finite(self, what: str, arrays: Mapping[str, np.ndarray]) -> None:
        """Require every number of some arrays to be finite."""
        faulty = [name for name, array in arrays.items() if not np.isfinite(array).all()]
        self._say(f"{what} finite" if not faulty else f"{what} NOT finite: {', '.join(faulty)}", not faulty)

    def same_bits(self, what: str, given: Mapping[str, np.ndarray], expected: Mapping[str, np.ndarray]) -> None:
        """Require arrays to be the same, number for number."""
        differing = [name for name in expected if not np.array_equal(given[name], expected[name])]
        self._say(
            f"{what} bit-equal" if not differing else f"{what} NOT bit-equal: {', '.join(differing)}", not differing
        )

    def refused(self, action: Callable[[], object], error: type[SachaError], words: str) -> None:
        """Require an action to be refused with an error whose message holds some words."""
        try:
            action()
        except error as refusal:
            self._say(f"{error.__name__}: {refusal}", words in str(refusal))
        else:
            self._say(f"NOT refused with {error.__name__}", holds=False)

    def _say(self, statement: str, holds: bool) -> None:
        if statement not in self.said:
            self.said.append(statement)
        if not holds:
            self.broken.append(statement)


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


def _figure(value: float) -> str:
    return f"{value:.3g}"
