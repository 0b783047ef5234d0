"""`sacha bench`: what each part costs, and how far from exact it is."""

from __future__ import annotations

import sys
import time
from collections.abc import Iterable
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import tyro

from sacha_core.cli.common import Common, FileOption, HeadSource, MaybeInt, MaybePath, MaybeText
from sacha_core.cli.console import Console, table
from sacha_core.errors import OptionError

if TYPE_CHECKING:
    from sacha_core.bench.preset import Comparison, Preset
    from sacha_core.bench.result import Bench
    from sacha_core.bench.store import Record

__all__ = ["OUTPUTS", "Options", "run"]

OUTPUTS = ("plot", "sheet")

FOLDER = Path("out/bench")
PAGE = Path("docs/performance.md")


@dataclass(frozen=True)
class Options:
    """Measure time and error of one part, or of all, on this machine.

    sacha bench raster --plot raster.png

    sacha bench all --quick --out out/bench      every bench into a folder: JSON, tables, pictures, index.md

    sacha bench compare out/bench out/again      do two runs agree, within the noise that --repeat measures?

    sacha bench page out/bench                   put the results into the performance page

    sacha bench codec a.sacha --quick --plot rd.png --sheet look.png      every codec on an avatar, in some ten minutes

    sacha bench codec a.ply b.sacha --head rig.npz --motion m.npz --json rd.json      by 192 pictures each: half an hour an avatar

    sacha bench codec scene.ply --codecs spz,sog,hevc      splats that no head carries; with --head, ours too

    Benches: raster, posing, playback, codec, motion, train, stability, skips, cuda. Candidates are timed turn by turn in one process
    after a warm-up; times are medians.
    """

    what: Annotated[str, tyro.conf.Positional, tyro.conf.arg(metavar="WHAT")]
    """A bench, or `all`, `compare`, `page`."""

    paths: Annotated[tuple[Path, ...], tyro.conf.Positional, tyro.conf.arg(metavar="[PATH ...]")] = ()
    """compare: two folders or JSON files; page: the folder; codec: avatars (.sacha, model folder, .ply) or any splats (.ply)."""

    quick: bool = False
    """Measure less: a minute or so a bench instead of several."""

    repeat: bool = False
    """all: run what takes time once more when all are done, to know how far two runs may differ."""

    threads: Annotated[MaybeInt, tyro.conf.arg(metavar="N", help_behavior_hint="(default: one a processor)")] = None
    """How many threads at most."""

    plot: FileOption = None
    """Also draw the picture (PNG) here; not with `all`."""

    out: Annotated[MaybePath, tyro.conf.arg(aliases=["-o"], metavar="PATH", help_behavior_hint="")] = None
    """all: the folder (out/bench by default); page: the page (docs/performance.md by default)."""

    avatar: FileOption = None
    """codec, playback: measure on this .sacha file or model folder instead of a made avatar."""

    dataset: Annotated[MaybePath, tyro.conf.arg(metavar="DATASET", help_behavior_hint="")] = None
    """train: measure on this capture instead of one filmed for it; codec: its held-out cameras judge sequence and sheet."""

    frames: Annotated[MaybePath, tyro.conf.arg(metavar="FOLDER", help_behavior_hint="")] = None
    """codec: frames of the motion fitted one by one (`sacha framewise`), coded as a sequence beside the avatar with its motion."""

    motion: FileOption = None
    """codec: the motion that avatars without one are posed by; stock expressions by default."""

    codecs: Annotated[MaybeText, tyro.conf.arg(metavar="NAME[,NAME...]", help_behavior_hint="")] = None
    """codec: only these, such as sacha,hevc,draco."""

    require: Annotated[tuple[str, ...], tyro.conf.arg(metavar="NAME"), tyro.conf.UseAppendAction] = ()
    """codec: fail where this codec is missing; may be given more than once."""

    sheet: FileOption = None
    """codec: also draw what each codec makes of an avatar (PNG) here."""

    head: HeadSource = field(default_factory=HeadSource)
    common: Common = field(default_factory=Common)


def run(options: Options, console: Console) -> dict[str, Any]:
    """Measure, compare, or write the page.

    Raises:
        SachaError: there is no such bench, an option does not belong to it, or a file is not a bench's.
        OSError: a file cannot be read or written.
    """
    from sacha_core.bench.registry import BENCHES

    known = (*BENCHES, "all", "compare", "page")
    if options.what not in known:
        raise OptionError(f"there is no bench {options.what!r}; expected one of {', '.join(known)}")
    check(options)
    if options.what == "compare":
        return compare(options, console)
    if options.what == "page":
        return write_page(options, console)
    if options.what == "all":
        return run_all(options, console)
    chosen = preset(options)
    record = run_one(options.what, chosen, console)
    tell(record, console)
    if chosen.compared is not None and chosen.compared.sheet is not None:
        from sacha_core.bench.codec_compare import sheet_paths

        for path in sheet_paths(chosen.compared):
            console.wrote("sheet", path)
    if options.plot is not None:
        from sacha_core.bench.store import write_picture

        write_picture(record, options.plot)
        console.wrote("picture", options.plot)
    return record.to_json()


