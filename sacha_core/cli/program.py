"""From the arguments of `sacha` to an exit status."""

from __future__ import annotations

import difflib
import errno
import importlib
import io
import os
import shutil
import signal
import sys
import textwrap
import time
from collections.abc import Iterable, Iterator, Sequence
from contextlib import contextmanager, redirect_stderr
from itertools import takewhile
from operator import attrgetter
from pathlib import Path
from types import ModuleType
from typing import Any

from sacha_core import __version__
from sacha_core.cli import protocol
from sacha_core.cli.commands import COMMANDS
from sacha_core.errors import OptionError, SachaError

__all__ = ["EXIT_BAD_INPUT", "EXIT_INTERRUPTED", "boxed", "main", "one_line"]

EXIT_BROKEN = 1
EXIT_BAD_INPUT = 2
EXIT_INTERRUPTED = 130  # 128 + SIGINT, as shells have it

BOX = " ─│╭╮╰╯"  # what tyro's boxes are drawn with
DESCRIPTION = """Semantic-aware compression of animatable 3D Gaussian head avatars.

From captured frames to a small .sacha file and back: synth or capture, train, encode, decode, render, evaluate.
`sacha COMMAND --help` explains each command."""

EXTRAS = {
    "torch": "bench",
    "gsplat": "cuda",
    "bpy": "blender",
    "tyro": "shell",
    "rich": "shell",
    "av": "shell",
    "matplotlib": "shell",
    "ray": "ray",
    "viser": "view",
}


def main(argv: Sequence[str] | None = None) -> int:
    """Run one command.

    Args:
        argv: the arguments after the program's name; those of this process where None.

    Returns:
        The exit status: 0 done, 1 done but something that must hold does not (its report's "broken" names it), 2 bad input (one line on
        stderr says what), 130 interrupted. A bug raises.
    """
    arguments = list(sys.argv[1:] if argv is None else argv)
    if argv is None:
        signal.signal(signal.SIGTERM, _terminate)
    name = arguments[0] if arguments and arguments[0] in COMMANDS else None
    watched = protocol.wanted(arguments)
    try:
        if watched:
            protocol.say_hello()
        if name is None:
            return _front_page(arguments)
        return _run(name, arguments[1:])
    except SystemExit as stop:  # how tyro ends after --help (0) or on a wrong argument (2)
        return stop.code if isinstance(stop.code, int) else EXIT_BAD_INPUT
    except (
        BrokenPipeError
    ):  # whoever read our output has gone (`sacha inspect a.sacha | head`), so nobody is left to tell
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
        return EXIT_BAD_INPUT
    except (SachaError, OSError, ModuleNotFoundError, KeyboardInterrupt) as error:
        line = one_line(error)
        if line is None:
            raise
        if watched:
            protocol.say_error(error, line)
        sys.stderr.write(f"sacha {name or ''}".rstrip() + f": {line}\n")
        return EXIT_INTERRUPTED if isinstance(error, KeyboardInterrupt) else EXIT_BAD_INPUT


def one_line(error: BaseException) -> str | None:
    """Say on one line what went wrong, a system error as `FILE: what happened`; None where it is not the user's to put right."""
    text = str(error)
    if isinstance(error, KeyboardInterrupt):
        return "interrupted"
    if isinstance(error, ModuleNotFoundError):
        extra = EXTRAS.get(error.name or "")
        return extra and f"needs the package {error.name}: pip install 'sacha[{extra}]'"
    if isinstance(error, OSError) and error.strerror:
        text = error.strerror[:1].lower() + error.strerror[1:]
        if error.filename is not None:
            text = f"{os.fspath(error.filename)}: {text}"
    return " ".join(text.split())


