"""What a bench found: rows of plain values, and how to set and draw them."""

from __future__ import annotations

from dataclasses import asdict, dataclass, field
from typing import Any

__all__ = ["Bench", "Column", "Panel", "Row", "Table"]

Row = dict[str, Any]


@dataclass(frozen=True)
class Column:
    """One column of a table.

    Args:
        key: of a row's value; a row without it leaves the cell empty.
        title: what the reader sees, with the unit.
        decimals: digits after the point; None for three digits that count.
    """

    key: str
    title: str
    decimals: int | None = None


@dataclass(frozen=True)
class Table:
    """The rows whose "table" is `name`, set in columns.

    Args:
        name: which rows.
        caption: what is seen here, in a sentence or two.
        columns: from left to right.
        identity: keys that tell one row from another, by which two runs are compared.
    """

    name: str
    caption: str
    columns: tuple[Column, ...]
    identity: tuple[str, ...]

    def key_of(self, row: Row) -> tuple[Any, ...]:
        """Give what tells one of its rows from another."""
        return tuple(row.get(key) for key in self.identity)


@dataclass(frozen=True)
class Panel:
    """One pair of axes in a bench's picture: the rows of a table as points.

    Where rows have quartiles beside `x` or `y` (see `Times.row`) they are drawn as bars.

    Args:
        title: what is seen.
        table: which rows; those without `x` or `y` are left out.
        x: key along the abscissa.
        y: key along the ordinate, or several: key to its name in the legend.
        x_label: with the unit.
        y_label: with the unit.
        series: key whose values each get a colour and a line; None for one colour.
        label: key of what is written beside each point; None for nothing.
        log_x: logarithmic abscissa. Zeros, which have no logarithm, lie on a line of their own at the edge.
        log_y: logarithmic ordinate.
        joined: whether points of a series are joined by a line.
        growth: whether each series' legend gives the exponent fitted to its largest sizes.
        bars: whether rows are horizontal bars of length `x`, named by `y`, instead of points.
    """

    title: str
    table: str
    x: str
    y: str | dict[str, str]
    x_label: str
    y_label: str
    series: str | None = None
    label: str | None = None
    log_x: bool = True
    log_y: bool = True
    joined: bool = True
    growth: bool = False
    bars: bool = False

    @property
    def ordinates(self) -> dict[str, str]:
        """Keys along the ordinate and their names in the legend."""
        return {self.y: ""} if isinstance(self.y, str) else self.y


@dataclass(frozen=True)
class Bench:
    """What one bench found.

    Args:
        rows: figures; each row names its "table".
        tables: in the order to be read.
        panels: of its picture; none for a bench without one.
        notes: what a reader has to know, a sentence or two each.
        broken: names of what must hold and does not; the command then ends with exit status 1.
        more: rows of another kind than `rows`, for a bench whose `rows` all have the same keys.
    """

    rows: list[Row]
    tables: tuple[Table, ...]
    panels: tuple[Panel, ...] = ()
    notes: tuple[str, ...] = ()
    broken: tuple[str, ...] = ()
    more: list[Row] = field(default_factory=list)

    def of(self, table: Table | Panel) -> list[Row]:
        """Give the rows of a table, or those that a panel shows."""
        if isinstance(table, Table):
            return [row for row in (*self.rows, *self.more) if row["table"] == table.name]
        shown = [
            row for row in (*self.rows, *self.more) if row["table"] == table.table and row.get(table.x) is not None
        ]
        return [row for row in shown if any(row.get(key) is not None for key in table.ordinates)]

    def record(self) -> dict[str, Any]:
        """Give everything as plain values, from which `from_record` makes it anew."""
        return asdict(self)

    @classmethod
    def from_record(cls, record: dict[str, Any]) -> Bench:
        """Make the bench of which `record` gave the record.

        Raises:
            KeyError, TypeError: it is the record of something else.
        """
        tables = tuple(
            Table(**{**one, "columns": tuple(Column(**c) for c in one["columns"]), "identity": tuple(one["identity"])})
            for one in record["tables"]
        )
        return cls(
            record["rows"],
            tables,
            tuple(Panel(**p) for p in record["panels"]),
            tuple(record["notes"]),
            tuple(record["broken"]),
            record["more"],
        )
