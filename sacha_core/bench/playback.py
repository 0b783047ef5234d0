"""The bench of playback: opening a file, its first frame, frames a second, and jumps."""

from __future__ import annotations

import json
import subprocess
import sys
import tempfile
from collections.abc import Callable
from dataclasses import replace
from functools import partial
from pathlib import Path

import numpy as np

from sacha_core.animation.player import Player, PlayOptions
from sacha_core.avatar.avatar import Avatar
from sacha_core.bench.clock import Clock, Times, interleave
from sacha_core.bench.growth import growth_rows, growth_table
from sacha_core.bench.playing import RARE, Case, Played, differences
from sacha_core.bench.preset import Preset
from sacha_core.bench.result import Bench, Column, Panel, Row, Table
from sacha_core.bench.scenes import front_camera, made_avatar, made_head
from sacha_core.codec import encode, open_stream
from sacha_core.codec.motion import MotionReader
from sacha_core.codec.whole_motion import WholeMotion
from sacha_core.errors import OptionError
from sacha_core.flame.model import HeadModel
from sacha_core.parallel.pool import available_threads
from sacha_core.progress import Progress, Report
from sacha_core.raster.camera import Camera
from sacha_core.stopwatch import Stopwatch

__all__ = ["TITLE", "measure"]

TITLE = "Playback: opening and playing a .sacha file"
USUAL = "usual"
SIZE = (550, 802)  # the paper's images
DEGREE = 3
N_FRAMES = 500  # five groups of motion, more than a player keeps, so that decoding never ends
KEPT_DEG = (0.5, 2.0)
LEVEL = 2  # the encoder's own choice
KB = 1000
WORST = 0.05  # of the frames, the slowest

FRAME = (Column("frame_ms", "a frame, ms"), Column("frames_per_s", "frames/s"), Column("worst_frames_per_s", "slowest 5 %, frames/s"),
         Column("frame_busy_ms", "processor, ms"))  # fmt: skip
PLAYING = Table(
    "playing",
    "Frames a second, decoding and posing included: the usual case, and what changes it. The error is against the whole "
    "file decoded, posed by NumPy and drawn anew, of a range of 0 to 1: the largest of all pixels, and that of one in a thousand.",
    (Column("case", "case"), Column("n", "Gaussians"), Column("width", "width"), Column("height", "height"), Column("degree", "SH degree"),
     Column("moves", "what moves"), Column("threads", "threads"), *FRAME, Column("max_error", "largest error"),
     Column("rare_error", "99.9 % below")),
    ("case", "n", "width", "height", "threads"),
)  # fmt: skip
OPENING = Table(
    "opening",
    "Opening a file, and the first frame after it; in a running process, and in a new one from its start, kernels in the cache.",
    (Column("process", "process"), Column("n", "Gaussians"), Column("frames", "frames"), Column("file_kb", "file, KB"),
     Column("import_ms", "import, ms"), Column("open_ms", "open, ms"), Column("first_ms", "first frame, ms")),
    ("process", "n", "frames"),
)  # fmt: skip
SEEKING = Table(
    "seeking",
    "A jump to any frame: its group decoded and the frame drawn, and the decoding alone; against decoding the whole motion.",
    (Column("frames", "frames"), Column("group_frames", "frames in a group"), Column("jump_ms", "jump and frame, ms"),
     Column("group_ms", "a group, ms"), Column("whole_ms", "the whole motion, ms")),
    ("frames", "group_frames"),
)  # fmt: skip
STAGES = Table(
    "stages",
    "Where a frame of the usual case goes: milliseconds that the caller waits, and the share of all.",
    (Column("stage", "stage"), Column("spent_ms", "ms", 2), Column("share_ratio", "share", 2)),
    ("stage",),
)  # fmt: skip
GROWTH = growth_table("Gaussians")


def measure(preset: Preset, report: Report) -> Bench:
    """Measure on made avatars, or on the avatar that was named.

    Raises:
        OptionError: the named avatar has no motion.
    """
    files = Files(preset)
    stages: tuple[Callable[[], list[Row]], ...] = (
        partial(playing_rows, preset, files), partial(stage_rows, preset, files), partial(opening_rows, preset, files),
        partial(seeking_rows, preset),
    )  # fmt: skip
    rows: list[Row] = []
    for done, stage in enumerate(stages):
        report(Progress("bench playback", done, len(stages)))
        rows += stage()
    report(Progress("bench playback", len(stages), len(stages)))
    tables = (PLAYING, STAGES, OPENING, SEEKING, *([GROWTH] if any(row["table"] == "growth" for row in rows) else []))
    return Bench(rows, tables, panels(), notes(files.named))


