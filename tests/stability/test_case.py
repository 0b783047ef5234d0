"""What a case may say of itself: a statement that does not hold breaks it, and nothing else does."""

from __future__ import annotations

import numpy as np
import pytest

from sacha_core.bench.stability.case import Case, Figure, Findings
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
def test_what_holds_is_told_and_breaks_nothing(check) -> None:
    findings = Case("name", "given", "must", check).run()
    assert findings.happened
    assert not findings.broken


@pytest.mark.parametrize("check", BREAKS.values(), ids=BREAKS)
def test_what_does_not_hold_breaks_the_case_and_is_all_that_is_told(check) -> None:
    findings = Case("name", "given", "must", check).run()
    findings.require(holds=True, statement="that")
    assert [findings.happened] == findings.broken


def test_an_error_of_another_kind_is_not_taken_for_a_refusal() -> None:
    case = Case("name", "given", "must", lambda f: f.refused(lambda: refuse("triangle 3"), FormatError, "triangle 3"))
    with pytest.raises(GeometryError):
        case.run()


def test_the_worst_of_each_figure_is_kept_and_statements_are_told_once() -> None:
    findings = Findings()
    for value in findings.each((0.25, 0.5, 0.125)):
        findings.below("error", value, 1.0, " mm")
        findings.require(holds=True, statement="finite")
    assert findings.happened == "finite; error 0.5 mm of 1 mm"
    findings.below("error", 0.4, 0.5, " mm")  # closer to its limit, though smaller
    assert findings.figures["error"] == Figure(0.4, 0.5, " mm")


def test_what_is_wrong_is_told_with_the_value_that_it_is_wrong_with() -> None:
    findings = Findings()
    for value in findings.each({"good": 0.0, "bad": np.nan}):
        findings.below("error", value, 1.0)
    findings.require(holds=False, statement="afterwards")
    assert findings.broken == ["bad: error nan of 1", "NOT afterwards"]


def test_of_many_figures_those_closest_to_their_limits_are_told() -> None:
    findings = Findings()
    for k in range(9):
        findings.below(f"figure {k}", k / 10, 1.0)
    assert findings.happened == (
        "figure 5 0.5 of 1; figure 6 0.6 of 1; figure 7 0.7 of 1; figure 8 0.8 of 1; 5 figures farther from their limits"
    )
