"""`sacha batch`: what `sacha encode` and `sacha decode` do, for every avatar of a folder."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Annotated, Any, Literal

import tyro

from sacha_core.cli.common import Common, FileOption, HeadSource, MaybeText
from sacha_core.cli.console import Console, kilobytes, table
from sacha_core.cli.program import one_line
from sacha_core.errors import OptionError, SachaError
from sacha_core.progress import Progress

__all__ = ["INPUTS", "OUTPUT_FOLDERS", "Options", "run"]

INPUTS = ("folder", "motion")
OUTPUT_FOLDERS = ("output",)
SUFFIXES = {"encode": (".ply", ".sacha"), "decode": (".sacha",)}
MADE = {"encode": ".sacha", "decode": ".ply"}


@dataclass(frozen=True)
class Options:
    """Encode or decode every avatar of a folder. One that cannot be is told of at the end, and the others are done all the same.

    sacha batch encode out/models -o out/files --target-size 200KB

    sacha batch decode out/files -o out/plys
    """

    what: Annotated[Literal["encode", "decode"], tyro.conf.Positional]
    """`encode` makes NAME.sacha of models, PLYs and .sacha files; `decode` makes NAME.ply, and NAME.npz of a motion, of the latter."""

    folder: Annotated[Path, tyro.conf.Positional, tyro.conf.arg(metavar="FOLDER")]
    """Where the avatars are; folders in it that are no models are not searched."""

    output: Annotated[Path, tyro.conf.arg(aliases=["-o"], metavar="FOLDER")]
    """Where the files go."""

    level: Literal[1, 2, 3, 4, "archive"] = 2
    """1 is the smallest, 4 the best; `archive` keeps every bit of every number."""

    target_size: Annotated[MaybeText, tyro.conf.arg(metavar="SIZE", help_behavior_hint="(instead of --level)")] = None
    """The best file of at most this size, for each: 300KB, 0.3MB."""

    profile: Literal["sacha", "paper"] = "sacha"
    """`paper` codes as the SACHA paper does."""

    motion: FileOption = None
    """A motion (.npz) to put into every file, instead of each avatar's own."""

    no_rendering: bool = False
    """Go by rules alone: quicker, and larger files."""

    tune: bool = False
    """Leave out what other Gaussians make up for, each avatar fitted to its own pictures."""

    embed_head: bool = False
    """Put the head into each file too."""

    keep: bool = False
    """Leave out what is done already: files that are newer than what they are made of."""

    head: HeadSource = field(default_factory=HeadSource)
    common: Common = field(default_factory=Common)


class Aside(Console):
    """Keeps what one of many commands would say to itself."""

    def __init__(self) -> None:
        super().__init__("none")
        self._speaks = False


def run(options: Options, console: Console) -> dict[str, Any]:
    """Do what was asked for with each avatar.

    Raises:
        OptionError: there is none, or two would be written to one file.
        OSError: the folder cannot be read or written.
    """
    jobs = planned(options)
    one = encoded if options.what == "encode" else decoded
    files = []
    for done, (source, target) in enumerate(jobs):
        console.report(Progress(options.what, done, len(jobs)))
        files.append(attempted(one, options, source, target))
    console.report(Progress(options.what, len(jobs), len(jobs)))
    rows = [
        (file["source"].name, kilobytes(file["bytes"]) if file["bytes"] is not None else "", file["note"])
        for file in files
    ]
    console.say(table(("avatar", "size", "note"), rows, words=(0, 2)))
    console.wrote("files", options.output, f"{sum(file['bytes'] is not None for file in files)} of {len(files)}")
    broken = [file["source"].name for file in files if file["bytes"] is None]
    return {"what": options.what, "files": files, "broken": broken}


def planned(options: Options) -> list[tuple[Path, Path]]:
    """Give each avatar of the folder with the file that is to be made of it, by name.

    Raises:
        OptionError: there is none, two would be written to one file, or one to itself.
    """
    suffixes = SUFFIXES[options.what]
    found = sorted(
        path
        for path in options.folder.iterdir()
        if (path.is_file() and path.suffix.lower() in suffixes) or (options.what == "encode" and is_model(path))
    )
    if not found:
        raise OptionError(
            f"{options.folder} holds nothing to {options.what}; expected "
            + ("model folders, .ply or .sacha files" if options.what == "encode" else ".sacha files")
        )
    plan: dict[Path, Path] = {}
    for source in found:
        name = source.name if source.is_dir() else source.stem
        target = options.output / f"{name}{MADE[options.what]}"
        if target.resolve() == source.resolve():
            raise OptionError(f"{source} would be written over itself; expected another folder for --output")
        if target in plan:
            raise OptionError(f"{plan[target].name} and {source.name} would both be written to {target}; rename one")
        plan[target] = source
    return [(source, target) for target, source in plan.items()]


def is_model(path: Path) -> bool:
    """Tell whether a path is the folder of a trained model."""
    from sacha_core.interchange.gaussian_avatars import model_iterations

    return path.is_dir() and bool(model_iterations(path))


def attempted(
    one: Callable[[Options, Path, Path], Sequence[Path]], options: Options, source: Path, target: Path
) -> dict[str, Any]:
    """Make one file; what goes wrong with it is said in its `note`, and its `bytes` are then None."""
    from sacha_core.files import require_writable

    told = {"source": source, "file": target, "bytes": None, "note": ""}
    try:
        if options.keep and target.is_file() and target.stat().st_mtime > newest(source):
            return {**told, "bytes": target.stat().st_size, "note": "done already"}
        require_writable(target)
        made = one(options, source, target)
    except (SachaError, OSError) as error:
        return {**told, "note": one_line(error)}
    return {**told, "bytes": target.stat().st_size, "note": ", ".join(path.name for path in made if path != target)}


def newest(source: Path) -> float:
    """Give when an avatar was changed last, seconds since 1970."""
    files = [path for path in source.rglob("*") if path.is_file()] if source.is_dir() else [source]
    return max(path.stat().st_mtime for path in files)


def encoded(options: Options, source: Path, target: Path) -> Sequence[Path]:
    """Encode one avatar."""
    from sacha_core.cli import encode

    is_ply = source.suffix.lower() == ".ply" and source.is_file()
    encode.run(
        encode.Options(
            output=target,
            model=None if is_ply else source,
            ply=source if is_ply else None,
            motion=options.motion,
            level=options.level,
            target_size=options.target_size,
            profile=options.profile,
            no_rendering=options.no_rendering,
            tune=options.tune,
            embed_head=options.embed_head,
            head=options.head,
        ),
        Aside(),
    )
    return [target]


def decoded(options: Options, source: Path, target: Path) -> Sequence[Path]:
    """Decode one file, with its motion where it has one."""
    from sacha_core.cli import decode
    from sacha_core.codec import inspect

    motion = target.with_suffix(".npz") if inspect(source).n_frames else None
    decode.run(decode.Options(file=source, ply=target, motion=motion, head=options.head), Aside())
    return [target] if motion is None else [target, motion]