class Files:
    """Encoded avatars, each made once.

    Raises:
        OptionError: the named avatar has no motion.
    """

    def __init__(self, preset: Preset) -> None:
        self._subject, self._made = preset.subject, dict[tuple[int, int], bytes]()
        self.head: HeadModel = preset.subject.head if preset.subject else made_head()
        self.named = str(preset.subject.path) if preset.subject else "made avatars on the synthetic head"
        if preset.subject is not None and preset.subject.avatar.motion is None:
            raise OptionError(f"{preset.subject.path} has no motion, which the playback bench needs; name one that has")
        self.sizes = preset.of((200, 300), (10_000, 50_000, 200_000), (1000, 10_000, 50_000, 200_000, 1_000_000))
        self.usual = preset.of(300, 50_000, 50_000)
        if preset.subject is not None:
            self.usual = len(preset.subject.avatar.gaussians)
            self.sizes = (self.usual,)
        self.n_frames = preset.of(7, N_FRAMES, N_FRAMES)

    def of(self, n: int, n_frames: int | None = None) -> bytes:
        """Give the file of an avatar of n Gaussians, or of the one that was named."""
        key = n, n_frames or self.n_frames
        if key not in self._made:
            avatar: Avatar = self._subject.avatar if self._subject else made_avatar(n, DEGREE, key[1])[0]
            self._made[key] = encode(avatar, LEVEL, head=self.head)
        return self._made[key]


