"""What a case may say of itself: a statement that does not hold breaks it, and nothing else does."""

from __future__ import annotations

import numpy as np
import pytest

from sacha_core.bench.stability.case import Case, Findings
from sacha_core.errors import FormatError, GeometryError


def refuse(message: str) -> None:
    raise GeometryError(message)


HOLDS = {
    "require": lambda f: f.require(holds=True, statement="so"),
    "below": lambda f: f.below("error", 0.5, 1.0, " mm"),
    "seen": lambda f: f.seen("error", np.inf),
    "finite": lambda f: f.finite("all", {"a": np.zeros(3), "b": np.ones(0)}),
    "same bits": lambda f: f.same_bits("others", {"a": np.ones(3), "more": np.ones(1)}, {"a": np.ones(3)}),
    "refused": lambda f: f.refused(lambda: refuse("triangle 3 has zero area"), GeometryError, "triangle 3"),
}
BREAKS = {
    "require": lambda f: f.require(holds=False, statement="so"),
    "at the limit": lambda f: f.below("error", 1.0, 1.0),
    "above the limit": lambda f: f.below("error", 2.0, 1.0),
    "not a number": lambda f: f.below("error", np.nan, 1.0),
    "not finite": lambda f: f.finite("all", {"a": np.zeros(3), "b": np.array([1, np.inf])}),
    "a bit": lambda f: f.same_bits("others", {"a": np.array([1.0])}, {"a": np.nextafter([1.0], 2)}),
    "not refused": lambda f: f.refused(lambda: None, GeometryError, "triangle"),
    "refused in other words": lambda f: f.refused(lambda: refuse("something else"), GeometryError, "triangle 3"),
}


@pytest.mark.parametrize("check", HOLDS.values(), ids=HOLDS)
def test_what_holds_is_said_and_breaks_nothing(check) -> None:
    findings = Case("name", "given", "must", check).run()
    assert findings.said
    assert not findings.broken


@pytest.mark.parametrize("check", BREAKS.values(), ids=BREAKS)
def test_what_does_not_hold_breaks_the_case(check) -> None:
    findings = Case("name", "given", "must", check).run()
    assert findings.broken == findings.said
    assert len(findings.broken) == 1


def test_an_error_of_another_kind_is_not_taken_for_a_refusal() -> None:
    case = Case("name", "given", "must", lambda f: f.refused(lambda: refuse("triangle 3"), FormatError, "triangle 3"))
    with pytest.raises(GeometryError):
        case.run()


def test_what_is_said_twice_is_told_once_and_figures_are_kept() -> None:
    findings = Findings()
    for _ in range(2):
        findings.below("error", 0.25, 1.0, " mm")
    assert findings.said == ["error 0.25 mm (limit 1 mm)"]
    assert findings.figures == {"error": 0.25}
