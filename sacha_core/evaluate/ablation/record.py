"""Frozen dataclasses from plain JSON values, every field checked."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import fields, is_dataclass
from types import NoneType
from typing import Any, TypeVar, get_args, get_origin, get_type_hints

from sacha_core.errors import FormatError

__all__ = ["read_record"]

Record = TypeVar("Record")


def read_record(kind: type[Record], value: Any, where: str) -> Record:
    """Build a dataclass from what `dataclasses.asdict` and JSON made of one.

    Fields may be str, int, float, unions with None, other dataclasses, tuples of one type of any length, and mappings from str.

    Args:
        kind: the dataclass.
        value: plain values.
        where: what errors call it.

    Raises:
        FormatError: naming the first field that is missing, unknown, or of another type.
    """
    built: Record = _build(kind, value, where)
    return built


def _build(kind: Any, value: Any, where: str) -> Any:
    if is_dataclass(kind):
        return _dataclass(kind, value, where)
    origin, inner = get_origin(kind), get_args(kind)
    if NoneType in inner:
        return None if value is None else _build(inner[0], value, where)
    if origin is tuple:
        _require(isinstance(value, list), where, value, "a list")
        return tuple(_build(inner[0], item, f"{where}[{row}]") for row, item in enumerate(value))
    if origin is Mapping:
        _require(isinstance(value, dict), where, value, "an object")
        return {str(name): _build(inner[1], item, f"{where}.{name}") for name, item in value.items()}
    return _plain(kind, value, where)


def _dataclass(kind: Any, value: Any, where: str) -> Any:
    _require(isinstance(value, dict), where, value, "an object")
    names, hints = [field.name for field in fields(kind)], get_type_hints(kind)
    for name in names:
        if name not in value:
            raise FormatError(f"{where} has no field {name}")
    for name in value:
        if name not in names:
            raise FormatError(f"{where} has a field {name}, which is unknown")
    return kind(**{name: _build(hints[name], value[name], f"{where}.{name}") for name in names})


def _plain(kind: Any, value: Any, where: str) -> Any:
    if kind is str:
        _require(isinstance(value, str), where, value, "a text")
        return value
    number = isinstance(value, int | float) and not isinstance(value, bool) and math.isfinite(value)
    if kind is int:
        _require(number and isinstance(value, int), where, value, "a whole number")
        return value
    _require(number, where, value, "a finite number")
    return float(value)


def _require(holds: bool, where: str, value: Any, expected: str) -> None:
    if not holds:
        shown = repr(value)
        raise FormatError(f"{where} is {shown[:40]}{'...' if len(shown) > 40 else ''}, expected {expected}")
