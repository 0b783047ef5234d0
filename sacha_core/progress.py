"""How long work tells whoever is waiting where it stands."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field

__all__ = ["Progress", "Report", "silent"]


@dataclass(frozen=True)
class Progress:
    """One step of a long job.

    Args:
        stage: what is being done, in a word or two ("train", "render novel views").
        done: steps finished.
        total: steps in this stage.
        values: figures worth showing beside the bar (loss, number of Gaussians).
    """

    stage: str
    done: int
    total: int
    values: dict[str, float] = field(default_factory=dict)


Report = Callable[[Progress], None]


def silent(progress: Progress) -> None:
    """Report nothing: the default where nobody is waiting."""
