"""What a short sequence costs: one avatar with its motion, against every frame coded as splats of its own."""

from __future__ import annotations

import time
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from sacha_core.avatar.avatar import Avatar
from sacha_core.avatar.binding import to_world
from sacha_core.avatar.gaussians import Gaussians
from sacha_core.bench.preset import Preset, Subject
from sacha_core.bench.result import Row
from sacha_core.codec import decode, inspect
from sacha_core.errors import SachaError
from sacha_core.evaluate.peers import frames as routes
from sacha_core.evaluate.peers.ours import NAME as OURS
from sacha_core.evaluate.peers.peer import Ground, visible
from sacha_core.evaluate.peers.registry import find_peer
from sacha_core.flame.posing import Poser
from sacha_core.geometry.triangle import TriangleFrames, triangle_frames
from sacha_core.perception.psnr import psnr_over
from sacha_core.progress import Progress, Report
from sacha_core.raster.rasteriser import Rasteriser
from sacha_core.raster.scene import render_avatar
from sacha_core.rate.encoding import encode_by_rendering
from sacha_core.rate.judging import COVERED
from sacha_core.rate.views import PROTOCOL_VIEWS, Shot, ring_shots

__all__ = ["sequence_rows"]

KB = 1000
IN_THE_WORLD = TriangleFrames(np.eye(3, dtype=np.float32)[None], np.ones(1, np.float32), np.zeros((1, 3), np.float32))
LEVELS = (1, 2, 3)
ROWS = {"trained": (1, 3, 5), "dense": (1, 3, 5)}
EVERY_CAMERA = 5  # of the protocol
RATES = ("r02", "f2", "f4")
ENOUGH = (
    3  # frames by G-PCC, whose frames do not depend on each other and take minutes each on an avatar with harmonics
)


@dataclass(frozen=True)
class Clip:
    """Some consecutive frames.

    Args:
        avatar: with these frames as its motion.
        shots: each posed, and the cameras that look at it.
        splats: (t) the posed avatar of each frame as splats in the world.
    """

    avatar: Avatar
    shots: tuple[Shot, ...]
    splats: list[Gaussians]


def sequence_rows(
    name: str, subject: Subject, codecs: Sequence[str], preset: Preset, rasteriser: Rasteriser, report: Report
) -> list[Row]:
    """Code some frames from the middle of the motion both ways."""
    count = preset.of(2, 4, 10)
    clip = make_clip(subject, count, 0.1 if preset.extent == "tiny" else 1.0)
    ground, rows = Ground(subject.head), list[Row]()
    table = "trained" if subject.avatar.gaussians.sh_degree else "dense"
    every = 1 if preset.extent == "full" else 2
    work: list[tuple[str, int]] = [("ours", level) for level in LEVELS[::every]] if OURS in codecs else []
    if "hevc" in codecs and find_peer("hevc").lacking() is None:
        work += [(how, row) for how in ("intra", "inter") for row in ROWS[table][::every]]
    if "gpcc" in codecs and find_peer("gpcc").lacking() is None:
        work += [("gpcc", number) for number in range(0, len(RATES), every)]
    for number, (how, which) in enumerate(work):
        report(Progress("code a sequence", number, len(work)))
        row: Row = {"table": "sequence", "avatar": name, "frames": count}
        begun = time.perf_counter()
        try:
            titled, n_bytes, further, poses, splats = route(how, which, clip, subject, ground, table)
        except (SachaError, OSError, ValueError, RuntimeError) as error:
            rows.append({**row, "route": f"{how} {which}", "failure": " ".join(str(error).split())[:200]})
            continue
        done = len(splats)
        row |= {
            "route": titled,
            "frames": done,
            "kb": n_bytes / KB,
            "kb_per_frame": n_bytes / KB / done,
            "further_bytes": further,
        }
        row["encode_s"] = time.perf_counter() - begun
        ratios = []
        for frame in range(done):
            for camera in clip.shots[frame].cameras:
                drawn = render_avatar(subject.avatar.gaussians, clip.shots[frame].frames, camera, rasteriser=rasteriser)
                own = drawn.alpha > COVERED
                back = render_avatar(splats[frame], poses[frame], camera, rasteriser=rasteriser)
                ratios.append(psnr_over(back.colour, drawn.colour, own))
        rows.append({**row, "psnr": float(np.mean(ratios))})
    report(Progress("code a sequence", len(work), len(work)))
    return rows


def make_clip(subject: Subject, count: int, scale: float) -> Clip:
    """Cut frames from the middle of the motion and pose the avatar."""
    motion = subject.avatar.motion
    assert motion is not None
    first = max((len(motion) - count) // 2, 0)
    short = motion.frames(slice(first, first + count))
    shots = ring_shots(subject.avatar, subject.head, short, range(len(short)), PROTOCOL_VIEWS[::EVERY_CAMERA], scale)
    seen = visible(subject.avatar.gaussians)
    splats = []
    for shot in shots:
        world = to_world(seen, shot.frames)
        scales = np.log(np.maximum(world.scales, np.finfo(np.float32).tiny))
        splats.append(replace(seen, position=world.means, log_scale=scales, quaternion=world.quaternions))
    return Clip(replace(subject.avatar, motion=short), shots, splats)


Route = tuple[str, int, float, list[TriangleFrames], list[Gaussians]]


def route(how: str, which: int, clip: Clip, subject: Subject, ground: Ground, table: str) -> Route:
    """Take one of the routes: its title, bytes, bytes of a further frame, and poses and Gaussians to draw."""
    count = len(clip.splats)
    world = [IN_THE_WORLD] * count
    if how == "ours":
        data = encode_by_rendering(clip.avatar, which, head=subject.head)
        back, found = decode(data, head=subject.head), inspect(data)
        assert back.motion is not None
        pose = Poser(subject.head, back.motion)
        poses = [triangle_frames(pose(frame), subject.head.faces) for frame in range(count)]
        title = f"one avatar with its motion, level {which}"
        return title, len(data), found.dynamic_bytes_per_frame, poses, [back.gaussians] * count
    if how == "gpcc":
        n_bytes, splats = routes.through_gpcc(clip.splats[:ENOUGH], ground, RATES[which])
        unbound = [replace(one, binding=np.zeros_like(one.binding)) for one in splats]
        return f"each frame alone by G-PCC, {RATES[which]}", n_bytes, n_bytes / len(unbound), world, unbound
    data = routes.encode_pictures(clip.splats, ground, table, which, inter=how == "inter")
    further = len(data) / count
    if how == "inter":
        further = (len(data) - len(routes.encode_pictures(clip.splats[:1], ground, table, which, inter=True))) / max(
            count - 1, 1
        )
    title = "HEVC pictures predicted in time" if how == "inter" else "each frame alone by HEVC"
    return f"{title}, {table} {which + 1}", len(data), further, world, routes.decode_pictures(data)
