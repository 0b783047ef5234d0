# SPDX-License-Identifier: GPL-3.0-or-later
"""The button that takes a problem off the sidebar."""

from __future__ import annotations

import bpy

from .. import problem

__all__ = ["CLASSES", "detach"]


class SachaDismiss(bpy.types.Operator):
    """Take the last problem off the sidebar."""

    bl_idname = "sacha.dismiss"
    bl_label = "Dismiss"
    bl_description = "Take this off the sidebar"

    @classmethod
    def poll(cls, context: bpy.types.Context) -> bool:  # noqa: ARG003  (Blender's signature)
        """There must be a problem."""
        return problem.last() is not None

    def execute(self, context: bpy.types.Context) -> set[str]:  # noqa: ARG002  (Blender's signature)
        """Forget it."""
        problem.forget()
        return {"FINISHED"}


CLASSES = (SachaDismiss,)


def detach() -> None:
    """Leave nothing behind when the add-on is disabled."""
    problem.forget()
