"""How cost grows with work: the exponent of a power law, fitted."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

__all__ = ["LARGEST", "Growth", "fit_growth", "growth_rows"]

LARGEST = 3  # sizes that the exponent of large work is taken from: on small ones what does not grow weighs in


@dataclass(frozen=True)
class Growth:
    """A power law, cost = factor * size ** exponent.

    Args:
        factor: cost of size 1 on the fitted line.
        exponent: 1 for cost in proportion to size.
        standard_error: of the exponent; not a number where two points leave nothing to judge by.
        n_sizes: how many points the line was fitted to.
    """

    factor: float
    exponent: float
    standard_error: float
    n_sizes: int

    def __str__(self) -> str:
        """Give the exponent, with its standard error where there is one."""
        error = "" if np.isnan(self.standard_error) else f" ± {self.standard_error:.2f}"
        return f"{self.exponent:.2f}{error}"


def fit_growth(sizes: Sequence[float], costs: Sequence[float]) -> Growth:
    """Fit a line by least squares to the logarithms.

    Args:
        sizes: of at least two different values, above 0.
        costs: one for each size, above 0.

    Raises:
        ValueError: there are fewer than two different sizes, or a number is not above 0.

    Source: standard error of a slope by ordinary least squares.
    """
    x, y = np.asarray(sizes, float), np.asarray(costs, float)
    if len(np.unique(x)) < 2 or not ((x > 0).all() and (y > 0).all()):
        raise ValueError("a power law needs two different sizes, and sizes and costs above 0")
    x, y = np.log(x), np.log(y)
    spread = float(((x - x.mean()) ** 2).sum())
    exponent = float(((x - x.mean()) * (y - y.mean())).sum()) / spread
    offset = float(y.mean() - exponent * x.mean())
    rest = float(((y - offset - exponent * x) ** 2).sum())
    freedom = len(x) - 2
    error = float(np.sqrt(rest / freedom / spread)) if freedom > 0 else float("nan")
    return Growth(float(np.exp(offset)), exponent, error, len(x))


def growth_rows(
    table: str, of: str, what: str, sizes: Sequence[float], costs: Sequence[float]
) -> list[dict[str, object]]:
    """Give rows of a table of exponents: over all sizes, and over the largest alone.

    Args:
        table: name of the table.
        of: what was timed.
        what: what the size counts, such as `Gaussians`.
        sizes: at least two different values, in ascending order.
        costs: one for each size.
    """
    rows: list[dict[str, object]] = []
    for last in sorted({len(sizes), min(LARGEST, len(sizes))}, reverse=True):
        fitted = fit_growth(sizes[-last:], costs[-last:])
        rows.append(
            {
                "table": table, "of": of, "size": what, "from": sizes[-last], "to": sizes[-1],
                "exponent": fitted.exponent, "standard_error": fitted.standard_error, "n_sizes": fitted.n_sizes,
            }
        )  # fmt: skip
    return rows
