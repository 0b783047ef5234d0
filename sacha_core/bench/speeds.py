"""How fast a machine was in two runs, and whether times of the two can be compared at all."""

from __future__ import annotations

import math
from typing import Any, NamedTuple

from sacha_core.bench.reference import PARTS

__all__ = ["Speeds", "compare_speeds"]

STEADY = 1.5  # times: what the reference may differ by within a run, from its tenth to its ninetieth percentile
SHARED = (
    1.1  # times: what the reference may take over its processor time, before others are said to have had the processor
)
APART = 1.25  # times: what the two parts' ratios may differ by, before one number cannot stand for both
SAME = ("processor", "cores", "python", "numpy", "numba")


class Speeds(NamedTuple):
    """The speeds of two runs.

    Attributes:
        wall: how much longer the reference took in the second run; None where it is not known.
        busy: of processor time.
        why_not: why times cannot be compared, even relative to the reference; empty where they can.
    """

    wall: float | None
    busy: float | None
    why_not: str


def compare_speeds(first: dict[str, Any], second: dict[str, Any]) -> Speeds:
    """Compare the machines of two runs, as `machine.describe` and `Reference.row` describe them."""
    reasons = [f"another {key}" for key in SAME if first.get(key) != second.get(key)]
    one, other = first.get("reference"), second.get("reference")
    if not one or not other:
        return Speeds(None, None, ", ".join([*reasons, "no reference was taken"]))
    for which, speed in (("first", one), ("second", other)):
        spread = max(speed[f"{part}_high_ms"] / speed[f"{part}_low_ms"] for part in PARTS)
        if spread > STEADY:
            reasons.append(f"the machine's speed changed {spread:.1f} times in the {which} run")
        waited = max(speed[f"{part}_ms"] / speed[f"{part}_busy_ms"] for part in PARTS)
        if waited > SHARED:
            reasons.append(f"others had the processor in the {which} run (x {waited:.2f})")
    ratios = [other[f"{part}_ms"] / one[f"{part}_ms"] for part in PARTS]
    if max(ratios) > APART * min(ratios):
        each = " and ".join(f"x {ratio:.2f}" for ratio in ratios)
        reasons.append(f"arithmetic and memory changed differently ({each})")
    busy = [other[f"{part}_busy_ms"] / one[f"{part}_busy_ms"] for part in PARTS]
    return Speeds(math.prod(ratios) ** (1 / len(ratios)), math.prod(busy) ** (1 / len(busy)), ", ".join(reasons))
