# SPDX-License-Identifier: GPL-3.0-or-later
"""How operators run the engine: in a window beside the user's work, with progress and cancel; in scripts until it is done.

An operator that runs the engine has a method `work(context)` that gives its `Work`, a property `wait`, and
`execute = running.execute`, `modal = running.modal`, `cancel = running.cancel`; where it asks for no file, `invoke = running.invoke` too.
"""

from __future__ import annotations

import traceback
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

import bpy
from bpy.props import BoolProperty

from . import preferences, problem
from .engine import EngineMissingError
from .job import Job, Outcome, start_job
from .leftovers import sweep

__all__ = ["CLASSES", "Work", "attach", "cancel", "end_now", "execute", "invoke", "modal", "now", "wait_property"]

TICK_S = 0.25  # how often a window looks at a running job
NONSENSE = "The engine answered with what the add-on does not understand"


@dataclass(frozen=True)
class Work:
    """One command of the engine and what follows it.

    Args:
        title: what the user is told is being done.
        command: gives program and arguments, given the job's folder.
        finish: takes over the results; gives the line that tells the user what was done. A ValueError is the user's to read.
        time_limit_s: how long it may take; None for what the preferences say.
        failed: what to do instead of telling the user that it failed; gives the line that tells what was done.
    """

    title: str
    command: Callable[[Path], list[str]]
    finish: Callable[[Job], str]
    time_limit_s: float | None = None
    failed: Callable[[Job], str] | None = None


@dataclass(frozen=True)
class Running:
    """A job that a window is watching."""

    work: Work
    job: Job
    timer: bpy.types.Timer


_running: list[Running] = []  # one at most: a second command would wait for the same cores


def now() -> Running | None:
    """Give the job that a window is watching, if there is one."""
    return _running[0] if _running else None


def wait_property() -> BoolProperty:
    """Make the property by which scripts say whether to wait; windows do not."""
    return BoolProperty(
        name="Wait", description="Return only when it is done", default=True, options={"HIDDEN", "SKIP_SAVE"}
    )


def events_come() -> bool:
    """Tell whether Blender handles events: in background no timer ever fires."""
    return not bpy.app.background


def invoke(
    operator: bpy.types.Operator,
    context: bpy.types.Context,
    event: bpy.types.Event,  # noqa: ARG001  (Blender's signature)
) -> set[str]:
    """From a button: do not make the window wait."""
    operator.wait = False
    return operator.execute(context)


def execute(operator: bpy.types.Operator, context: bpy.types.Context) -> set[str]:
    """Start an operator's work; see it through, or leave it to `modal`."""
    if _running:
        return problem.tell(operator, f"Still busy: {_running[0].work.title}")
    try:
        work = operator.work(context)
        limit_s = preferences.time_limit_s(context) if work.time_limit_s is None else work.time_limit_s
        job = start_job(work.command, limit_s)
    except (EngineMissingError, OSError, ValueError) as error:
        return problem.tell(operator, str(error), _kind(error, "NoEngine"))
    if operator.wait or not events_come():
        job.wait()
        return _conclude(operator, work, job)
    timer = context.window_manager.event_timer_add(TICK_S, window=context.window)
    _running.append(Running(work, job, timer))
    context.window_manager.modal_handler_add(operator)
    return {"RUNNING_MODAL"}


def modal(operator: bpy.types.Operator, context: bpy.types.Context, event: bpy.types.Event) -> set[str]:
    """Look at the job at each tick; every other event goes to whom it is meant for."""
    if event.type != "TIMER":
        return {"PASS_THROUGH"}
    _redraw(context)
    if not _running:  # ended from elsewhere, and this is the timer of another
        return {"CANCELLED"}
    running = _running[0]
    if running.job.poll() is Outcome.RUNNING:
        return {"PASS_THROUGH"}
    _forget(context)
    return _conclude(operator, running.work, running.job)


def cancel(operator: bpy.types.Operator, context: bpy.types.Context) -> None:  # noqa: ARG001  (Blender's signature)
    """End the job of an operator whose window closes."""
    end_now()


def end_now() -> None:
    """End what is running and its timer: a timer that outlives Blender's window can keep the process alive for ever."""
    if _running:
        job = _running[0].job
        _forget(bpy.context)
        job.end_now()
        job.remove()


def _forget(context: bpy.types.Context) -> None:
    context.window_manager.event_timer_remove(_running.pop().timer)


def _conclude(operator: bpy.types.Operator, work: Work, job: Job) -> set[str]:
    """Take over what the engine left, or say why it left nothing."""
    try:
        if job.poll() is Outcome.CANCELLED:
            operator.report({"WARNING"}, job.complaint())
            return {"CANCELLED"}
        if job.poll() is Outcome.FINISHED:
            operator.report({"INFO"}, work.finish(job))
            if work.failed is None:  # what failed before is solved, unless this only asked
                problem.forget()
        elif work.failed is not None:
            operator.report({"INFO"}, work.failed(job))
        else:
            return problem.tell(operator, job.complaint(), job.kind, title=work.title, log=job.quoted())
    except (EngineMissingError, ValueError) as error:
        return problem.tell(operator, str(error), _kind(error), title=work.title, log=job.quoted())
    except (OSError, LookupError, TypeError) as error:  # the worker left something, but not what it should
        log = f"{job.quoted()}\n{traceback.format_exc()}"
        message = f"{NONSENSE} ({type(error).__name__}: {error})"
        return problem.tell(operator, message, "Unreadable", title=work.title, log=log)
    finally:
        job.remove()
    return {"FINISHED"}


def _kind(error: Exception, of_the_system: str = "") -> str:
    """Give the kind of an error: its own, the one given for errors of the operating system, or none where its words say what to do."""
    return of_the_system if isinstance(error, OSError) else getattr(error, "kind", "")


def _redraw(context: bpy.types.Context) -> None:
    """Draw the sidebars anew, where progress is shown."""
    for window in context.window_manager.windows:
        for area in window.screen.areas:
            if area.type == "VIEW_3D":
                area.tag_redraw()


class SachaCancel(bpy.types.Operator):
    """Stop the job that a window is watching."""

    bl_idname = "sacha.cancel"
    bl_label = "Cancel"
    bl_description = "Stop what the engine is doing; nothing is written"

    @classmethod
    def poll(cls, context: bpy.types.Context) -> bool:  # noqa: ARG003  (Blender's signature)
        """There must be something to stop."""
        return bool(_running)

    def execute(self, context: bpy.types.Context) -> set[str]:  # noqa: ARG002  (Blender's signature)
        """Ask the worker to end; the window that watches it sees it go."""
        _running[0].job.ask_to_stop()
        return {"FINISHED"}


CLASSES = (SachaCancel,)


def attach() -> None:
    """Clear away what Blenders left that crashed."""
    sweep()