def cases_of(preset: Preset, files: Files) -> list[Case]:
    """Give the usual case, among others of more and of fewer Gaussians, and what changes it, one thing at a time."""
    threads = preset.threads or available_threads()
    width, height = preset.of((55, 80), SIZE, SIZE)
    usual = Case(USUAL, files.usual, width, height, DEGREE, "motion", PlayOptions(threads))
    found = [usual if n == files.usual else replace(usual, name=f"{n:,} Gaussians", n=n) for n in files.sizes]
    sizes = ((width // 2, height // 2), (2 * width, 2 * height))
    found += [replace(usual, name=f"{w} x {h} pixels", width=w, height=h) for w, h in sizes]
    for degree in preset.of((0,), (0,), (0, 1, 2)):
        options = replace(usual.options, sh_degree=degree)
        found.append(replace(usual, name=f"SH degree {degree}", degree=degree, options=options))
    found.append(replace(usual, name="whole picture drawn", options=replace(usual.options, crop=False)))
    kept = {turn: replace(usual.options, colour_turn_deg=turn) for turn in KEPT_DEG}
    found += [replace(usual, name=f"colours kept within {turn:g}°", options=options) for turn, options in kept.items()]
    found += [
        replace(usual, name="camera moves", moves="camera"),
        replace(usual, name="camera and head move", moves="both"),
        replace(
            usual, name=f"camera moves, colours kept within {max(kept):g}°", moves="camera", options=kept[max(kept)]
        ),
        replace(usual, name="nothing moves", moves="nothing"),
        replace(usual, name="pictures in float32", options=replace(usual.options, dtype=np.float32)),
    ]
    if threads > 1:
        found.append(replace(usual, name="1 thread", options=replace(usual.options, threads=1)))
    return found


def playing_rows(preset: Preset, files: Files) -> list[Row]:
    """Play all cases turn by turn, then hold each against the plain way."""
    cases, run = cases_of(preset, files), preset.of(2, 20, 50)
    played = {case.name: Played(case, Player.open(files.of(case.n), files.head, case.options), run) for case in cases}
    for playing in played.values():
        playing()
        playing.forget()
    interleave(played, rounds=preset.of(3, 7, 21), budget_s=preset.of(1, 40, 600), warm_up=0)
    rows: list[Row] = []
    for case in cases:
        times, error = played[case.name].times, differences(case, files.of(case.n), files.head, preset.of(3, 9, 21))
        middle, slow = np.quantile(times.wall_s, (0.5, 1 - WORST))
        rows.append(
            {"table": "playing", "case": case.name, "n": case.n, "width": case.width, "height": case.height, "degree": case.degree,
             "moves": case.moves, "threads": case.options.threads, **times.row("frame"), "frames_per_s": float(1 / middle),
             "worst_frames_per_s": float(1 / slow), "max_error": float(error.max()), "rare_error": float(np.quantile(error, RARE))}
        )  # fmt: skip
        played[case.name].close()
    for row in rows:
        if row["moves"] == "motion" and (row["n"], row["width"]) == (files.usual, cases[0].width):
            row["option_error"] = row["rare_error"]  # one scene in the picture, drawn in several ways
    by_size = [row for row in rows if row["case"] == USUAL or row["case"].endswith(" Gaussians")]
    for row in by_size:
        row["gaussians"] = row["n"]
    if len(by_size) > 1:
        rows += growth_rows("a frame", "Gaussians", [row["n"] for row in by_size], [row["frame_ms"] for row in by_size])
    return rows


def stage_rows(preset: Preset, files: Files) -> list[Row]:
    """Split the time of a frame of the usual case into its stages."""
    usual = next(case for case in cases_of(preset, files) if case.name == USUAL)
    watch = Stopwatch()
    runs: list[dict[str, float]] = []
    with Player.open(files.of(usual.n), files.head, usual.options, watch) as player:
        playing = Played(usual, player, preset.of(2, 10, 20))
        playing()
        playing.forget()
        for _ in range(preset.of(3, 9, 31)):
            watch.seconds.clear()
            playing()
            runs.append(dict(watch.seconds))
        whole = playing.times
    n_frames, all_s = len(whole.wall_s) // len(runs), float(sum(whole.wall_s))
    rows: list[Row] = []
    for stage in runs[0]:
        spent = np.array([run[stage] / n_frames for run in runs])
        times = Times(spent, spent)
        row = {key: value for key, value in times.row("spent").items() if not key.endswith("busy_ms")}
        rows.append({"table": "stages", "stage": stage, **row, "share_ratio": sum(run[stage] for run in runs) / all_s})
    return rows


def opening_rows(preset: Preset, files: Files) -> list[Row]:
    """Time opening files and drawing their first frames."""
    work = [(n, files.n_frames) for n in files.sizes]
    if preset.subject is None:
        work.append((files.sizes[0], preset.of(20, 10_000, 10_000)))
    camera, clock = front_camera(*preset.of((55, 80), SIZE, SIZE)), Clock()
    found: dict[tuple[int, int], list[tuple[float, ...]]] = {key: [] for key in work}

    def once(key: tuple[int, int]) -> None:
        begun = clock.wall(), clock.busy()
        with Player.open(files.of(*key), files.head, PlayOptions(preset.threads)) as player:
            opened = clock.wall(), clock.busy()
            player.frame(0, camera)
            done = clock.wall(), clock.busy()
        found[key].append((opened[0] - begun[0], opened[1] - begun[1], done[0] - opened[0], done[1] - opened[1]))

    interleave({key: partial(once, key) for key in work}, rounds=preset.of(3, 5, 15), budget_s=preset.of(1, 10, 120))
    rows: list[Row] = []
    for key, measured in found.items():
        open_wall, open_busy, first_wall, first_busy = np.array(measured[1:]).T  # the first was the warm-up
        times = {**Times(open_wall, open_busy).row("open"), **Times(first_wall, first_busy).row("first")}
        rows.append(
            {"table": "opening", "process": "running", "n": key[0], "frames": key[1], "file_kb": len(files.of(*key)) / KB, **times}
        )  # fmt: skip
    if preset.subject is None:
        rows.append(fresh_row(preset, files))
    return rows


FRESH = """
import json, sys, time
begun = time.perf_counter()
import numpy as np
from sacha_core.animation.player import Player, PlayOptions
from sacha_core.raster.camera import Camera
imported = time.perf_counter()
path, threads, width, height, focal = sys.argv[1], *map(int, sys.argv[2:])
player = Player.open(path, options=PlayOptions(threads or None))
opened = time.perf_counter()
player.frame(0, Camera.look_at(np.array([0.0, 0.0, 1.0]), np.zeros(3), width, height, focal))
print(json.dumps([imported - begun, opened - imported, time.perf_counter() - opened]))
"""


def fresh_row(preset: Preset, files: Files) -> Row:
    """Time the usual file in processes of its own; the head is inside the file, since making one takes longer than opening."""
    avatar, _ = made_avatar(files.usual, DEGREE, files.n_frames)
    data = encode(avatar, LEVEL, head=files.head, embed_head=True)
    spent = []
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "avatar.sacha"
        path.write_bytes(data)
        camera = front_camera(*preset.of((55, 80), SIZE, SIZE))
        numbers = (preset.threads or 0, camera.width, camera.height, round(camera.fx))
        command = [sys.executable, "-c", FRESH, str(path), *map(str, numbers)]
        for _ in range(preset.of(1, 3, 7)):
            out = subprocess.run(command, check=True, capture_output=True, text=True).stdout  # noqa: S603  (our own code)
            spent.append(json.loads(out))
    importing, opening, first = np.array(spent).T
    row: Row = {
        "table": "opening",
        "process": "new",
        "n": files.usual,
        "frames": files.n_frames,
        "file_kb": len(data) / KB,
    }
    for name, seconds in (("import", importing), ("open", opening), ("first", first)):
        row |= {key: value for key, value in Times(seconds, seconds).row(name).items() if not key.endswith("busy_ms")}
    return row


def seeking_rows(preset: Preset) -> list[Row]:
    """Time jumps in short and long motions of short and long groups."""
    n, size = preset.of(100, 10_000, 10_000), preset.of((55, 80), SIZE, SIZE)
    camera, rng = front_camera(*size), np.random.default_rng(preset.seed)
    tasks: dict[tuple[str, int, int], Callable[[], object]] = {}
    players = []
    for n_frames in preset.of((20, 60), (100, 10_000), (100, 1000, 10_000)):
        avatar, head = made_avatar(n, DEGREE, n_frames)
        for group in preset.of((10,), (25, 100), (25, 100, 400)):
            if group > n_frames:
                continue
            data = encode(avatar, LEVEL, head=head, group_frames=group)
            player = Player.open(data, head, PlayOptions(preset.threads))
            motion = open_stream(data, head=head).motion
            assert motion is not None
            players.append(player)
            n_groups = n_frames // group
            tasks["jump", n_frames, group] = partial(jump, player, camera, rng)
            tasks["group", n_frames, group] = partial(any_group, motion, n_groups, rng)
            tasks["whole", n_frames, group] = motion.all
    times = interleave(tasks, rounds=preset.of(3, 21, 101), budget_s=preset.of(1, 12, 120))
    for player in players:
        player.close()
    keys = dict.fromkeys((n_frames, group) for _, n_frames, group in tasks)
    return [
        {"table": "seeking", "frames": n_frames, "group_frames": group, "n": n,
         **{key: value for what in ("jump", "group", "whole") for key, value in times[what, n_frames, group].row(what).items()}}
        for n_frames, group in keys
    ]  # fmt: skip


def jump(player: Player, camera: Camera, rng: np.random.Generator) -> None:
    """Draw any frame."""
    player.frame(int(rng.integers(len(player))), camera)


def any_group(motion: MotionReader | WholeMotion, n_groups: int, rng: np.random.Generator) -> None:
    """Decode any group."""
    motion.group(int(rng.integers(n_groups)))


def panels() -> tuple[Panel, ...]:
    """Give the picture's panels."""
    return (
        Panel("What a frame costs, and what that changes", "playing", "frame_ms", "option_error", "a frame, ms", "error of 1 in 1,000",
              label="case", joined=False),
        Panel("Where a frame goes", "stages", "spent_ms", "stage", "ms", "", log_x=False, log_y=False, bars=True),
        Panel("Growth with Gaussians", "playing", "gaussians", "frame_ms", "Gaussians", "a frame, ms", growth=True),
        Panel("A jump", "seeking", "frames", {"jump_ms": "jump and frame", "whole_ms": "whole motion"}, "frames", "ms",
              series="group_frames"),
    )  # fmt: skip


def notes(named: str) -> tuple[str, ...]:
    """Give what a reader has to know."""
    return (
        f"Played: {named}, compressed at level {LEVEL}; pictures as bytes, on white; the camera turns by 1° a frame where it moves.",
        "Medians over frames of interleaved runs. The slowest 5 %: the rate that 95 of 100 frames reach.",
        "Where colours are not kept, only rounding in another order separates the pictures: single pixels differ, where 1/255 is just met.",
    )
