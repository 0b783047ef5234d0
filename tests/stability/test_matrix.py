"""Every hard case of `sacha bench stability`, each a test of its own: the matrix is the test, and says itself what its oracle is."""

from __future__ import annotations

import pytest

from sacha_core.bench.stability.case import Case
from sacha_core.bench.stability.matrix import FAMILIES


def parameters() -> list:
    return [
        pytest.param(case, id=f"{name}: {case.name}", marks=[pytest.mark.slow] if case.slow else [])
        for name, family in FAMILIES.items()
        for case in family.cases(False)
    ]


@pytest.mark.parametrize("case", parameters())
def test_what_must_happen_happens(case: Case) -> None:
    findings = case.run()
    assert findings.happened, "nothing was looked at"
    assert not findings.broken


@pytest.mark.parametrize("full", [False, True])
def test_names_tell_cases_apart(full: bool) -> None:
    for family in FAMILIES.values():
        names = [case.name for case in family.cases(full)]
        assert len(set(names)) == len(names) > 0
