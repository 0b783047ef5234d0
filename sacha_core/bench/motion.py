"""The bench of motion: bytes of a frame against how far its vertices are off, in files and in packets."""

from __future__ import annotations

import time
from collections.abc import Iterable

import numpy as np

from sacha_core.avatar.avatar import Avatar
from sacha_core.avatar.binding import initial_gaussians
from sacha_core.avatar.motion import Motion
from sacha_core.bench.preset import Preset
from sacha_core.bench.result import Bench, Column, Panel, Row, Table
from sacha_core.bench.scenes import made_head
from sacha_core.codec import Decoder, Encoder
from sacha_core.codec.displacement import displacement_products
from sacha_core.codec.levels import LEVELS, Level
from sacha_core.codec.motion import MotionReader
from sacha_core.codec.motion_writer import encode_motion
from sacha_core.codec.reading import ByteReader
from sacha_core.flame.posing import Poser
from sacha_core.progress import Progress, Report
from sacha_core.synthesis.conversation import converse

__all__ = ["TITLE", "measure"]

TITLE = "Motion: bytes of a frame against vertex error"
MM, MS = 1000.0, 1000.0
SEED, REHEARSAL_SEED = 7, 8
IN_FILE_FRAMES, IN_PACKET_FRAMES = 50, 25  # of a group
BY_VERTICES, FIXED, PACKETS, LIVE = "by vertices", "fixed steps", "packets", "packets, live"

LEVEL_ROWS = Table(
    "levels",
    "A conversation of the synthetic head (speech, blinks, turns, sway, a tracker's noise), 25 frames a second. Steps by vertices aim at "
    f"the level's error; fixed ones know no head. Groups have {IN_FILE_FRAMES} frames in files, {IN_PACKET_FRAMES} in packets; a live "
    "stream was fitted to another conversation. Bytes are all but what is said about the person; the error is the norm, RMS over vertices "
    "and frames.",
    (Column("way", "way"), Column("level", "level"), Column("frames", "frames"), Column("frame_bytes", "bytes a frame", 1),
     Column("error_mm", "vertex error, mm", 4), Column("encode_ms", "encoded, ms a frame"), Column("decode_ms", "decoded, ms a frame")),
    ("way", "level", "frames"),
)  # fmt: skip


def measure(preset: Preset, report: Report) -> Bench:
    """Measure every level in a file by vertices and by fixed steps, and in packets, recorded and live."""
    motion = converse(made_head(), preset.of(40, 300, 1500), SEED)
    rows: list[Row] = []
    for number, level in LEVELS.items():
        report(Progress("bench motion", number - 1, len(LEVELS)))
        rows += [in_file(motion, level, way) for way in (BY_VERTICES, FIXED)]
        rows += [in_packets(motion, level, way) for way in (PACKETS, LIVE)]
    report(Progress("bench motion", len(LEVELS), len(LEVELS)))
    return Bench(rows, (LEVEL_ROWS,), panels(), notes())


def in_file(motion: Motion, level: Level, way: str) -> Row:
    """Code the section `Motion`, with a model fitted to it."""
    products = displacement_products(made_head(), motion) if way == BY_VERTICES else None
    encode_motion(motion.frames(slice(0, 2)), level, IN_FILE_FRAMES, products)  # so that loops are compiled
    start = time.process_time()
    section = encode_motion(motion, level, IN_FILE_FRAMES, products)
    middle = time.process_time()
    reader = ByteReader(section, "Motion")
    back = MotionReader(reader, len(motion), motion.expression.shape[1], motion.shape, motion.static_offset).all()
    return row(way, level, motion, back, len(section), middle - start, time.process_time() - middle)


def in_packets(motion: Motion, level: Level, way: str) -> Row:
    """Send the frames; of the avatar's packet only what is said about frames counts."""
    head = made_head()
    gaussians = initial_gaussians(head.n_faces, np.random.default_rng(0), 0).select(np.arange(10))
    rehearsal = converse(head, len(motion), REHEARSAL_SEED) if way == LIVE else motion
    avatar = Avatar(gaussians, head.reference, rehearsal)
    encoder = Encoder(avatar, level, head=head, group_frames=IN_PACKET_FRAMES, live=way == LIVE)
    start = time.process_time()
    packets = [*encoder.push(motion), *encoder.finish()]
    middle = time.process_time()
    decoder = Decoder(head)
    decoder.feed(encoder.first)
    from_here = time.process_time()
    parts = [one.frames for packet in packets for one in decoder.feed(packet) if one.frames is not None]
    end = time.process_time()
    model_bytes = len(encoder.model.pack())
    n_bytes = model_bytes + sum(len(packet) for packet in packets)
    return row(way, level, motion, joined(parts), n_bytes, middle - start, end - from_here)


def joined(parts: Iterable[Motion]) -> Motion:
    """Give groups of frames as one motion."""
    groups = list(parts)
    names = ("expression", "rotation", "neck", "jaw", "eyes", "translation")
    whole = {name: np.concatenate([getattr(group, name) for group in groups]) for name in names}
    return Motion(groups[0].shape, groups[0].static_offset, **whole, frame_rate=groups[0].frame_rate)


def row(way: str, level: Level, motion: Motion, back: Motion, n_bytes: int, encode_s: float, decode_s: float) -> Row:
    """Give a row of the table."""
    n = len(motion)
    return {
        "table": "levels", "way": way, "level": round(level.number), "frames": n, "frame_bytes": n_bytes / n,
        "error_mm": vertex_error_mm(motion, back), "encode_ms": MS * encode_s / n, "decode_ms": MS * decode_s / n,
    }  # fmt: skip


def vertex_error_mm(motion: Motion, back: Motion) -> float:
    """Give how far vertices are off: norm, RMS over vertices and frames, posed in float64."""
    ours, theirs = (Poser(made_head(), one, np.float64) for one in (motion, back))
    squares = [np.square(ours(frame) - theirs(frame)).sum(axis=1).mean() for frame in range(len(motion))]
    return MM * float(np.sqrt(np.mean(squares)))


def panels() -> tuple[Panel, ...]:
    """Give what is drawn."""
    return (
        Panel(
            "Bytes of a frame", "levels", "frame_bytes", "error_mm", "bytes a frame", "vertex error, mm", series="way"
        ),
    )


def notes() -> tuple[str, ...]:
    """Give what a reader has to know."""
    return ("The goal is 45 bytes a frame below 0.1 mm.",)
