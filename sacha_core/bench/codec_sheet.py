"""A picture of what codecs make of an avatar: ours at each level, then each of the others at the bytes of our second level, with errors."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
from jaxtyping import Bool, Float

from sacha_core.avatar.gaussians import Gaussians
from sacha_core.bench.codec_scene import Scene
from sacha_core.bench.preset import Subject
from sacha_core.evaluate.peers.ours import NAME as OURS
from sacha_core.evaluate.peers.registry import find_peer
from sacha_core.evaluate.sheet import Panel, write_sheet
from sacha_core.flame.posing import Poser
from sacha_core.geometry.triangle import TriangleFrames, triangle_frames
from sacha_core.interchange.capture import Capture
from sacha_core.perception.flip import flip_map
from sacha_core.perception.flip import missing as flip_lacks
from sacha_core.perception.psnr import psnr_over
from sacha_core.raster.camera import Camera
from sacha_core.raster.rasteriser import Rasteriser
from sacha_core.raster.scene import render_avatar
from sacha_core.rate.judging import COVERED
from sacha_core.rate.stances import stances_of
from sacha_core.rate.views import PROTOCOL_VIEWS, ring_shots

if TYPE_CHECKING:
    from sacha_core.bench.codec_rows import Judged

__all__ = ["draw_sheet"]

Pair = tuple[Panel, Panel]
"""A picture, and its error below it."""

KB = 1000
FULL_ERROR = 1 / 16  # of the range, mean of the three colours, from which on an error is drawn darkest
RAMP = (
    np.array([(255, 255, 255), (255, 221, 128), (240, 130, 45), (185, 30, 45), (50, 0, 35)]) / 255
)  # of errors, evenly spaced
GOOD_DB = 38.0  # about what our second level gives
MARGIN = 6  # pixels around the avatar
LEVEL = "level 2"  # whose bytes the others are shown at
FRONT = 3  # camera of the protocol that sees the face
STRIDE, LARGE = 2, 200  # pixels of the picture to one of the sheet, where it is that wide
LEAST_WIDTH = 240  # of a panel
COLUMNS = 6  # at most


@dataclass(frozen=True)
class Look:
    """Where the avatar is looked at from, and what is seen.

    Args:
        draw: gives the picture of some Gaussians.
        uncompressed: (h, w, 3) in [0, 1].
        own: (h, w) the avatar's own pixels.
        box: rows and columns around them.
        captured: (h, w, 3) of the capture; None without one.
    """

    uncompressed: Float[np.ndarray, "h w 3"]
    own: Bool[np.ndarray, "h w"]
    box: tuple[slice, slice]
    captured: Float[np.ndarray, "h w 3"] | None


def draw_sheet(
    path: Path,
    name: str,
    subject: Subject,
    scene: Scene,
    judged: Sequence[Judged],
    rasteriser: Rasteriser,
    truth: Capture | None,
) -> None:
    """Draw the avatar as uncompressed, at each of our levels and through each codec, with a row of error maps under each row.

    Raises:
        OSError: the picture cannot be written.
    """
    pose, camera, captured = view_of(subject, scene, truth)

    def draw(gaussians: Gaussians) -> tuple[Float[np.ndarray, "h w 3"], Float[np.ndarray, "h w"]]:
        drawn = render_avatar(gaussians, pose, camera, rasteriser=rasteriser)
        return np.clip(drawn.colour, 0, 1), drawn.alpha

    uncompressed, alpha = draw(scene.gaussians)
    look = Look(uncompressed, alpha > COVERED, box_of(alpha > COVERED), captured)
    ours = [
        one
        for one in judged
        if one.trial.peer == OURS
        and one.trial.setting.name.removeprefix("level ") in {"1", "2", "3", "4"}
        and one.scores
    ]
    size = next((one.trial.n_bytes for one in ours if one.trial.setting.name == LEVEL), fewest_bytes(judged))
    others = nearest(judged, size) if size is not None else []
    rows = [truth_panels(name, scene, look, size)]
    for shown in (ours, others):
        pictures = [draw(one.trial.gaussians)[0] for one in shown if one.trial.gaussians is not None]
        panels = [panel_of(one, picture, look) for one, picture in zip(shown, pictures, strict=True)]
        pairs = list(zip(panels, [error_panel(picture, look.uncompressed, look) for picture in pictures], strict=True))
        rows += balanced(pairs, COLUMNS - len(rows[0]) if shown is ours else COLUMNS)
    if len(rows) > 1 and ours:  # the truth stands beside our levels
        rows = [[*rows[0], *rows[1]], *rows[2:]]
    write_sheet(path, [line for row in rows for line in zip(*row, strict=True)])


def view_of(
    subject: Subject, scene: Scene, truth: Capture | None
) -> tuple[TriangleFrames, Camera, Float[np.ndarray, "h w 3"] | None]:
    """Give pose and camera: those of the first held-out image of a capture, or the protocol's front camera in the middle of the motion."""
    if not subject.bound:
        return scene.shots[0].frames, scene.shots[0].cameras[0], None
    motion = subject.avatar.motion
    assert motion is not None
    if truth is None or not truth.val:
        share = 1.0 if scene.shots[0].cameras[0].width > 400 else 0.2
        stances = stances_of(subject.avatar, subject.head, motion, [len(motion) // 2])
        shot = ring_shots(stances, PROTOCOL_VIEWS[FRONT : FRONT + 1], share)[0]
        return shot.frames, shot.cameras[0], None
    view = truth.val[len(truth.val) // 2]
    frames = triangle_frames(Poser(subject.head, motion)(min(view.timestep, len(motion) - 1)), subject.head.faces)
    return frames, view.camera, truth.image(view).astype(np.float32) / 255


def fewest_bytes(judged: Sequence[Judged]) -> int | None:
    """Give the bytes that all are shown at where our second level is missing: the fewest that give a good picture; None for no points."""
    sizes = {one.trial.n_bytes: one.scores.psnr for one in judged if one.scores is not None}
    return min((size for size, ratio in sizes.items() if ratio >= GOOD_DB), default=max(sizes, default=None))


def nearest(judged: Sequence[Judged], n_bytes: int) -> list[Judged]:
    """Give of each other lossy codec the best point of at most a tenth more bytes than asked for, or else its smallest."""
    found = []
    for name in dict.fromkeys(one.trial.peer for one in judged):
        points = [one for one in judged if one.trial.peer == name and one.scores is not None]
        if name == OURS or not points:
            continue
        small = [one for one in points if one.trial.n_bytes <= 1.1 * n_bytes]
        best = max(small, key=lambda one: one.scores.psnr) if small else min(points, key=lambda one: one.trial.n_bytes)  # type: ignore[union-attr]
        found.append(best)
    return found


def panel_of(one: Judged, picture: Float[np.ndarray, "h w 3"], look: Look) -> Panel:
    """Set a picture with its bytes and its figures."""
    ratio = psnr_over(picture, look.uncompressed, look.own)
    flip = (
        "" if flip_lacks() is not None else f", FLIP {float(flip_map(picture, look.uncompressed)[look.own].mean()):.4f}"
    )
    ours = one.trial.peer == OURS
    title = f"{find_peer(one.trial.peer).title}{f', {one.trial.setting.name}' if ours else ''}"
    assert one.scores is not None
    figures = (f"{ratio:.1f} dB{flip}", f"mean of all pictures {one.scores.psnr:.1f} dB")
    setting = () if ours else (one.trial.setting.name,)
    return Panel(cut(picture, look.box), title, (f"{one.trial.n_bytes / KB:.1f} KB", *figures, *setting))


def truth_panels(name: str, scene: Scene, look: Look, n_bytes: int | None) -> list[Pair]:
    """Set what all is held against: the capture, where there is one, and the uncompressed avatar with its error against it."""
    own = Panel(
        cut(look.uncompressed, look.box), "uncompressed", (f"{name}, {len(scene.gaussians):,} Gaussians", "", "", "")
    )
    scale = f"white: none, darkest: {100 * FULL_ERROR:.0f} % or more"
    told = (
        () if n_bytes is None else (f"others: best within 1.1 x {n_bytes / KB:.1f} KB,", "or else their fewest bytes")
    )
    blank = Panel(np.ones_like(own.image), "", ("error", scale, *told))
    if look.captured is None:
        return [(own, blank)]
    shown = Panel(cut(look.captured, look.box), "captured", ("",))
    return [(shown, blank), (own, error_panel(look.uncompressed, look.captured, look, "error against the capture"))]


def balanced(pairs: list[Pair], columns: int) -> list[list[Pair]]:
    """Break a row into as few as hold so many columns, about equally long."""
    n_rows = max(-(-len(pairs) // columns), 1)
    ends = [len(pairs) * row // n_rows for row in range(n_rows + 1)]
    return [pairs[begin:end] for begin, end in pairwise(ends) if begin < end]


def error_panel(
    picture: Float[np.ndarray, "h w 3"], truth: Float[np.ndarray, "h w 3"], look: Look, title: str = "error"
) -> Panel:
    """Set the error of a picture, white where there is none and darker the larger it is."""
    share = np.clip(np.abs(picture - truth).mean(axis=2) / FULL_ERROR, 0, 1) * (len(RAMP) - 1)
    steps = np.arange(len(RAMP))
    heat = np.stack([np.interp(share, steps, RAMP[:, channel]) for channel in range(3)], axis=2)
    return Panel(cut(heat.astype(np.float32), look.box), "", (title,))


def box_of(own: Bool[np.ndarray, "h w"]) -> tuple[slice, slice]:
    """Give rows and columns around the avatar."""
    spans = []
    for axis in (1, 0):
        places = np.flatnonzero(own.any(axis=axis))
        first, last = (int(places[0]), int(places[-1]) + 1) if len(places) else (0, own.shape[1 - axis])
        spans.append(slice(max(first - MARGIN, 0), last + MARGIN))
    return spans[0], spans[1]


def cut(image: Float[np.ndarray, "h w 3"], box: tuple[slice, slice]) -> Float[np.ndarray, "h w 3"]:
    """Cut the avatar out, halved where it is large, by the mean of blocks of pixels."""
    part = image[box]
    if part.shape[1] >= LARGE:
        h, w = (side // STRIDE * STRIDE for side in part.shape[:2])
        part = part[:h, :w].reshape(h // STRIDE, STRIDE, w // STRIDE, STRIDE, 3).mean(axis=(1, 3))
    missing = max(LEAST_WIDTH - part.shape[1], 0)  # so that the text below has room
    sides = ((0, 0), (missing // 2, missing - missing // 2), (0, 0))
    return np.asarray(np.pad(part, sides, constant_values=float(part[0, 0, 0])))
