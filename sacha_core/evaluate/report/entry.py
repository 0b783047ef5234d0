"""One measured quantity over the seeds: what every table, figure and verdict of a report is made of."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any

import numpy as np

__all__ = ["NOVEL_EXPRESSION", "NOVEL_VIEW", "SETTINGS", "Entry", "Seeds"]

NOVEL_VIEW, NOVEL_EXPRESSION = "novel_view", "novel_expression"
SETTINGS = (NOVEL_VIEW, NOVEL_EXPRESSION)


@dataclass(frozen=True)
class Seeds:
    """A value for each seed that has one.

    Args:
        values: by seed.
        missing: why a seed has none, by seed.
    """

    values: Mapping[int, float]
    missing: Mapping[int, str] = field(default_factory=dict)


@dataclass(frozen=True)
class Entry:
    """A quantity of one variant, or of one variant against another, by seed.

    Args:
        table: which table it belongs to.
        dataset: name of the capture.
        variant: name of the variant.
        quantity: what was measured.
        unit: of the values; empty for plain numbers.
        seeds: the value of each seed that has one.
        against: the variant that it is held against; None for the variant's own figures.
        setting: `NOVEL_VIEW` or `NOVEL_EXPRESSION`; None where pictures play no part.
        region: of the head; None for the whole picture.
        level: of the codec, 0 uncompressed; None where levels play no part, or all of them.
    """

    table: str
    dataset: str
    variant: str
    quantity: str
    unit: str
    seeds: Seeds
    against: str | None = None
    setting: str | None = None
    region: str | None = None
    level: int | None = None

    @property
    def values(self) -> tuple[float, ...]:
        """Values in the order of the seeds."""
        return tuple(value for _, value in sorted(self.seeds.values.items()))

    @property
    def n_seeds(self) -> int:
        """How many seeds have a value."""
        return len(self.seeds.values)

    @property
    def mean(self) -> float:
        """Mean over the seeds; not a number where there are none."""
        return float(np.mean(self.values)) if self.seeds.values else math.nan

    @property
    def sd(self) -> float:
        """Standard deviation over the seeds, dividing by one less than their number; not a number below two seeds."""
        return float(np.std(self.values, ddof=1)) if self.n_seeds > 1 else math.nan

    @property
    def n_positive(self) -> int:
        """How many seeds have a value above 0."""
        return sum(value > 0 for value in self.values)

    @property
    def why_missing(self) -> str:
        """Say which seeds have no value and why; empty where all have one."""
        reasons: dict[str, list[int]] = {}
        for seed, reason in sorted(self.seeds.missing.items()):
            reasons.setdefault(reason, []).append(seed)
        return "; ".join(
            f"seed{'s' * (len(seeds) > 1)} {', '.join(map(str, seeds))}: {reason}" for reason, seeds in reasons.items()
        )

    def record(self) -> dict[str, Any]:
        """Give plain values, None for what there is not."""
        return {
            "table": self.table,
            "dataset": self.dataset,
            "variant": self.variant,
            "against": self.against,
            "quantity": self.quantity,
            "setting": self.setting,
            "region": self.region,
            "level": self.level,
            "unit": self.unit,
            "n_seeds": self.n_seeds,
            "mean": _or_none(self.mean),
            "sd": _or_none(self.sd),
            "n_positive": self.n_positive if self.against else None,
            "by_seed": {str(seed): value for seed, value in sorted(self.seeds.values.items())},
            "missing": self.why_missing,
        }


def _or_none(value: float) -> float | None:
    return None if math.isnan(value) else value