def _run(name: str, arguments: list[str]) -> int:
    """Read the options of one command, run it, write its report."""
    import tyro

    module = _load(name)
    for flag, of in getattr(module, "LISTS", {}).items():
        if flag in arguments:
            sys.stdout.write(getattr(module, of)() + "\n")
            return 0
    with _wrong_usage_on_one_line(f"sacha {name}"):
        options = tyro.cli(
            module.Options,
            prog=f"sacha {name}",
            args=arguments,
            config=(tyro.conf.OmitArgPrefixes, tyro.conf.FlagCreatePairsOff),
        )
    require_there(getattr(options, field) for field in getattr(module, "INPUTS", ()))
    require_writable_outputs(
        options, ("common.json", *getattr(module, "OUTPUTS", ())), getattr(module, "OUTPUT_FOLDERS", ())
    )
    from sacha_core.cli.console import Console, write_report

    start = time.perf_counter()
    with Console(options.common.progress) as console:
        found: dict[str, Any] = module.run(options, console)
        if options.common.json is not None:
            seconds = round(time.perf_counter() - start, 3)
            write_report(options.common.json, {"command": name, "seconds": seconds, **found})
            console.say(f"report       {options.common.json}")
    sys.stdout.flush()
    return EXIT_BROKEN if found.get("broken") else 0


@contextmanager
def _wrong_usage_on_one_line(program: str) -> Iterator[None]:
    """Turn the box that tyro prints and ends with where the arguments make no sense into an error of one line.

    Raises:
        OptionError: what the box said between its title and its next rule, which explanations follow.
    """
    told = io.StringIO()
    try:
        with redirect_stderr(told):
            yield
    except SystemExit as stop:
        if stop.code in {0, None}:
            raise
        raise OptionError(f"{boxed(told.getvalue())}; see {program} --help") from stop


def boxed(text: str) -> str:
    """Give on one line what a box of tyro's says below its title, without the explanations below its next rule.

    Args:
        text: the box; on terminals that know no line-drawing characters its title is a line of its own with a rule below.
    """
    lines = text.splitlines()
    after_title = lines[1:] if text.startswith("╭") else lines[2:]
    said = takewhile(lambda line: line.strip(BOX + "-"), after_title)
    what = " ".join(" ".join(line.strip(BOX) for line in said).split()).rstrip(".")
    return what.removeprefix("Error parsing ") or "the arguments make no sense"


def _front_page(arguments: list[str]) -> int:
    """Show the list of commands or the version, or say that there is no such command.

    Raises:
        OptionError: something else was asked for.
    """
    if not arguments or arguments[0] in {"-h", "--help"}:
        sys.stdout.write(listed_commands(shutil.get_terminal_size().columns))
    elif arguments == ["--version"]:
        sys.stdout.write(f"sacha {__version__}\n")
    else:
        meant = difflib.get_close_matches(arguments[0], COMMANDS, 1)
        guess = f"; did you mean {meant[0]}?" if meant else ""
        first = arguments[0]
        wrong = f"expected a command before {first}" if first.startswith("-") else f"there is no command {first}"
        raise OptionError(f"{wrong}{guess}; see sacha --help")
    sys.stdout.flush()
    return 0


def listed_commands(columns: int) -> str:
    """Give the front page, set to the width of a terminal."""
    shown = {name: command.summary for name, command in COMMANDS.items() if command.summary}
    indent = max(map(len, shown)) + 4
    lines = [
        textwrap.fill(
            summary,
            max(columns - 1, 2 * indent),
            initial_indent=f"  {name:{indent - 2}}",
            subsequent_indent=" " * indent,
            break_on_hyphens=False,
        )
        for name, summary in shown.items()
    ]
    return "\n".join(["usage: sacha COMMAND ...", "", DESCRIPTION, "", *lines, ""])


def require_there(inputs: Iterable[Path | None]) -> None:
    """Refuse the name of a file or folder that is not there, before anything heavy is loaded to read it.

    Raises:
        FileNotFoundError: naming the first.
    """
    for path in inputs:
        if path is not None and not path.exists():
            raise FileNotFoundError(errno.ENOENT, os.strerror(errno.ENOENT), os.fspath(path))


def require_writable_outputs(options: Any, files: Iterable[str], folders: Iterable[str]) -> None:
    """Refuse outputs that could not be written, before the work that goes into them; what is not asked for is None.

    Raises:
        OSError: naming the first.
    """
    from sacha_core.files import require_writable, require_writable_folder

    for require, fields in ((require_writable, files), (require_writable_folder, folders)):
        for path in (attrgetter(field)(options) for field in fields):
            if path is not None:
                require(path)


def _load(name: str) -> ModuleType:
    return importlib.import_module(f"sacha_core.cli.{COMMANDS[name].module}")


def _terminate(*_: object) -> None:
    """On SIGTERM unwind as on Ctrl-C, so that half-written files are removed."""
    raise KeyboardInterrupt
