"""What a short sequence costs: one avatar with its motion, against every frame coded as splats of its own."""

from __future__ import annotations

import time
from collections.abc import Iterator, Mapping, Sequence

from sacha_core.avatar.gaussians import Gaussians
from sacha_core.avatar.motion import DYNAMIC_WIDTHS
from sacha_core.bench.codec_clip import POSED, TRAINED, Clip, Played, captured_psnr, make_clip, picture_psnr
from sacha_core.bench.preset import Preset, Subject
from sacha_core.bench.result import Row
from sacha_core.codec import decode, inspect
from sacha_core.errors import SachaError
from sacha_core.evaluate.peers import frames as routes
from sacha_core.evaluate.peers.ours import NAME as OURS
from sacha_core.evaluate.peers.peer import Ground
from sacha_core.evaluate.peers.registry import find_peer
from sacha_core.flame.posing import Poser
from sacha_core.geometry.triangle import triangle_frames
from sacha_core.interchange.capture import Capture
from sacha_core.progress import Progress, Report
from sacha_core.raster.rasteriser import Rasteriser
from sacha_core.rate.encoding import encode_by_rendering

__all__ = ["sequence_rows"]

KB = 1000
PLAIN = "uncompressed"
LEVELS = (1, 2, 3)
PICTURES = ("intra", "inter")
ROWS = (1, 3, 5)  # of the table of quantisations
RATES = ("r02", "f2", "f4")
NUMBERS = 17  # of a splat without harmonics beyond degree 0, normal included
ENOUGH = 3  # frames by G-PCC, which do not depend on each other and take minutes each on an avatar with harmonics
SPLATS = {POSED: "the posed avatar's", TRAINED: "trained for each frame"}
Step = tuple[str, int, str]
"""How, at which setting, on which splats."""
Coded = tuple[str, int, float, Played]
"""What the reader calls it, bytes, bytes of a further frame, and what it decodes to."""


def sequence_rows(
    name: str,
    subject: Subject,
    codecs: Sequence[str],
    preset: Preset,
    rasteriser: Rasteriser,
    report: Report,
    trained: Mapping[int, Gaussians],
    truth: Capture | None = None,
) -> list[Row]:
    """Code some frames both ways.

    Args:
        name: of the avatar in the table.
        subject: the avatar with its motion.
        codecs: which may be run.
        preset: how much is measured.
        rasteriser: draws.
        report: told about progress.
        trained: splats by the frame that they were trained for; without them the posed avatar's stand for them.
        truth: what the frames are judged by besides, where its held-out cameras saw them; None for nothing.

    Raises:
        OptionError: there are splats of a frame that the motion does not have.
    """
    clip = make_clip(subject, preset.of(2, 4, 10), 0.1 if preset.extent == "tiny" else 1.0, trained)
    work = list(steps(codecs, clip, 1 if preset.extent == "full" else 2))
    rows: list[Row] = []
    for number, step in enumerate(work):
        report(Progress("code a sequence", number, len(work)))
        how, which, source = step
        row: Row = {"table": "sequence", "avatar": name, "frames": len(clip.times)}
        row["splats"] = "one avatar" if how == OURS or step == (PLAIN, 0, POSED) else SPLATS[source]
        begun = time.perf_counter()
        try:
            titled, n_bytes, further, after = coded(step, clip, subject)
        except (SachaError, OSError, ValueError, RuntimeError) as error:
            rows.append({**row, "route": f"{how} {which}", "failure": " ".join(str(error).split())[:200]})
            continue
        row |= {"route": titled, "frames": len(after.gaussians), "kb": n_bytes / KB}
        row |= {"kb_per_frame": n_bytes / KB / len(after.gaussians), "further_bytes": further}
        if how != PLAIN:
            row["encode_s"] = time.perf_counter() - begun
            row["psnr"] = picture_psnr(clip, clip.uncompressed(source), after, rasteriser)
        if truth is not None:
            row["captured_psnr"] = captured_psnr(clip, truth, after, rasteriser)
        rows.append(row)
    report(Progress("code a sequence", len(work), len(work)))
    return rows


def steps(codecs: Sequence[str], clip: Clip, every: int) -> Iterator[Step]:
    """Give the routes to be taken, every so many settings of each."""
    if OURS in codecs:
        yield PLAIN, 0, POSED
        yield from ((OURS, level, POSED) for level in LEVELS[::every])
    for source in clip.splats:
        if source == TRAINED:
            yield PLAIN, 0, TRAINED
        if "hevc" in codecs and find_peer("hevc").lacking() is None:
            yield from ((how, row, source) for how in PICTURES for row in ROWS[::every])
        if "gpcc" in codecs and find_peer("gpcc").lacking() is None:
            yield from (("gpcc", number, source) for number in range(0, len(RATES), every))


def coded(step: Step, clip: Clip, subject: Subject) -> Coded:
    """Take one of the routes."""
    how, which, source = step
    if how == OURS:
        return as_avatar(clip, subject, which)
    if how == PLAIN:
        return uncoded(clip, source)
    if how == "gpcc":
        n_bytes, splats = routes.through_gpcc(clip.splats[source][:ENOUGH], Ground(subject.head), RATES[which])
        title = f"each frame alone by G-PCC, {RATES[which]}"
        return title, n_bytes, n_bytes / len(splats), Played.in_the_world(splats)
    return as_pictures(step, clip, Ground(subject.head))


def as_avatar(clip: Clip, subject: Subject, level: int) -> Coded:
    """Code the avatar once, and its motion."""
    data = encode_by_rendering(clip.avatar, level, head=subject.head)
    back, found = decode(data, head=subject.head), inspect(data)
    assert back.motion is not None
    pose = Poser(subject.head, back.motion)
    poses = [triangle_frames(pose(frame), subject.head.faces) for frame in range(len(clip.times))]
    played = Played([back.gaussians] * len(poses), poses)
    return f"one avatar with its motion, level {level}", len(data), found.dynamic_bytes_per_frame, played


def uncoded(clip: Clip, source: str) -> Coded:
    """Count what float32 numbers take: of 3D Gaussian Splatting's layout with the splats' own harmonics, and of the moving parameters."""
    shown = clip.uncompressed(source)
    sizes = [4 * len(one) * (NUMBERS + 3 * one.sh_rest.shape[1]) for one in shown.gaussians]
    if source == TRAINED:
        return PLAIN, sum(sizes), sum(sizes) / len(sizes), shown
    motion = clip.avatar.motion
    assert motion is not None
    further = 4 * sum(getattr(motion, name).shape[1] for name in ("expression", *DYNAMIC_WIDTHS))
    return PLAIN, sizes[0] + further * len(motion), further, shown


def as_pictures(step: Step, clip: Clip, ground: Ground) -> Coded:
    """Code every frame's splats as pictures, with or without prediction from the frame before."""
    how, row, source = step
    splats, inter = clip.splats[source], how == "inter"
    table = "trained" if splats[0].sh_degree else "dense"
    data = routes.encode_pictures(splats, ground, table, row, inter=inter)
    further = len(data) / len(splats)
    if inter:
        first = len(routes.encode_pictures(splats[:1], ground, table, row, inter=True))
        further = (len(data) - first) / max(len(splats) - 1, 1)
    title = "HEVC pictures predicted in time" if inter else "each frame alone by HEVC"
    return f"{title}, {table} {row + 1}", len(data), further, Played.in_the_world(routes.decode_pictures(data))
