"""The shape that each row of an array must have."""

from __future__ import annotations

from sacha_core.errors import FormatError

__all__ = ["RowShape", "check_rows"]

RowShape = tuple[int | None, ...]


def check_rows(name: str, shape: tuple[int, ...], row: RowShape) -> None:
    """Check that an array is made of rows of a certain shape.

    Args:
        name: of the array, for the message.
        shape: what it has.
        row: what it should have behind the number of rows; None stands for any size.

    Raises:
        FormatError: it has another one.
    """
    fits = len(shape) == 1 + len(row) and all(want in {None, got} for want, got in zip(row, shape[1:], strict=True))
    if not fits:
        wanted = ", ".join("any" if want is None else str(want) for want in row)
        raise FormatError(f"{name} has shape {shape}, expected (rows{', ' + wanted if wanted else ''})")
