"""Our codec beside other people's on the same avatars: bytes, times, pictures, and what equal pictures cost."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

from sacha_core.bench.codec_rows import EQUAL_DB, Judged, curve_of, equal_rows, point_rows
from sacha_core.bench.codec_scene import Extent, Scene, judge, scene_of
from sacha_core.bench.codec_sequence import sequence_rows
from sacha_core.bench.codec_sheet import draw_sheet
from sacha_core.bench.codec_tables import comparison_panels, comparison_tables
from sacha_core.bench.preset import Comparison, Preset, Subject
from sacha_core.bench.result import Bench, Row
from sacha_core.errors import OptionError
from sacha_core.evaluate.peers.peer import Peer
from sacha_core.evaluate.peers.registry import PEERS, find_peer
from sacha_core.evaluate.peers.trial import Trial, Trials
from sacha_core.progress import Progress, Report
from sacha_core.raster.rasteriser import Rasteriser

__all__ = ["compare_codecs", "sheet_paths", "subject_names"]

UNTOLD = ("model", "point_cloud")  # what training names the folder or the file of its result
CAMERAS = 16  # of the protocol
NEEDS_HEAD = "takes only Gaussians that are bound to a head; name one with --head HEAD, and they are"
TINY, QUICK, FULL = Extent(1, 8, 1, 0.1), Extent(3, 3, 6), Extent()


def compare_codecs(comparison: Comparison, preset: Preset, report: Report) -> Bench:
    """Run every codec there is on every avatar.

    Raises:
        OptionError: a codec is missing that must not, or an avatar has no motion.
    """
    chosen = [find_peer(name) for name in comparison.only or PEERS]
    for name in comparison.require:
        lack = find_peer(name).lacking()
        if lack is not None:
            raise OptionError(f"codec {name} {lack}")
    require_takers(comparison, chosen)
    rows: list[Row] = [there_row(peer) for peer in chosen]
    names = subject_names(comparison.subjects)
    rasteriser = Rasteriser(preset.threads)
    for number, (name, subject) in enumerate(zip(names, comparison.subjects, strict=True)):
        scene = scene_of(subject, preset.of(TINY, QUICK, FULL))
        judged = judge_avatar(subject, chosen, scene, preset, rasteriser, report)
        rows += point_rows(name, subject, judged)
        if not subject.bound:
            left_out = [peer.name for peer in chosen if peer.needs_head]
            rows += [
                {"table": "points", "avatar": name, "codec": codec, "setting": "", "failure": NEEDS_HEAD}
                for codec in left_out
            ]
        curves = {peer.name: curve for peer in chosen if (curve := curve_of(judged, peer.name)) is not None}
        rows += equal_rows(name, curves)
        if comparison.sheet is not None:
            path = sheet_paths(comparison)[number]
            draw_sheet(path, name, subject, scene, judged, rasteriser, comparison.truth)
        if subject.bound:
            codecs, trained = [peer.name for peer in chosen], comparison.frames
            rows += sequence_rows(name, subject, codecs, preset, rasteriser, report, trained, comparison.truth)
    shown = tuple(peer.name for peer in chosen if not peer.lossless)
    return Bench(
        rows,
        comparison_tables(EQUAL_DB),
        comparison_panels(names, shown),
        notes(preset, comparison.subjects),
    )


def require_takers(comparison: Comparison, chosen: Sequence[Peer]) -> None:
    """Check that there are avatars, one alone where frames were trained for it, and codecs that take each.

    Raises:
        OptionError: there are not.
    """
    if comparison.frames and not (len(comparison.subjects) == 1 and comparison.subjects[0].bound):
        raise OptionError("--frames holds splats of one avatar's frames: name that avatar alone, bound to its head")
    for subject in comparison.subjects:
        if not subject.bound and all(peer.needs_head for peer in chosen):
            raise OptionError(f"{subject.path}: {NEEDS_HEAD}")


def subject_names(subjects: Sequence[Subject]) -> list[str]:
    """Give each avatar a short name: of its file, or of as many folders around it as tell it from the others."""
    parts = [subject.path.resolve().with_suffix("").parts for subject in subjects]
    parts = [part[:-1] if part[-1] in UNTOLD and len(part) > 1 else part for part in parts]
    for depth in range(1, max(map(len, parts), default=1) + 1):
        names = ["-".join(part[-depth:]) for part in parts]
        if len(set(names)) == len(names):
            return names
    return [f"{index + 1}-{part[-1]}" for index, part in enumerate(parts)]


def sheet_paths(comparison: Comparison) -> list[Path]:
    """Give where the sheet of each avatar goes: where it was asked for, by name where there are several; none where it was not."""
    sheet, names = comparison.sheet, subject_names(comparison.subjects)
    if sheet is None or len(names) == 1:
        return [] if sheet is None else [sheet]
    return [sheet.with_stem(f"{sheet.stem}-{name}") for name in names]


def there_row(peer: Peer) -> Row:
    """Say whether a codec can run here, and else how to get it."""
    lack = peer.lacking()
    return {"table": "codecs", "codec": peer.name, "title": peer.title, "state": "there" if lack is None else lack}


def judge_avatar(
    subject: Subject, chosen: Sequence[Peer], scene: Scene, preset: Preset, rasteriser: Rasteriser, report: Report
) -> list[Judged]:
    """Run the codecs on one avatar and look at what they give back."""
    gaussians, found = subject.avatar.gaussians, list[Trial]()
    trials = Trials(subject.head, subject.avatar.motion, subject.bound)
    few = preset.extent != "full"
    chosen = [peer for peer in chosen if subject.bound or not peer.needs_head]
    work = [
        (peer, one)
        for peer in chosen
        if peer.lacking() is None
        for one in peer.settings_for(few, gaussians.sh_degree, subject.bound)
    ]
    try:
        for number, (peer, setting) in enumerate(work):
            report(Progress(f"code by {peer.name}", number, len(work)))
            found.append(trials(peer, gaussians, setting))
    finally:
        trials.end()
    report(Progress("code", len(work), len(work)))
    decoded = {
        number: trial.gaussians
        for number, trial in enumerate(found)
        if trial.gaussians is not None and not find_peer(trial.peer).lossless
    }
    scores = judge(scene, decoded, rasteriser, report)
    return [Judged(trial, scores.get(number)) for number, trial in enumerate(found)]


def notes(preset: Preset, subjects: Sequence[Subject]) -> tuple[str, ...]:
    """Give what a reader has to know."""
    extent = preset.of(TINY, QUICK, FULL)
    cameras = len(range(0, CAMERAS, extent.every))
    pictures = (
        f"PSNR over the avatar's own pixels, of decoded against uncompressed, {extent.frames} frames of its motion (uncompressed for all) "
        f"from {cameras} cameras; SSIM and FLIP on every {extent.closely}th of these {cameras * extent.frames} pictures. KB are 1000 bytes "
        "of all that describes the Gaussians, bindings included."
    )
    given = (
        "Lossy codecs are given the Gaussians that a renderer draws at all (opacity of 1/255 or more), sorted along the head, ours in "
        "their own order. Curves join the best points of each codec, whatever domain they come from. Times are wall time, of programs "
        "with their start."
    )
    return (pictures, given, *(subject.note for subject in subjects if subject.note))
