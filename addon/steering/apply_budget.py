# SPDX-License-Identifier: GPL-3.0-or-later
"""Applying a budget: the engine chooses anew who stays, writes the file, and the mesh shows it beside what was."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import bpy
import numpy as np
from bpy.props import FloatProperty, StringProperty
from bpy_extras.io_utils import ExportHelper

from .. import engine, preferences, problem, running, sources
from ..active import avatar_of
from ..job import Job
from ..opening.scene_folder import read_scene_folder
from ..remembered import remember
from ..seeing import numbers
from ..seeing.division import shown_division, write_division
from .asking import budget_options
from .painting import painted
from .settings import list_regions, origin_of, steerable

__all__ = ["CLASSES"]


class SachaApplyBudget(bpy.types.Operator, ExportHelper):
    """Cut the avatar down to the budget, write the result, and show it on the mesh."""

    bl_idname = "sacha.apply_budget"
    bl_label = "Apply Budget"
    bl_description = (
        "Choose anew which Gaussians stay, write them into a new .sacha file, and show it here beside what was"
    )
    bl_options = {"UNDO"}  # noqa: RUF012  (Blender reads it as it is)

    filename_ext = ".sacha"
    filter_glob: StringProperty(default="*.sacha", options={"HIDDEN"})
    filepath: StringProperty(
        name="File",
        description="The new file; where empty, one beside the avatar",
        subtype="FILE_PATH",
        options={"SKIP_SAVE"},
    )
    weights: StringProperty(
        name="Weights",
        description="Set weights of regions first, such as: mouth=2, eyes=1.5",
        options={"SKIP_SAVE"},
    )
    target_kb: FloatProperty(
        name="Size (KB)",
        description="Set this largest size of the file first; 0 leaves the budget as it is",
        min=0.0,
        options={"SKIP_SAVE"},
    )
    wait: running.wait_property()

    def invoke(self, context: bpy.types.Context, event: bpy.types.Event) -> set[str]:
        """Ask where to write."""
        self.wait = False
        try:
            self.filepath = str(_free_name(sources.full_path(origin_of(steerable(context)))))
        except ValueError as error:
            return problem.tell(self, str(error))
        return super().invoke(context, event)

    def work(self, context: bpy.types.Context) -> running.Work:
        """Let the engine choose and write.

        Raises:
            ValueError: the mesh was edited or its regions are not known, or what is asked for makes no sense.
        """
        mesh = steerable(context)
        if not len(mesh.sacha.regions):
            raise ValueError(
                "Its regions are not known: name its head's masks and open it again, or make regions of your own"
            )
        list_regions(mesh)
        asked = mesh.sacha_steering
        _take_over(asked, self.weights, self.target_kb)
        origin, before = sources.full_path(origin_of(mesh)), sources.full_path(mesh.sacha.source)
        target = sources.full_path(self.filepath) if self.filepath else _free_name(origin)
        given = [origin, "-o", target, "--make-scores", *sources.head_options(context), *budget_options(context, mesh)]
        given += [] if before == origin else ["--before", before]
        python, steered, painting = (
            preferences.engine_python(context),
            remember(mesh),
            painted(avatar_of(context.object)),
        )

        def command(folder: Path) -> list[str]:
            more = _carried(folder, mesh, painting)
            out = ("--scene", folder / "scene", "--json", folder / "report.json")
            return engine.command(python, "prune", *given, *more, *out)

        def finish(job: Job) -> str:
            shown = steered.require(f"nothing shows {target.name}, which is written to {target.parent}")
            return _show(shown, job, origin, before, target)

        return running.Work(f"Applying the budget to {origin.name}", command, finish)

    execute = running.execute
    modal = running.modal
    cancel = running.cancel


def _take_over(asked: bpy.types.PropertyGroup, weights: str, target_kb: float) -> None:
    """Set what the operator was given besides the mesh's budget.

    Raises:
        ValueError: a weight is not REGION=FACTOR, or there is no such region.
    """
    for text in weights.replace(",", " ").split():
        name, _, factor = text.partition("=")
        if name not in asked.regions:
            raise ValueError(f"No region {name!r}; there are {', '.join(asked.regions.keys())}")
        try:
            asked.regions[name].weight = float(factor)
        except ValueError:
            raise ValueError(f"A weight {text!r}, expected such as mouth=2") from None
    if target_kb > 0:
        asked.limit, asked.target_kb = "SIZE", target_kb


def _carried(folder: Path, mesh: bpy.types.Mesh, painting: np.ndarray | None) -> list[str | Path]:
    """Put what the engine needs of the mesh into the job's folder, and give the options that name it."""
    given: list[str | Path] = []
    if painting is not None:
        np.save(folder / "importance.npy", painting)
        given += ["--importance", folder / "importance.npy"]
        given += ["--importance-strength", f"{mesh.sacha_steering.paint_strength:.6g}"]
    if mesh.sacha_steering.custom:
        given += ["--scheme", write_division(folder / "own.scheme.npz", shown_division(mesh))]
    return given


def _show(mesh: bpy.types.Mesh, job: Job, origin: Path, before: Path, target: Path) -> str:
    """Show on the mesh what the engine wrote; say what it is.

    Raises:
        ValueError: the mesh was edited meanwhile.
    """
    told = job.report()
    numbers.take(mesh, read_scene_folder(job.folder / "scene"), target, before)
    list_regions(mesh)
    asked = mesh.sacha_steering
    asked.origin, asked.result = str(origin), str(target)
    asked.bytes_before, asked.bytes_after = told["n_bytes_before"] or 0, told["n_bytes"]
    asked.outcome.clear()
    for region in told["regions"]:
        _add_outcome(asked.outcome.add(), region)
    return f"Kept {told['n_gaussians']:,} of {told['n_before']:,} Gaussians in {target.name}: {told['n_bytes']:,} bytes"


def _add_outcome(row: bpy.types.PropertyGroup, region: dict[str, Any]) -> None:
    """Keep what one region had and has."""
    row.name, row.before, row.after = region["region"], region["shown_before"], region["after"]
    row.known_before, row.known_after = (region[key] is not None for key in ("psnr_before_db", "psnr_db"))
    row.psnr_before_db, row.psnr_after_db = region["psnr_before_db"] or 0.0, region["psnr_db"] or 0.0


def _free_name(origin: Path) -> Path:
    """Give a name beside the avatar that no file has yet: what was applied before stays, so that undo shows what there is."""
    stem, number = f"{origin.stem}_steered", 1
    while (path := origin.with_name(f"{stem}{'' if number == 1 else f'_{number}'}.sacha")).exists():
        number += 1
    return path


CLASSES = (SachaApplyBudget,)