def check(options: Options) -> None:
    """Refuse options that the chosen work would ignore, and wrong numbers, before anything is measured.

    Raises:
        OptionError: naming the option.
        OSError: the folder that all would go to cannot be written.
    """
    from sacha_core.bench.registry import BENCHES
    from sacha_core.files import require_writable_folder

    measuring = (*BENCHES, "all")
    drawn = tuple(name for name, place in BENCHES.items() if place.drawn)
    takers = {
        "paths": ("compare", "page", "codec"), "quick": measuring, "repeat": ("all",),
        "threads": measuring, "plot": drawn, "out": ("all", "page"),
        "avatar": ("codec", "playback", "all"), "dataset": ("train", "codec", "all"),
        "motion": ("codec",), "codecs": ("codec",), "require": ("codec",), "sheet": ("codec",), "frames": ("codec",),
    }  # fmt: skip
    for name, who in takers.items():
        given = getattr(options, name)
        if given not in {None, False, ()} and options.what not in who:
            shown = str(given[0]) if name == "paths" else f"--{name}"
            raise OptionError(f"bench {options.what} has no use for {shown}")
    if options.threads is not None and options.threads < 1:
        raise OptionError(f"--threads is {options.threads}, expected 1 or more")
    for name in ("motion", "codecs", "require", "sheet", "frames"):
        if getattr(options, name) and not options.paths:
            raise OptionError(f"--{name} belongs to a comparison: name avatars after `bench codec`")
    wanted = {"compare": 2, "page": 1}.get(options.what, 0)
    if options.what != "codec" and len(options.paths) != wanted:
        raise OptionError(f"bench {options.what} takes {wanted} folder{'s' * (wanted > 1)}, not {len(options.paths)}")
    if options.what == "all":
        require_writable_folder(options.out or FOLDER)


def preset(options: Options) -> Preset:
    """Give how much is measured, on what.

    Raises:
        SachaError: the avatar or the capture is broken.
        OSError: a file cannot be read.
    """
    from sacha_core.bench.preset import Preset, Subject
    from sacha_core.cli.sources import capture_head, open_avatar
    from sacha_core.interchange.capture import read_capture

    subject = None
    if options.avatar is not None:
        opened = open_avatar(options.avatar, options.head)
        subject = Subject(opened.avatar, opened.head, options.avatar)
    if options.what == "codec" and options.paths:
        return Preset("quick" if options.quick else "full", options.threads, compared=comparison_of(options))
    film = None
    if options.dataset is not None:
        capture = read_capture(options.dataset)
        film = (capture, capture_head(capture, options.head))
    return Preset("quick" if options.quick else "full", options.threads, subject, film)


def comparison_of(options: Options) -> Comparison:
    """Open what codecs are compared on.

    Raises:
        SachaError: one is broken, its head is not to be found, or an option does not suit it.
        OSError: a file cannot be read.
    """
    from sacha_core.bench.preset import Comparison
    from sacha_core.cli.codec_subjects import Sources, subjects_of
    from sacha_core.interchange.capture import read_capture
    from sacha_core.train.framewise import read_frames

    only = () if options.codecs is None else tuple(name.strip() for name in options.codecs.split(",") if name.strip())
    if options.codecs is not None and not only:
        raise OptionError(f"--codecs {options.codecs!r} names none; expected names such as sacha,hevc,draco")
    require_codecs((*only, *options.require))
    trained = {} if options.frames is None else read_frames(options.frames)
    truth = None if options.dataset is None else read_capture(options.dataset)
    sources = Sources(options.paths, options.head, options.motion, truth is not None)
    return Comparison(subjects_of(sources), only, options.require, options.sheet, truth, trained)


def require_codecs(names: Iterable[str]) -> None:
    """Check names of codecs before anything is read.

    Raises:
        OptionError: there is no codec of that name.
    """
    from sacha_core.evaluate.peers.registry import find_peer

    for name in names:
        find_peer(name)


