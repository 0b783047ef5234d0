"""The bench of the codec: levels against bytes, picture and time, and how time grows with Gaussians and frames."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from functools import partial

import numpy as np

from sacha_core.avatar.avatar import Avatar
from sacha_core.bench.clock import LEAST_ROUNDS, Times, interleave
from sacha_core.bench.growth import growth_rows, growth_table
from sacha_core.bench.machine import memory_gib
from sacha_core.bench.preset import Preset
from sacha_core.bench.result import Bench, Column, Panel, Row, Table
from sacha_core.bench.scenes import cameras_around, made_avatar
from sacha_core.codec import decode, encode, inspect
from sacha_core.codec.levels import LEVELS
from sacha_core.errors import OptionError
from sacha_core.flame.model import HeadModel
from sacha_core.flame.posing import Poser
from sacha_core.geometry.triangle import triangle_frames
from sacha_core.perception.psnr import psnr_over
from sacha_core.progress import Progress, Report
from sacha_core.raster.camera import Camera
from sacha_core.raster.rasteriser import Rasteriser
from sacha_core.raster.scene import Picture, render_avatar
from sacha_core.rate.judging import COVERED

__all__ = ["TITLE", "measure"]

TITLE = "Codec: level against bytes, picture and time"
KB = 1000
DEFAULT_LEVEL = 2
GIB_A_GAUSSIAN = 6e-6  # that encoding takes, at its peak
ONCE = 500_000  # Gaussians from which the quick preset times a single round

TIMES = (Column("encode_ms", "encode, ms"), Column("decode_ms", "decode, ms"))
LEVELS_TABLE = Table(
    "levels",
    "An avatar of this many Gaussians and frames at each level; PSNR of decoded against uncompressed, Gaussians and motion both, "
    "over the avatar's own pixels.",
    (Column("level", "level"), Column("n", "Gaussians"), Column("frames", "frames"), *TIMES, Column("gaussians_kb", "Gaussians, KB"),
     Column("motion_kb", "motion, KB"), Column("motion_bytes_per_frame", "bytes a frame", 1), Column("total_kb", "file, KB"),
     Column("psnr", "PSNR, dB", 2), Column("lowest_psnr", "worst picture, dB", 2)),
    ("level", "n", "frames"),
)  # fmt: skip
GAUSSIANS = Table(
    "gaussians", f"Level {DEFAULT_LEVEL} by number of Gaussians (SH degree 3), one frame.",
    (Column("n", "Gaussians"), *TIMES, Column("total_kb", "file, KB")), ("n",),
)  # fmt: skip
FRAMES = Table(
    "frames", f"Level {DEFAULT_LEVEL} by number of frames.",
    (Column("frames", "frames"), Column("n", "Gaussians"), *TIMES, Column("total_kb", "file, KB")), ("frames", "n"),
)  # fmt: skip
GROWTH = growth_table("Gaussians and frames")


def measure(preset: Preset, report: Report) -> Bench:
    """Measure the levels on the avatar that was named or a made one, and growth on made ones; or compare codecs.

    Raises:
        OptionError: a named avatar has no motion, or a codec is missing that must not.
    """
    if preset.compared is not None:
        from sacha_core.bench.codec_compare import compare_codecs  # noqa: PLC0415 (other people's codecs, for who asks)

        return compare_codecs(preset.compared, preset, report)
    if preset.subject is None:
        avatar, head = made_avatar(preset.of(400, 20_000, 50_000), n_frames=preset.of(3, 100, 500))
        named = "a made avatar on the synthetic head: painted skin, sizes and harmonics spread as a trained avatar's"
    else:
        avatar, head, named = preset.subject.avatar, preset.subject.head, str(preset.subject.path)
        if avatar.motion is None:
            raise OptionError(f"{preset.subject.path} has no motion, which the codec bench needs; name one that has")
    stages: list[Callable[[], list[Row]]] = [
        partial(level_rows, avatar, head, preset), partial(gaussian_rows, preset), partial(frame_rows, preset)
    ]  # fmt: skip
    rows: list[Row] = []
    for done, stage in enumerate(stages):
        report(Progress("bench codec", done, len(stages)))
        rows += stage()
    report(Progress("bench codec", len(stages), len(stages)))
    return Bench(rows, (LEVELS_TABLE, GAUSSIANS, FRAMES, GROWTH), panels(), notes(named))


def level_rows(avatar: Avatar, head: HeadModel, preset: Preset) -> list[Row]:
    """Time every level and compare the pictures."""
    coded = coding({level: (avatar, head, level) for level in LEVELS}, preset.of(3, 7, 15), preset.of(1, 25, 120))
    motion = avatar.motion
    assert motion is not None
    frames = np.unique(np.linspace(0, len(motion) - 1, preset.of(1, 3, 6)).astype(int)).tolist()
    size, n_cameras = preset.of((40, 60), (275, 401), (550, 802)), preset.of(2, 4, 16)
    cameras = cameras_around(Poser(head, motion)(0), n_cameras, *size)
    rasteriser = Rasteriser(preset.threads)
    before = pictures(avatar, head, frames, cameras, rasteriser)
    rows: list[Row] = []
    for level, (data, encoding, decoding) in coded.items():
        after = pictures(decode(data, head=head), head, frames, cameras, rasteriser)
        ratios = [own_pixels_psnr(one, other) for one, other in zip(before, after, strict=True)]
        found = inspect(data)
        rows.append(
            {"table": "levels", "level": level, "n": len(avatar.gaussians), "frames": len(motion), "name": f"level {level}",
             **encoding.row("encode"), **decoding.row("decode"), "gaussians_kb": found.gaussian_bytes / KB,
             "motion_kb": found.motion_bytes / KB, "motion_bytes_per_frame": found.dynamic_bytes_per_frame,
             "total_kb": len(data) / KB, "psnr": float(np.mean(ratios)), "lowest_psnr": min(ratios), "pictures": len(ratios)}
        )  # fmt: skip
    return rows


def gaussian_rows(preset: Preset) -> list[Row]:
    """Time growth with Gaussians, as far as memory reaches."""
    counts = preset.of((100, 200, 400), (1000, 10_000, 100_000, 1_000_000),
                       (1000, 3000, 10_000, 30_000, 100_000, 300_000, 1_000_000))  # fmt: skip
    room = memory_gib()
    fitting = [n for n in counts if room is None or n * GIB_A_GAUSSIAN <= room / 2]
    work = {n: (*made_avatar(n, n_frames=1), DEFAULT_LEVEL) for n in fitting}
    return grown("gaussians", "n", work, preset, {"frames": 1})


def frame_rows(preset: Preset) -> list[Row]:
    """Time growth with frames."""
    counts = preset.of((1, 3, 9), (1, 10, 100, 1000, 10_000), (1, 3, 10, 30, 100, 300, 1000, 3000, 10_000))
    n = preset.of(100, 1000, 1000)
    work = {frames: (*made_avatar(n, n_frames=frames), DEFAULT_LEVEL) for frames in counts}
    return grown("frames", "frames", work, preset, {"n": n})


Work = tuple[Avatar, HeadModel, int]


def grown(table: str, size: str, work: dict[int, Work], preset: Preset, fixed: Row) -> list[Row]:
    """Time encoding and decoding of growing work, and fit the exponents."""
    usual = {n: one for n, one in work.items() if len(one[0].gaussians) < ONCE}
    coded = coding(usual, rounds=preset.of(3, 5, 7), budget_s=preset.of(1, 15, 120))
    coded |= coding({n: work[n] for n in work.keys() - usual.keys()}, rounds=1, least=preset.of(1, 1, 3), warm_up=False)
    rows: list[Row] = []
    for n, (data, encoding, decoding) in coded.items():
        rows.append(
            {
                "table": table,
                size: n,
                **fixed,
                **encoding.row("encode"),
                **decoding.row("decode"),
                "total_kb": len(data) / KB,
            }
        )
    names = {"n": "Gaussians", "frames": "frames"}
    for of in ("encode", "decode"):
        rows += growth_rows(of, names[size], list(work), [row[f"{of}_ms"] for row in rows if row["table"] == table])
    return rows


def coding(
    work: dict[int, Work],
    rounds: int,
    budget_s: float = float("inf"),
    least: int = LEAST_ROUNDS,
    warm_up: bool = True,
) -> dict[int, tuple[bytes, Times, Times]]:
    """Code several avatars turn by turn; give the file of each, and the times of encoding and decoding.

    `warm_up` codes each once before, untimed, which compiles all there is.
    """
    files = dict[int, bytes]()

    def write(key: int) -> None:
        avatar, head, level = work[key]
        files[key] = encode(avatar, level, head=head)

    def read(key: int) -> None:
        decode(files[key], head=work[key][1])

    tasks: dict[tuple[str, int], Callable[[], object]] = {}
    for key in work:
        tasks["encode", key], tasks["decode", key] = partial(write, key), partial(read, key)
    if warm_up and work:
        for key in work:
            write(key)
        read(min(work))
    times = interleave(tasks, rounds, budget_s, warm_up=0, least=least)
    return {key: (files[key], times["encode", key], times["decode", key]) for key in work}


def pictures(
    avatar: Avatar, head: HeadModel, frames: Sequence[int], cameras: Sequence[Camera], rasteriser: Rasteriser
) -> list[Picture]:
    """Draw some frames of an avatar as each camera sees them."""
    assert avatar.motion is not None
    pose = Poser(head, avatar.motion)
    drawn = []
    for frame in frames:
        posed = triangle_frames(pose(frame), head.faces)
        drawn += [render_avatar(avatar.gaussians, posed, camera, rasteriser=rasteriser) for camera in cameras]
    return drawn


def own_pixels_psnr(before: Picture, after: Picture) -> float:
    """Give PSNR over the pixels that the avatar covers in either picture, decibels: the empty background would flatter it."""
    return psnr_over(after.colour, before.colour, (before.alpha > COVERED) | (after.alpha > COVERED))


def panels() -> tuple[Panel, ...]:
    """Give the picture's panels."""
    both = {"encode_ms": "encode", "decode_ms": "decode"}
    return (
        Panel("Bytes against picture", "levels", "total_kb", "psnr", "file, KB", "PSNR, dB", label="name", log_x=False, log_y=False),
        Panel("Time of each level", "levels", "level", both, "level", "ms", log_x=False, log_y=False),
        Panel(f"Growth with Gaussians, level {DEFAULT_LEVEL}", "gaussians", "n", both, "Gaussians", "ms", growth=True),
        Panel(f"Growth with frames, level {DEFAULT_LEVEL}", "frames", "frames", both, "frames", "ms", growth=True),
    )  # fmt: skip


def notes(named: str) -> tuple[str, ...]:
    """Give what a reader has to know."""
    rounds = "Medians of interleaved rounds; a million Gaussians once in the quick preset, and not at all with less than 12 GiB of memory."
    return (
        f"The levels are measured on {named}; KB are 1000 bytes, without the head. Growth is measured on made avatars.",
        f"Encoding and decoding run on one thread. {rounds}",
    )
