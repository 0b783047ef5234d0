# SPDX-License-Identifier: GPL-3.0-or-later
"""A mesh's budget as options of the engine's command `prune`."""

from __future__ import annotations

from pathlib import Path

import bpy

from .. import sources

__all__ = ["budget_options"]


def budget_options(context: bpy.types.Context, mesh: bpy.types.Mesh) -> list[str | Path]:
    """Give the options that say what is asked of each region, what the limit is, and what to measure.

    Raises:
        ValueError: a region's least share is above its largest.
    """
    asked, chosen = mesh.sacha_steering, context.scene.sacha
    given: list[str | Path] = ["--views", str(asked.views)]
    given += _weights(asked) + _shares(asked) + _locks(mesh)
    if asked.limit == "SIZE":
        given += ["--target-size", str(round(1000 * asked.target_kb))]
    else:
        given += ["--keep", f"{asked.keep / 100:.6g}", "--level", str(chosen.level)]
    if chosen.motion:
        given += ["--motion", sources.full_path(chosen.motion)]
    if asked.measure:
        given.append("--measure")
    if asked.dataset:
        given += ["--dataset", sources.full_path(asked.dataset)]
    return given


def _weights(asked: bpy.types.PropertyGroup) -> list[str]:
    texts = [f"{row.name}={row.weight:.6g}" for row in asked.regions if row.weight != 1]
    return ["--weights", *texts] if texts else []


def _shares(asked: bpy.types.PropertyGroup) -> list[str]:
    texts = []
    for row in asked.regions:
        low, high = row.lowest_share, row.highest_share
        if row.locked or (low <= 0 and high >= 100):
            continue
        if low > high:
            raise ValueError(
                f"{row.name} shall have at least {low:g} % and at most {high:g} %: raise the one, or lower the other"
            )
        texts.append(f"{row.name}={low / 100:.6g}:{high / 100:.6g}")
    return ["--shares", *texts] if texts else []


def _locks(mesh: bpy.types.Mesh) -> list[str]:
    now = {row.name: row.gaussians for row in mesh.sacha.regions}
    texts = [f"{row.name}={now[row.name]}" for row in mesh.sacha_steering.regions if row.locked]
    return ["--lock", *texts] if texts else []
