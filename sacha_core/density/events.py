"""What density control did and why: one record an event, one JSON object a line."""

from __future__ import annotations

import json
import os
from collections.abc import Iterable
from dataclasses import asdict, dataclass, fields
from pathlib import Path
from typing import Any

from sacha_core.errors import FormatError
from sacha_core.files import write_aside

__all__ = [
    "Calibration",
    "Densification",
    "Event",
    "HiddenRemoval",
    "MaskPruning",
    "OpacityReset",
    "Pruning",
    "dump_events",
    "parse_events",
    "write_events",
]

Numbers = tuple[float | None, ...]
Counts = tuple[int, ...]


@dataclass(frozen=True)
class Calibration:
    """Regions were measured, and got their thresholds and ratios. Every tuple has one entry a region; None stands for no mean.

    Args:
        iteration: after how many iterations.
        counts: Gaussians.
        visible_counts: Gaussians that training views show.
        mean_plain: mean sensitivity of all of the region's Gaussians.
        mean_visible: of those that training views show.
        mean_weighted: weighted by summed blending weight.
        overall_plain: over all regions, like the next two.
        overall_visible: see `overall_plain`.
        overall_weighted: see `overall_plain`.
        modulator: m_R.
        threshold: tau_R.
        ratio: rho_R.
        used: which mean the modulators were made of: plain, visible or weighted.
    """

    iteration: int
    counts: Counts
    visible_counts: Counts
    mean_plain: Numbers
    mean_visible: Numbers
    mean_weighted: Numbers
    overall_plain: float | None
    overall_visible: float | None
    overall_weighted: float | None
    modulator: Numbers
    threshold: Numbers
    ratio: Numbers
    used: str


@dataclass(frozen=True)
class Pruning:
    """Gaussians were removed by score.

    Args:
        iteration: after how many iterations.
        score: name of the score.
        guard: guard mode.
        before: (r,) counts.
        requested: (r,) removals asked for.
        removed: (r,) removals made.
        after: (r,) counts.
    """

    iteration: int
    score: str
    guard: str
    before: Counts
    requested: Counts
    removed: Counts
    after: Counts


@dataclass(frozen=True)
class HiddenRemoval:
    """Gaussians were removed because they never show.

    Args:
        iteration: after how many iterations.
        guard: guard mode.
        n_views: training views that were looked at.
        visible_pixels: blending weight, in pixels a view, above which a Gaussian shows.
        before: (r,) counts.
        requested: (r,) those that never show.
        removed: (r,) removals made.
        after: (r,) counts.
    """

    iteration: int
    guard: str
    n_views: int
    visible_pixels: float
    before: Counts
    requested: Counts
    removed: Counts
    after: Counts


@dataclass(frozen=True)
class MaskPruning:
    """Gaussians were removed because the masks that were learnt hide them.

    Args:
        iteration: after how many iterations.
        before: (r,) counts.
        removed: (r,) removals made.
        after: (r,) counts.
    """

    iteration: int
    before: Counts
    removed: Counts
    after: Counts


@dataclass(frozen=True)
class Densification:
    """Gaussians were cloned, split, and removed for being nearly transparent or far too large.

    Args:
        iteration: after how many iterations.
        before: (r,) counts.
        cloned: (r,) copies made.
        split: (r,) parents replaced by two.
        removed: (r,) nearly transparent or far too large ones removed.
        after: (r,) counts.
    """

    iteration: int
    before: Counts
    cloned: Counts
    split: Counts
    removed: Counts
    after: Counts


@dataclass(frozen=True)
class OpacityReset:
    """Opacities were brought down to a ceiling.

    Args:
        iteration: after how many iterations.
        ceiling: largest opacity left.
        lowered: Gaussians that were above it.
    """

    iteration: int
    ceiling: float
    lowered: int


Event = Calibration | Pruning | HiddenRemoval | MaskPruning | Densification | OpacityReset
KINDS = {
    "calibration": Calibration,
    "pruning": Pruning,
    "hidden_removal": HiddenRemoval,
    "mask_pruning": MaskPruning,
    "densification": Densification,
    "opacity_reset": OpacityReset,
}


def dump_events(events: Iterable[Event]) -> str:
    """Give events as JSON lines; `event` names the kind."""
    names = {kind: name for name, kind in KINDS.items()}
    return "".join(json.dumps({"event": names[type(event)], **asdict(event)}) + "\n" for event in events)


def parse_events(text: str) -> tuple[Event, ...]:
    """Read events back.

    Raises:
        FormatError: a line is no event; the message has its number.
    """
    return tuple(_parse_line(line, number) for number, line in enumerate(text.splitlines(), 1) if line.strip())


def _parse_line(line: str, number: int) -> Event:
    try:
        record: dict[str, Any] = json.loads(line)
        kind = KINDS[record.pop("event")]
    except (ValueError, KeyError, TypeError, AttributeError, RecursionError) as error:
        raise FormatError(f"event {number} is not a JSON object of a known kind ({', '.join(KINDS)})") from error
    names = {f.name for f in fields(kind)}
    if record.keys() != names:
        raise FormatError(f"event {number} has fields {sorted(record)}, expected {sorted(names)}")
    values = {name: tuple(value) if isinstance(value, list) else value for name, value in record.items()}
    event: Event = kind(**values)
    return event


def write_events(path: str | os.PathLike[str], events: Iterable[Event]) -> None:
    """Write events, aside and then moved into place."""
    with write_aside(path) as aside:
        Path(aside).write_text(dump_events(events), encoding="utf-8")
