"""The table of regions: what each has, and what it had before."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from jaxtyping import Float, Int

from sacha_core.regions.partition import Partition
from sacha_core.scene.measures import total_over

__all__ = ["Before", "RegionTable", "region_table", "whole_bytes"]


@dataclass(frozen=True)
class Before:
    """What an avatar is held against.

    Args:
        name: of it, for people: "before pruning", or the name of another avatar.
        count: (r,) its Gaussians by region.
        n_bytes: (r,) the bytes of its Gaussians by region, or None.
    """

    name: str
    count: Int[np.ndarray, " r"]
    n_bytes: Int[np.ndarray, " r"] | None = None


@dataclass(frozen=True)
class RegionTable:
    """One row a region. A part of a scene: arrays and plain values.

    Args:
        scheme: name of the region scheme.
        names: of the r regions.
        triangles: (r,) how many each has.
        gaussians: (r,) how many each carries.
        share: (r,) of all Gaussians, 0 to 1; 0 where there are none.
        area_cm2: (r,) of the neutral head.
        n_bytes: (r,) of the file that describe its Gaussians; they add up to what `sacha inspect` gives for Gaussians. None where there is
            no file, or where it does not say.
        bytes_each: (r,) bytes for each of its Gaussians, 0 where it has none; None where `n_bytes` is.
        before_name: what the next ones are of; empty where there is nothing to compare with.
        before: (r,) Gaussians before, or None.
        before_share: (r,) its share of all Gaussians before, or None.
        change: (r,) Gaussians more than before, or None.
        before_bytes: (r,) bytes before, or None.
        bytes_change: (r,) bytes more than before, or None.
    """

    scheme: str
    names: tuple[str, ...]
    triangles: Int[np.ndarray, " r"]
    gaussians: Int[np.ndarray, " r"]
    share: Float[np.ndarray, " r"]
    area_cm2: Float[np.ndarray, " r"]
    n_bytes: Int[np.ndarray, " r"] | None = None
    bytes_each: Float[np.ndarray, " r"] | None = None
    before_name: str = ""
    before: Int[np.ndarray, " r"] | None = None
    before_share: Float[np.ndarray, " r"] | None = None
    change: Int[np.ndarray, " r"] | None = None
    before_bytes: Int[np.ndarray, " r"] | None = None
    bytes_change: Int[np.ndarray, " r"] | None = None


def region_table(
    regions: Partition,
    count: Int[np.ndarray, " f"],
    area_cm2: Float[np.ndarray, " f"],
    n_bytes: Float[np.ndarray, " f"] | None = None,
    before: Before | None = None,
) -> RegionTable:
    """Add up triangles by region."""
    carried = total_over(regions, count).astype(np.int32)
    spent = None if n_bytes is None else whole_bytes(total_over(regions, n_bytes))
    table = RegionTable(
        regions.name,
        regions.regions,
        np.bincount(regions.labels, minlength=len(regions.regions)).astype(np.int32),
        carried,
        _shares(carried),
        total_over(regions, area_cm2),
        spent,
        None if spent is None else spent / np.maximum(carried, 1) * (carried > 0),
    )
    if before is None:
        return table
    then = before.count.astype(np.int32)
    table = replace(table, before_name=before.name, before=then, before_share=_shares(then), change=carried - then)
    if before.n_bytes is None or spent is None:
        return table
    return replace(table, before_bytes=before.n_bytes, bytes_change=spent - before.n_bytes)


def _shares(count: Int[np.ndarray, " r"]) -> Float[np.ndarray, " r"]:
    """Give each region's part of all; 0 where there is nothing."""
    return np.asarray(count / max(int(count.sum()), 1))


def whole_bytes(n_bytes: Float[np.ndarray, " r"]) -> Int[np.ndarray, " r"]:
    """Round bytes to whole ones that add up to the same: down, and up again where most was cut off; ties go to the first."""
    down = np.floor(n_bytes).astype(np.int64)
    left = round(float(n_bytes.sum())) - int(down.sum())
    order = np.argsort(-(n_bytes - down), kind="stable")
    down[order[:left]] += 1
    return np.asarray(down.astype(np.int32))
