"""What a `.sacha` file spends on each region of the head."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np

from sacha_core.cli.common import HeadSource
from sacha_core.cli.console import table
from sacha_core.cli.sources import open_avatar
from sacha_core.codec.spending import spent_bytes
from sacha_core.regions.labels import label_triangles, region_counts
from sacha_core.regions.scheme import find_scheme
from sacha_core.scene.region_table import whole_bytes

__all__ = ["region_rows", "region_table"]


def region_rows(file: Path, source: HeadSource) -> list[dict[str, Any]]:
    """Tell of each region what the file spends on it; bytes are rounded so that they add up to the file's for Gaussians.

    Raises:
        SachaError: the file is damaged, or its head or the head's regions are not to be found.
        OSError: it cannot be read.
    """
    opened = open_avatar(file, source)
    scheme = find_scheme(opened.avatar.scheme)
    labels = label_triangles(opened.head, scheme)
    counts = region_counts(labels, opened.avatar.gaussians.binding, scheme)
    spent = np.bincount(labels, spent_bytes(file, head=opened.head).triangles, len(scheme.regions))
    n, total = max(int(counts.sum()), 1), max(float(spent.sum()), 1.0)
    return [
        {
            "region": name,
            "gaussians": count,
            "share": count / n,
            "bytes": n_bytes,
            "share_of_bytes": n_bytes / total,
            "bytes_each": n_bytes / count if count else None,
        }
        for name, count, n_bytes in zip(scheme.regions, counts.tolist(), whole_bytes(spent).tolist(), strict=True)
    ]


def region_table(rows: list[dict[str, Any]]) -> str:
    """Set what regions take as a table."""
    cells = [
        (
            row["region"],
            f"{row['gaussians']:,}",
            f"{row['share']:.1%}",
            f"{row['bytes']:,}",
            f"{row['share_of_bytes']:.1%}",
            "-" if row["bytes_each"] is None else f"{row['bytes_each']:.2f} B",
        )
        for row in rows
    ]
    return table(("region", "Gaussians", "share", "bytes", "share", "each"), cells)
