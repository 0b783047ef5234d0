"""Our codec beside other people's on the same avatars: bytes, times, pictures, and what equal pictures cost."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

from sacha_core.bench.codec_scene import Extent, Scene, Scores, judge, make_scene
from sacha_core.bench.codec_sequence import sequence_rows
from sacha_core.bench.codec_sheet import draw_sheet
from sacha_core.bench.codec_tables import comparison_panels, comparison_tables
from sacha_core.bench.preset import Comparison, Preset, Subject
from sacha_core.bench.result import Bench, Row
from sacha_core.errors import OptionError
from sacha_core.evaluate.peers import bindings as binding_codings
from sacha_core.evaluate.peers.ours import NAME as OURS
from sacha_core.evaluate.peers.ours import RULES
from sacha_core.evaluate.peers.peer import Peer
from sacha_core.evaluate.peers.registry import PEERS, find_peer
from sacha_core.evaluate.peers.trial import BINDINGS, Trial, Trials
from sacha_core.evaluate.rate_distortion import Curve, bd_rate, bytes_at, rd_curve
from sacha_core.progress import Progress, Report
from sacha_core.raster.rasteriser import Rasteriser

__all__ = ["EQUAL_DB", "Judged", "compare_codecs", "curve_of"]

KB = 1000
EQUAL_DB = (32, 35, 40, 45)
MODEL = "model"  # what training names the folder of its result
CAMERAS = 16  # of the protocol
DRAWN_DB = (27.0, 57.0)
LEAST_GAIN = 0.02  # dB that a larger point must be better by to lie on a curve
TINY, QUICK, FULL = Extent(1, 8, 1, 0.1), Extent(3, 3, 6), Extent()


@dataclass(frozen=True)
class Judged:
    """One operating point with its scores.

    Args:
        trial: what came of it.
        scores: None where it failed, or every bit came back.
    """

    trial: Trial
    scores: Scores | None


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
    rows: list[Row] = [there_row(peer) for peer in chosen]
    names = subject_names(comparison.subjects)
    rasteriser = Rasteriser(preset.threads)
    for name, subject in zip(names, comparison.subjects, strict=True):
        scene = make_scene(subject.avatar, subject.head, preset.of(TINY, QUICK, FULL))
        judged = judge_avatar(subject, chosen, scene, preset, rasteriser, report)
        rows += point_rows(name, subject, judged)
        curves = {peer.name: curve for peer in chosen if (curve := curve_of(judged, peer.name)) is not None}
        rows += equal_rows(name, curves)
        if comparison.sheet is not None:
            path = (
                comparison.sheet if len(names) == 1 else comparison.sheet.with_stem(f"{comparison.sheet.stem}-{name}")
            )
            draw_sheet(path, name, subject, scene, judged, rasteriser, comparison.truth)
        rows += sequence_rows(name, subject, [peer.name for peer in chosen], preset, rasteriser, report)
    shown = tuple(peer.name for peer in chosen if not peer.lossless)
    return Bench(rows, comparison_tables(EQUAL_DB), comparison_panels(names, shown), notes(preset))


def subject_names(subjects: Sequence[Subject]) -> list[str]:
    """Give each avatar a short name: of its file, or of as many folders around it as tell it from the others."""
    parts = [subject.path.resolve().with_suffix("").parts for subject in subjects]
    parts = [part[:-1] if part[-1] == MODEL and len(part) > 1 else part for part in parts]
    for depth in range(1, max(map(len, parts), default=1) + 1):
        names = ["-".join(part[-depth:]) for part in parts]
        if len(set(names)) == len(names):
            return names
    return [f"{index + 1}-{part[-1]}" for index, part in enumerate(parts)]


def there_row(peer: Peer) -> Row:
    """Say whether a codec can run here, and else how to get it."""
    lack = peer.lacking()
    return {"table": "codecs", "codec": peer.name, "title": peer.title, "state": "there" if lack is None else lack}


def judge_avatar(
    subject: Subject, chosen: Sequence[Peer], scene: Scene, preset: Preset, rasteriser: Rasteriser, report: Report
) -> list[Judged]:
    """Run the codecs on one avatar and look at what they give back."""
    gaussians, trials, found = subject.avatar.gaussians, Trials(subject.head, subject.avatar.motion), list[Trial]()
    few = preset.extent != "full"
    work = [(peer, one) for peer in chosen if peer.lacking() is None for one in peer.settings(few, gaussians.sh_degree)]
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


def point_rows(name: str, subject: Subject, judged: Sequence[Judged]) -> list[Row]:
    """Give a row for each operating point, with what ours takes for the same picture."""
    ours = curve_of(judged, OURS)
    rows: list[Row] = []
    for one in judged:
        trial, scores = one.trial, one.scores
        row: Row = {
            "table": "points", "avatar": name, "codec": trial.peer, "setting": trial.setting.name, "domain": trial.setting.domain,
            "n": len(subject.avatar.gaussians), "sh_degree": subject.avatar.gaussians.sh_degree,
        }  # fmt: skip
        if trial.gaussians is None:
            rows.append({**row, "failure": trial.failure})
            continue
        row |= {
            "kb": trial.n_bytes / KB,
            "encode_s": trial.encode_s,
            "decode_s": trial.decode_s,
            "kept": len(trial.gaussians),
        }
        if BINDINGS in trial.parts:
            coded = trial.parts[BINDINGS]
            row |= {"binding_kb": len(coded) / KB, "bindings": binding_codings.how_coded(coded)}
        if scores is not None:
            row |= {"psnr": scores.psnr, "lowest_psnr": scores.lowest_psnr, "ssim": scores.ssim, "flip": scores.flip}
            equal = None if ours is None or trial.peer == OURS else bytes_at(ours, scores.psnr).value
            if equal is not None:
                row |= {"ours_kb": equal / KB, "fewer_percent": 100 * (1 - equal / trial.n_bytes)}
        rows.append(row)
    known = {one.trial.peer: curve for one in judged if (curve := curve_of(judged, one.trial.peer)) is not None}
    for codec, curve in known.items():
        points = [
            (size, ratio)
            for size, ratio in zip(curve.n_bytes, curve.quality, strict=True)
            if DRAWN_DB[0] <= ratio <= DRAWN_DB[1]
        ]
        title = find_peer(codec).title
        rows += [{"table": f"curve {name}", "codec": title, "kb": size / KB, "psnr": ratio} for size, ratio in points]
    return rows


def curve_of(judged: Sequence[Judged], codec: str) -> Curve | None:
    """Give the curve of the best points of a codec, whatever their setting."""
    points = sorted(
        (one.trial.n_bytes, one.scores.psnr) for one in judged if one.trial.peer == codec and one.scores is not None
    )
    kept: list[tuple[int, float]] = []
    for size, quality in points:
        if not kept or quality > kept[-1][1] + LEAST_GAIN:
            kept.append((size, quality))
    return rd_curve(kept) if kept else None


def equal_rows(name: str, curves: dict[str, Curve]) -> list[Row]:
    """Give what equal pictures take, and how much less ours takes on average."""
    rows: list[Row] = []
    ours = curves.get(OURS)
    for codec, curve in curves.items():
        row: Row = {"table": "equal", "avatar": name, "codec": codec}
        for quality in EQUAL_DB:
            there = bytes_at(curve, quality).value
            here = None if ours is None else bytes_at(ours, quality).value
            row[f"kb_{quality}"] = None if there is None else there / KB
            if codec != OURS and there is not None and here is not None:
                row[f"fewer_{quality}"] = 100 * (1 - here / there)
        if ours is not None and codec != OURS:
            rate = bd_rate(curve, ours)
            row |= {"bd_rate": rate.value, "overlap": 100 * rate.overlap if rate.value is not None else None}
        rows.append(row)
    others = [row for row in rows if row["codec"] not in {OURS, RULES}]
    best = {q: min((row[f"kb_{q}"] for row in others if row[f"kb_{q}"]), default=None) for q in EQUAL_DB}
    if ours is not None and any(best.values()):
        row = {"table": "equal", "avatar": name, "codec": "the best of the others"}
        for quality, there in best.items():
            here = bytes_at(ours, quality).value
            row[f"kb_{quality}"] = there
            if there is not None and here is not None:
                row[f"fewer_{quality}"] = 100 * (1 - here / KB / there)
        rows.append(row)
    return rows


def notes(preset: Preset) -> tuple[str, ...]:
    """Give what a reader has to know."""
    extent = preset.of(TINY, QUICK, FULL)
    cameras = len(range(0, CAMERAS, extent.every))
    pictures = (
        f"PSNR over the avatar's own pixels, of decoded against uncompressed, {extent.frames} frames of its motion (uncompressed for all) "
        f"from {cameras} cameras; SSIM and FLIP on every {extent.closely}th of these {cameras * extent.frames} pictures. KB are 1000 bytes "
        "of all that describes the Gaussians, bindings included."
    )
    given = (
        "Lossy codecs are given the Gaussians that a renderer draws at all (opacity of 1/255 or more), sorted along the head. Curves join "
        "the best points of each codec, whatever domain they come from. Times are wall time, of programs with their start."
    )
    return pictures, given
