"""The order in which variants are shown."""

from __future__ import annotations

from collections.abc import Iterable

__all__ = ["ORDER", "in_order"]

ORDER = (
    "ga", "mask", "default", "default-seen", "default-gp-pis", "rad", "rad-gp-lgs", "rad-gp-pis", "paper", "paper-inverted", "paper-random",
    "sacha", "sacha-uniform", "sacha-inverted", "sacha-random",
)  # fmt: skip


def in_order(variants: Iterable[str]) -> tuple[str, ...]:
    """Give each variant once, those that are known in their order, others after them by name."""
    return tuple(sorted(set(variants), key=lambda name: (ORDER.index(name) if name in ORDER else len(ORDER), name)))
