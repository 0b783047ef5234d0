"""What codecs came to on an avatar, as rows: every operating point, curves of the best, and what equal pictures cost."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

from sacha_core.bench.codec_scene import Scores
from sacha_core.bench.preset import Subject
from sacha_core.bench.result import Row
from sacha_core.evaluate.peers import bindings as binding_codings
from sacha_core.evaluate.peers.ours import FITTED, RULES
from sacha_core.evaluate.peers.ours import NAME as OURS
from sacha_core.evaluate.peers.registry import find_peer
from sacha_core.evaluate.peers.trial import BINDINGS, Trial
from sacha_core.evaluate.rate_distortion import Curve, bd_rate, bytes_at, rd_curve

__all__ = ["EQUAL_DB", "Judged", "curve_of", "equal_rows", "point_rows"]

KB = 1000
EQUAL_DB = (32, 35, 40, 45)
DRAWN_DB = (27.0, 57.0)
LEAST_GAIN = 0.02  # dB that a larger point must be better by to lie on a curve


@dataclass(frozen=True)
class Judged:
    """One operating point with its scores.

    Args:
        trial: what came of it.
        scores: None where it failed, or every bit came back.
    """

    trial: Trial
    scores: Scores | None


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
        if BINDINGS in trial.parts and subject.bound:
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
    others = [row for row in rows if row["codec"] not in {OURS, FITTED, RULES}]
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
