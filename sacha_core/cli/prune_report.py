"""What `sacha prune` says of its result: region by region, beside what was before."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

from sacha_core.cli.console import table

if TYPE_CHECKING:
    from sacha_core.avatar.gaussians import Gaussians
    from sacha_core.cli.console import Console
    from sacha_core.cli.prune import Options
    from sacha_core.cli.pruned import Pruned
    from sacha_core.cli.sources import Opened
    from sacha_core.density.scores_file import Scores
    from sacha_core.interchange.capture import Capture
    from sacha_core.regions.partition import Partition

__all__ = ["Row", "judge", "region_table", "report"]

Row = Mapping[str, Any]
Decibels = Sequence[float | None]


def judge(
    options: Options,
    opened: Opened,
    before: Opened,
    pruned: Pruned,
    capture: Capture | None,
    partition: Partition,
    console: Console,
) -> list[Row]:
    """Give what each region has: Gaussians that were scored and that stayed; of what was before; and decibels of both.

    Raises:
        SachaError: the capture is incomplete or another avatar's, or a frame cannot be posed.
    """
    decibels: tuple[Decibels, Decibels] = ([None] * len(partition.regions),) * 2
    if options.measure:
        decibels = measured(opened, before, pruned, capture, partition, console)
    found, n_left = pruned.found, max(len(pruned.gaussians), 1)
    shown, left = (counts(gaussians, partition) for gaussians in (before.avatar.gaussians, pruned.gaussians))
    return [
        {
            "region": name,
            "before": found.pruning.before[label],
            "after": left[label],
            "kept": left[label] / max(found.pruning.before[label], 1),
            "share": left[label] / n_left,
            "modulator": float(found.modulator[label]),
            "shown_before": shown[label],
            "share_before": shown[label] / max(len(before.avatar.gaussians), 1),
            "psnr_db": decibels[1][label],
            "psnr_before_db": decibels[0][label],
        }
        for label, name in enumerate(partition.regions)
    ]


def counts(gaussians: Gaussians, partition: Partition) -> list[int]:
    """Count Gaussians by region."""
    import numpy as np

    counted: list[int] = np.bincount(partition.labels[gaussians.binding], minlength=len(partition.regions)).tolist()
    return counted


def measured(
    opened: Opened, before: Opened, pruned: Pruned, capture: Capture | None, partition: Partition, console: Console
) -> tuple[Decibels, Decibels]:
    """Give decibels by region of what was before and of the result."""
    from dataclasses import replace

    from sacha_core.evaluate.region_quality import capture_region_psnr, own_region_psnr

    head, result = opened.head, replace(opened.avatar, gaussians=pruned.gaussians)
    if capture is None:
        truth, motion = opened.avatar.gaussians, opened.avatar.motion
        found = [pruned.gaussians] if before is opened else [before.avatar.gaussians, pruned.gaussians]
        psnr = own_region_psnr(truth, found, head, motion, partition, report=console.report)
        return ([None] * len(partition.regions) if before is opened else psnr[0]), psnr[-1]
    old, new = (
        capture_region_psnr(avatar, head, capture, partition, report=console.report)
        for avatar in (before.avatar, result)
    )
    return old, new


def region_table(rows: Sequence[Row]) -> str:
    """Set what each region kept as a table."""
    head = ["region", "before", "after", "kept", "share", "m_R / weight"]
    with_pictures = any(row["psnr_db"] is not None for row in rows)
    lines = []
    for row in rows:
        line = [row["region"], f"{row['before']:,}", f"{row['after']:,}", f"{row['kept']:.1%}", f"{row['share']:.1%}"]
        line.append(f"{row['modulator']:.3f}")
        if with_pictures:
            line.extend("-" if row[key] is None else f"{row[key]:.2f} dB" for key in ("psnr_before_db", "psnr_db"))
        lines.append(line)
    return table([*head, *(("PSNR before", "after") if with_pictures else ())], lines)


def report(
    options: Options,
    pruned: Pruned,
    n_bytes: int | None,
    scores: Scores,
    path: Path,
    partition: Partition,
    rows: Sequence[Row],
) -> dict[str, Any]:
    """Give the report for machines."""
    before = options.before or options.avatar
    return {
        "avatar": options.avatar,
        "scores": path,
        "output": options.output,
        "scheme": partition.name,
        "n_before": len(scores.score),
        "n_gaussians": len(pruned.found.rows),
        "n_bytes": n_bytes,
        "n_bytes_before": before.stat().st_size if before.is_file() else None,
        "quality": pruned.quality,
        "n_trials": pruned.n_trials,
        "scope": options.scope,
        "regions": rows,
    }
