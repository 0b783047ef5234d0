"""How cost grows with work: the exponent of a power law, fitted."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from sacha_core.bench.result import Column, Row, Table

__all__ = ["LARGEST", "Growth", "fit_growth", "growth_rows", "growth_table"]

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


def growth_table(what: str) -> Table:
    """Give the table in which `growth_rows` are set.

    Args:
        what: what the sizes count, such as `Gaussians`.
    """
    caption = (
        f"How time grows with {what}: the exponent of a power law (1: in proportion), fitted to all sizes; to the largest; and to the "
        "largest with the time of the smallest taken off, which leaves what growth itself costs."
    )
    columns = (
        Column("of", "time of"), Column("size", "by"), Column("fitted", "fitted to"), Column("from", "from"), Column("to", "to"),
        Column("exponent", "exponent", 2), Column("standard_error", "standard error", 2),
    )  # fmt: skip
    return Table("growth", caption, columns, ("of", "size", "fitted"))


def growth_rows(of: str, size: str, sizes: Sequence[float], costs: Sequence[float]) -> list[Row]:
    """Give rows of fitted exponents.

    Args:
        of: what was timed.
        size: what the sizes count, such as `Gaussians`.
        sizes: at least two different values, in ascending order.
        costs: one for each size.
    """
    x, y = np.asarray(sizes, float), np.asarray(costs, float)
    last = slice(-min(LARGEST, len(x)), None)
    beyond_x, beyond_y = x[1:][last] - x[0], y[1:][last] - y[0]
    fits = {"all": (x, y), "the largest": (x[last], y[last]), "the largest, less the smallest": (beyond_x, beyond_y)}
    rows: list[Row] = []
    for fitted, (some_x, some_y) in fits.items():
        if len(some_x) < 2 or not (some_y > 0).all():  # noise, where growth costs less than it
            continue
        growth = fit_growth(some_x.tolist(), some_y.tolist())
        ends = sizes[-len(some_x)], sizes[-1]
        rows.append(
            {"table": "growth", "of": of, "size": size, "fitted": fitted, "from": ends[0], "to": ends[1],
             "exponent": growth.exponent, "standard_error": growth.standard_error, "n_sizes": growth.n_sizes}
        )  # fmt: skip
    return rows
