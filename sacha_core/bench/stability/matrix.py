"""All families of hard cases."""

from __future__ import annotations

from collections.abc import Callable, Iterable
from dataclasses import dataclass

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


@dataclass(frozen=True)
class Family:
    """Cases that belong together.

    Args:
        what: they are about, in a sentence.
        cases: gives them; asked for all (True), it looks closer, and takes longer.
    """

    what: str
    cases: Callable[[bool], Iterable[Case]]


FAMILIES = {
    "raster": Family(
        "Splats as none should be, drawn forward and backward: five of them alone, and among 37 good ones.",
        raster.cases,
    ),
    "avatar": Family(
        "Values of an avatar's own parameters, on their way to the picture: of five Gaussians alone, and among 40 good ones.",
        avatar.cases,
    ),
    "triangles": Family("Triangles that are hard to carry anything.", triangles.cases),
    "posing": Family("FLAME's parameters at their extremes.", posing.cases),
    "gradients": Family("Gradients of the whole chain, from the loss to every parameter.", gradients.cases),
    "regions": Family(
        "Density control by region: calibration, scores, pruning, growth, reset of opacity.", regions.cases
    ),
    "captures": Family("Captures with little or nothing to learn from, each trained on for a while.", captures.cases),
    "training": Family("Steps of training that something is wrong with.", training.cases),
    "drift": Family("Training in float32 beside the same run in float64.", drift.cases),
    "determinism": Family("The same seed, the same bytes.", determinism.cases),
}
