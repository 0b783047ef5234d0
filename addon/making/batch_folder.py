# SPDX-License-Identifier: GPL-3.0-or-later
"""Encoding and decoding every avatar of a folder."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import bpy
from bpy.props import BoolProperty, StringProperty

from .. import engine, preferences, running, sources
from ..job import Job
from ..told import REPORT
from .encode_options import encode_options, encode_properties

__all__ = ["CLASSES"]

MOST_NAMED = 3  # of the avatars that failed
LONGEST_S = 7 * 86_400.0  # a folder may hold many; Cancel ends it


class SachaEncodeFolder(bpy.types.Operator):
    """Encode every avatar of a folder: model folders, splat PLYs, .sacha files."""

    bl_idname = "sacha.encode_folder"
    bl_label = "Encode Folder"
    bl_description = (
        "Encode every avatar of a folder (model folders, splat PLYs, .sacha files), with the scene's settings"
    )

    directory: StringProperty(
        name="Folder", description="Where the avatars are", subtype="DIR_PATH", options={"SKIP_SAVE"}
    )
    filter_folder: BoolProperty(default=True, options={"HIDDEN"})
    output: StringProperty(
        name="Output",
        description="Where the files go; a folder `encoded` in it where empty",
        subtype="DIR_PATH",
        options={"SKIP_SAVE"},
    )
    keep: BoolProperty(
        name="Keep Finished", description="Leave out what is done already", default=False, options={"SKIP_SAVE"}
    )
    wait: running.wait_property()
    __annotations__.update(encode_properties())

    def invoke(self, context: bpy.types.Context, event: bpy.types.Event) -> set[str]:  # noqa: ARG002  (Blender's signature)
        """Ask for the folder."""
        self.wait = False
        context.window_manager.fileselect_add(self)
        return {"RUNNING_MODAL"}

    def work(self, context: bpy.types.Context) -> running.Work:
        """Let the engine encode them."""
        folder = named_folder(self.directory)
        given = [*encode_options(self, context), *(["--keep"] if self.keep else [])]
        return batch_work(context, "encode", folder, self.output, given)

    execute = running.execute
    modal = running.modal
    cancel = running.cancel


class SachaDecodeFolder(bpy.types.Operator):
    """Decode every .sacha file of a folder."""

    bl_idname = "sacha.decode_folder"
    bl_label = "Decode Folder"
    bl_description = "Decode every .sacha file of a folder to a splat PLY, and its motion to .npz"

    directory: StringProperty(
        name="Folder", description="Where the files are", subtype="DIR_PATH", options={"SKIP_SAVE"}
    )
    filter_folder: BoolProperty(default=True, options={"HIDDEN"})
    output: StringProperty(
        name="Output",
        description="Where the PLYs go; a folder `decoded` in it where empty",
        subtype="DIR_PATH",
        options={"SKIP_SAVE"},
    )
    wait: running.wait_property()

    def invoke(self, context: bpy.types.Context, event: bpy.types.Event) -> set[str]:  # noqa: ARG002  (Blender's signature)
        """Ask for the folder."""
        self.wait = False
        context.window_manager.fileselect_add(self)
        return {"RUNNING_MODAL"}

    def work(self, context: bpy.types.Context) -> running.Work:
        """Let the engine decode them."""
        return batch_work(context, "decode", named_folder(self.directory), self.output, sources.head_options(context))

    execute = running.execute
    modal = running.modal
    cancel = running.cancel


def named_folder(directory: str) -> Path:
    """Give the folder that was named.

    Raises:
        ValueError: none was.
    """
    if not directory:
        raise ValueError("No folder: name the one that holds the avatars")
    return sources.full_path(directory)


def batch_work(context: bpy.types.Context, what: str, folder: Path, output: str, given: Sequence[str]) -> running.Work:
    """Give the work of a whole folder; where some could not be done, those are named, and the others are there."""
    target = sources.full_path(output) if output else folder / f"{what}d"
    python = preferences.engine_python(context)

    def command(place: Path) -> list[str]:
        return engine.command(python, "batch", what, folder, "-o", target, *given, "--json", place / REPORT)

    def finish(job: Job) -> str:
        return f"{what.capitalize()}d {len(job.report()['files'])} avatars to {target}"

    def failed(job: Job) -> str:
        if not (job.folder / REPORT).is_file():  # it did not even begin
            raise ValueError(job.complaint())
        told = job.report()
        broken = [file for file in told["files"] if file["bytes"] is None]
        named = "; ".join(f"{Path(file['source']).name}: {file['note']}" for file in broken[:MOST_NAMED])
        more = f"; and {len(broken) - MOST_NAMED} more" if len(broken) > MOST_NAMED else ""
        done = len(told["files"]) - len(broken)
        raise ValueError(
            f"{what.capitalize()}d {done} of {len(told['files'])} avatars to {target}, but not {named}{more}"
        )

    return running.Work(f"{what.capitalize()[:-1]}ing {folder.name}", command, finish, LONGEST_S, failed)


CLASSES = (SachaEncodeFolder, SachaDecodeFolder)
