"""What a scene may have besides its mesh and views, such as a rig or cameras: arrays and plain values, each by name."""

from __future__ import annotations

from dataclasses import dataclass, fields
from typing import Any

import numpy as np

__all__ = ["Part", "part_of"]


@dataclass(frozen=True)
class Part:
    """A part of a scene, ready to be stored.

    Args:
        arrays: by name.
        values: what JSON can hold, by name.
    """

    arrays: dict[str, np.ndarray]
    values: dict[str, Any]


def part_of(described: Any) -> Part:
    """Sort the fields of a dataclass: arrays, plain values, and those that are None, which are left out."""
    given = {field.name: getattr(described, field.name) for field in fields(described)}
    arrays = {name: value for name, value in given.items() if isinstance(value, np.ndarray)}
    values = {name: value for name, value in given.items() if value is not None and name not in arrays}
    return Part(arrays, values)