def run_one(name: str, chosen: Preset, console: Console) -> Record:
    """Measure one bench.

    Raises:
        SachaError: it cannot run here.
    """
    from sacha_core.bench.codec_tables import COMPARED
    from sacha_core.bench.machine import describe
    from sacha_core.bench.reference import watched
    from sacha_core.bench.registry import load
    from sacha_core.bench.store import Record

    bench, machine = load(name), describe()
    begun = time.perf_counter()
    with watched() as reference:
        found = bench.measure(chosen, console.report)
    machine["reference"] = reference.row()
    return Record(
        name,
        bench.TITLE if chosen.compared is None else COMPARED,
        chosen.extent,
        round(time.perf_counter() - begun, 1),
        machine,
        found,
    )


def tell(record: Record, console: Console) -> None:
    """Say what a bench found, with the machine, and on stderr what does not hold."""
    from sacha_core.bench.machine import sentence

    console.say(f"{record.title}\n{sentence(record.machine)}\n")
    tell_tables(record.bench, console)
    for name in record.bench.broken:
        sys.stderr.write(f"sacha bench {record.name}: {name} does not hold\n")


def tell_tables(bench: Bench, console: Console) -> None:
    """Say tables that have rows, and notes."""
    from sacha_core.bench.table import cells, heading, words

    for one in bench.tables:
        if rows := bench.of(one):
            console.say(f"{heading(one, rows)}\n")
            titles, lines = cells(one, rows)
            console.say(table(titles, lines, words(lines)) + "\n")
    for note in bench.notes:
        console.say(f"- {note}")


def run_all(options: Options, console: Console) -> dict[str, Any]:
    """Run every bench into a folder; of one that cannot run here that is said, and the others go on.

    Raises:
        SachaError: the avatar or the capture is broken.
        OSError: a file cannot be read or written.
    """
    from sacha_core.bench.again import has_times, with_repeat
    from sacha_core.bench.registry import BENCHES
    from sacha_core.bench.store import write_bench, write_index

    folder, chosen, begun = options.out or FOLDER, preset(options), dict[str, float]()
    records: dict[str, Record] = {}
    left_out: dict[str, str] = {}
    for name in BENCHES:
        begun[name] = time.perf_counter()
        try:
            record = run_one(name, chosen, console)
        except OptionError as error:  # no device, say: nothing that measuring the others would suffer from
            left_out[name] = " ".join(str(error).split())
            record = not_run(name, chosen, left_out[name])
        records[name] = record
        write_bench(record, folder)
        note = f"not run: {left_out[name]}" if name in left_out else f"{record.seconds:6.1f} s  {folder / name}.md"
        console.say(f"{name:10} {note}")
    for name in [name for name, record in records.items() if options.repeat and has_times(record.bench)]:
        later_s = time.perf_counter() - begun[name]
        records[name] = with_repeat(records[name], again := run_one(name, chosen, console), later_s)
        write_bench(records[name], folder)
        console.say(f"{name:10} {again.seconds:6.1f} s  again")
    write_index(records, folder)
    console.wrote("page", folder / "index.md")
    broken = [f"{name}: {what}" for name, record in records.items() for what in record.bench.broken]
    for what in broken:
        sys.stderr.write(f"sacha bench {what} does not hold\n")
    seconds = {name: record.seconds for name, record in records.items() if name not in left_out}
    return {"folder": folder, "seconds_of": seconds, "left_out": left_out, "broken": broken}


def not_run(name: str, chosen: Preset, why: str) -> Record:
    """Give the record of a bench that cannot run here."""
    from sacha_core.bench.machine import describe
    from sacha_core.bench.registry import BENCHES
    from sacha_core.bench.result import Bench
    from sacha_core.bench.store import Record

    title = BENCHES[name].summary.rstrip(".")  # its module may need what is missing
    return Record(name, title, chosen.extent, 0.0, describe(), Bench([], (), notes=(f"Not run: {why}.",)))


def compare(options: Options, console: Console) -> dict[str, Any]:
    """Set two runs side by side.

    Raises:
        FormatError: one is not a bench's.
        OSError: a file cannot be read.
    """
    from sacha_core.bench.compare import compare_runs, comparison
    from sacha_core.bench.store import read_runs

    found = comparison(compare_runs(*(read_runs(path) for path in options.paths)))
    tell_tables(found, console)
    return {"rows": found.rows, "notes": found.notes}


def write_page(options: Options, console: Console) -> dict[str, Any]:
    """Put the results of a folder into the performance page, and the pictures beside it.

    Raises:
        FormatError: the folder has no results, or the page no place for them.
        OSError: a file cannot be read or written.
    """
    from sacha_core.bench.page import update_page

    target = options.out or PAGE
    pictures = update_page(target, options.paths[0])
    console.wrote("page", target, f"{len(pictures)} pictures in {target.parent / 'bench'}")
    return {"page": target, "pictures": pictures}
