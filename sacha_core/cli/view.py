"""`sacha view`: an avatar in the browser."""

from __future__ import annotations

import threading
import webbrowser
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import tyro

from sacha_core.cli.common import Common, FileOption, HeadSource
from sacha_core.cli.console import Console
from sacha_core.errors import HeadError, OptionError

if TYPE_CHECKING:
    import numpy as np

    from sacha_core.cli.sources import Opened
    from sacha_core.viewer.page import Page

__all__ = ["INPUTS", "Options", "open_page", "run"]

INPUTS = ("avatar", "motion")


@dataclass(frozen=True)
class Options:
    """Show an avatar in the browser: it plays, turns, makes faces by sliders, and shows its regions and levels.

    Nothing is fetched from elsewhere, and only this machine is let in unless --host says otherwise. Ctrl-C ends it.
    """

    avatar: Annotated[Path, tyro.conf.Positional, tyro.conf.arg(metavar="AVATAR")]
    """A .sacha file, a model folder, or a PLY of bound Gaussians (with --head)."""

    motion: FileOption = None
    """Motion (.npz) to play instead of the avatar's own."""

    host: Annotated[str, tyro.conf.arg(metavar="ADDRESS")] = "127.0.0.1"
    """Where to listen; 0.0.0.0 lets other machines look too."""

    port: Annotated[int, tyro.conf.arg(metavar="PORT")] = 8080
    """Where to listen; where it is taken, the next free one."""

    no_browser: bool = False
    """Do not open the browser; only say where the page is."""

    seconds: Annotated[float, tyro.conf.arg(metavar="SECONDS", help_behavior_hint="(default: until Ctrl-C)")] = 0.0
    """End by itself after so long."""

    head: HeadSource = field(default_factory=HeadSource)
    common: Common = field(default_factory=Common)


def run(options: Options, console: Console) -> dict[str, Any]:
    """Show it until it is ended.

    Raises:
        SachaError: the avatar or its head make no sense, or nobody may listen there.
        OSError: a file cannot be read.
    """
    from sacha_core.cli.sources import open_avatar

    if not 1 <= options.port < 1 << 16:
        raise OptionError(f"--port is {options.port}, expected 1 to 65535")
    if not 0 <= options.seconds < float("inf"):
        raise OptionError(f"--seconds is {options.seconds:g}, expected 0 or more")
    opened = open_avatar(options.avatar, options.head, options.motion)
    page = open_page(options.avatar.name, opened, options.host, options.port)
    address = f"http://{'localhost' if options.host in {'127.0.0.1', '0.0.0.0'} else options.host}:{page.port}"
    console.say(f"page         {address}  (Ctrl-C ends it)")
    page.set(playing=opened.avatar.motion is not None and len(opened.avatar.motion) > 1)
    if not options.no_browser:
        webbrowser.open(address)
    if options.seconds:
        timer = threading.Timer(options.seconds, page.close)
        timer.daemon = True
        timer.start()
    try:
        page.run()
    except KeyboardInterrupt:
        page.close()
    return {"avatar": options.avatar, "address": address, "n_gaussians": len(opened.avatar.gaussians)}


def open_page(title: str, opened: Opened, host: str, port: int) -> Page:
    """Make the page of an avatar.

    Raises:
        SachaError: the head cannot move so, or nobody may listen there.
    """
    from sacha_core.viewer.grades import Grades
    from sacha_core.viewer.page import Page
    from sacha_core.viewer.puppet import Puppet

    puppet = Puppet(opened.head, opened.avatar.motion)
    return Page(title, puppet, Grades(opened.avatar, opened.head), colours_if_known(opened), host, port)


def colours_if_known(opened: Opened) -> np.ndarray | None:
    """Give the colour of each triangle's region; None where regions are not known."""
    from sacha_core.cli.stage import region_colours

    try:
        return region_colours(opened.head, opened.avatar.scheme)
    except HeadError:  # a head without masks has no regions to colour: the page then offers none
        return None
