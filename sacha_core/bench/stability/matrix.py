"""All families of hard cases."""

from __future__ import annotations

from collections.abc import Iterable
from typing import Protocol

from sacha_core.bench.stability import (
    avatar,
    captures,
    determinism,
    drift,
    gradients,
    posing,
    raster,
    regions,
    training,
    triangles,
)
from sacha_core.bench.stability.case import Case

__all__ = ["FAMILIES", "Family"]


class Family(Protocol):
    """Gives the cases of a family."""

    def __call__(self, full: bool = False) -> Iterable[Case]:
        """Give them; `full` looks closer, and takes longer."""


FAMILIES: dict[str, Family] = {
    "raster": raster.cases,
    "avatar": avatar.cases,
    "triangles": triangles.cases,
    "posing": posing.cases,
    "gradients": gradients.cases,
    "regions": regions.cases,
    "captures": captures.cases,
    "training": training.cases,
    "drift": drift.cases,
    "determinism": determinism.cases,
}
