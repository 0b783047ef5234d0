"""The bench of posing: the head in float32 and float64, by NumPy and compiled, and Gaussians carried along with it."""

from __future__ import annotations

from collections.abc import Callable
from functools import partial

import numpy as np
from jaxtyping import Float

from sacha_core.animation.carry import Carried, carry, room_for
from sacha_core.animation.posed import Pose, PosedHead
from sacha_core.avatar.binding import to_world
from sacha_core.avatar.motion import Motion
from sacha_core.bench.clock import interleave
from sacha_core.bench.growth import growth_rows, growth_table
from sacha_core.bench.preset import Preset
from sacha_core.bench.result import Bench, Column, Panel, Row, Table
from sacha_core.bench.scenes import made_avatar, made_head, made_motion
from sacha_core.flame.posing import Poser
from sacha_core.geometry import quaternion
from sacha_core.geometry.triangle import TriangleFrames, triangle_frames
from sacha_core.parallel.pool import Pool, available_threads
from sacha_core.progress import Progress, Report

__all__ = ["TITLE", "measure"]

TITLE = "Posing: float32 against float64"
MM = 1000.0  # a metre
NUMPY, COMPILED = "NumPy", "compiled"

METHODS = Table(
    "methods",
    "One frame: vertices, triangle frames and their quaternions; the error is against NumPy in float64, the largest over all frames.",
    (Column("method", "method"), Column("dtype", "numbers"), Column("threads", "threads"), Column("pose_ms", "a frame, ms"),
     Column("pose_busy_ms", "processor, ms"), Column("max_error_mm", "vertex error, mm"),
     Column("max_error_deg", "frame's turn, degrees")),
    ("method", "dtype", "threads"),
)  # fmt: skip
CARRY = Table(
    "carry",
    "Gaussians carried into the world by a posed head; the error is against NumPy in float64.",
    (Column("method", "method"), Column("dtype", "numbers"), Column("n", "Gaussians"), Column("threads", "threads"),
     Column("carry_ms", "carried, ms"), Column("carry_busy_ms", "processor, ms"), Column("max_error_mm", "error of means, mm")),
    ("method", "dtype", "n", "threads"),
)  # fmt: skip
FRAMES = Table(
    "frames",
    "A motion of so many frames, in float32.",
    (Column("method", "method"), Column("frames", "frames"), Column("threads", "threads"), Column("motion_ms", "all frames, ms"),
     Column("motion_busy_ms", "processor, ms")),
    ("method", "frames", "threads"),
)  # fmt: skip
GROWTH = growth_table("frames")
Posed = tuple[np.ndarray, TriangleFrames, np.ndarray]
Attributes = tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]  # position, log_scale, quaternion, binding


class ByNumpy:
    """Poses one frame at a time by array operations."""

    def __init__(self, motion: Motion, dtype: type[np.floating]) -> None:
        self.poser, self.faces = Poser(made_head(), motion, dtype), made_head().faces

    def __call__(self, frame: int) -> Posed:
        """Give vertices, triangle frames and their quaternions."""
        vertices = self.poser(frame)
        frames = triangle_frames(vertices, self.faces)
        return vertices, frames, quaternion.from_matrix(frames.rotation)


class Compiled:
    """Poses one frame at a time by kernels on a pool."""

    def __init__(self, motion: Motion, dtype: type[np.floating], threads: int) -> None:
        self.motion, self.head = motion, PosedHead(made_head(), motion, Pool(threads), dtype)

    def pose(self, frame: int) -> Pose:
        """Give the pose, which holds until the next call."""
        m = self.motion
        vectors = np.concatenate([m.rotation[frame], m.neck[frame], m.jaw[frame], m.eyes[frame]]).reshape(5, 3)
        return self.head.pose(m.expression[frame], vectors, m.translation[frame])

    def __call__(self, frame: int) -> Posed:
        """Give vertices, triangle frames and their quaternions, which hold until the next call."""
        pose = self.pose(frame)
        return pose.vertices, pose.frames, pose.quaternions


def measure(preset: Preset, report: Report) -> Bench:
    """Measure single frames, Gaussians carried along, and growth with frames."""
    most = preset.threads or available_threads()
    rows: list[Row] = []
    for done, part in enumerate((method_rows, carry_rows, frame_rows)):
        report(Progress("bench posing", done, 3))
        rows += part(preset, most)
    report(Progress("bench posing", 3, 3))
    return Bench(rows, (METHODS, CARRY, FRAMES, GROWTH), panels(), notes())


def methods_of(motion: Motion, most: int) -> dict[tuple[str, str, int], Callable[[int], Posed]]:
    """Give each way to pose, by method, numbers and threads."""
    found: dict[tuple[str, str, int], Callable[[int], Posed]] = {}
    for dtype in (np.float32, np.float64):
        found[NUMPY, np.dtype(dtype).name, 1] = ByNumpy(motion, dtype)
        for threads in sorted({1, most}):
            found[COMPILED, np.dtype(dtype).name, threads] = Compiled(motion, dtype, threads)
    return found


def method_rows(preset: Preset, most: int) -> list[Row]:
    """Time single frames, and compare all of them with NumPy in float64."""
    motion = made_motion(preset.of(3, 40, 200))
    methods = methods_of(motion, most)
    exact = methods[NUMPY, "float64", 1]
    errors = dict.fromkeys(methods, (0.0, 0.0))
    for frame in range(len(motion)):
        vertices, frames, _ = exact(frame)
        for key, pose in methods.items():
            other, turned, _ = pose(frame)
            apart = (
                MM * float(np.linalg.norm(other - vertices, axis=1).max()),
                turn_deg(turned.rotation, frames.rotation),
            )
            errors[key] = max(errors[key][0], apart[0]), max(errors[key][1], apart[1])
    middle = len(motion) // 2
    tasks = {key: partial(pose, middle) for key, pose in methods.items()}
    times = interleave(tasks, rounds=preset.of(3, 61, 301), budget_s=preset.of(1, 10, 60))
    return [
        {"table": "methods", "method": method, "dtype": dtype, "threads": threads,
         "way": f"{method}, {dtype}, {threads} thread" + "s" * (threads > 1), **times[method, dtype, threads].row("pose"),
         "max_error_mm": errors[method, dtype, threads][0], "max_error_deg": errors[method, dtype, threads][1]}
        for method, dtype, threads in methods
    ]  # fmt: skip


def carry_rows(preset: Preset, most: int) -> list[Row]:
    """Time Gaussians carried along with one pose."""
    avatar, head = made_avatar(preset.of(300, 50_000, 50_000), n_frames=2)
    gaussians, motion = avatar.gaussians, avatar.motion
    assert motion is not None
    pose = Compiled(motion, np.float32, 1).pose(1)
    by_numpy = triangle_frames(Poser(head, motion)(1), head.faces)
    arrays = (gaussians.position, gaussians.log_scale, gaussians.quaternion, gaussians.binding)
    tasks: dict[tuple[str, int], Callable[[], np.ndarray]] = {(NUMPY, 1): lambda: to_world(gaussians, by_numpy).means}
    for threads in sorted({1, most}):
        pool, out = Pool(threads), room_for(len(gaussians))
        tasks[COMPILED, threads] = partial(carried, arrays, pose, pool, out)
    times = interleave(tasks, rounds=preset.of(3, 31, 101), budget_s=preset.of(1, 10, 60))
    frames = triangle_frames(Poser(head, motion, np.float64)(1), head.faces)
    turned = np.einsum("nij,nj->ni", frames.rotation[gaussians.binding], gaussians.position.astype(np.float64))
    exact = turned * frames.scale[gaussians.binding, None] + frames.origin[gaussians.binding]
    return [
        {"table": "carry", "method": method, "dtype": "float32", "n": len(gaussians), "threads": threads,
         **times[method, threads].row("carry"), "max_error_mm": MM * float(np.linalg.norm(task() - exact, axis=1).max())}
        for (method, threads), task in tasks.items()
    ]  # fmt: skip


def carried(arrays: Attributes, pose: Pose, pool: Pool, out: Carried) -> np.ndarray:
    """Give the means of carried Gaussians."""
    return carry(*arrays, pose, pool, out)[0]


def frame_rows(preset: Preset, most: int) -> list[Row]:
    """Time whole motions, and fit how that grows with frames."""
    counts = {
        NUMPY: preset.of((1, 2, 4), (1, 10, 100, 1000), (1, 10, 100, 1000, 10_000)),
        COMPILED: preset.of((1, 2, 4), (1, 10, 100, 1000, 10_000), (1, 3, 10, 30, 100, 300, 1000, 3000, 10_000)),
    }
    motion = made_motion(max(max(sizes) for sizes in counts.values()))
    methods: dict[str, Callable[[int], Posed]] = {
        NUMPY: ByNumpy(motion, np.float32),
        COMPILED: Compiled(motion, np.float32, most),
    }

    def play(method: str, frames: int) -> None:
        pose = methods[method]
        for frame in range(frames):
            pose(frame)

    keys = [(method, size) for method, sizes in counts.items() for size in sizes]
    times = interleave({key: partial(play, *key) for key in keys}, rounds=preset.of(3, 3, 5), warm_up=0)
    threads = {NUMPY: 1, COMPILED: most}
    rows: list[Row] = [
        {"table": "frames", "method": method, "frames": size, "threads": threads[method], **times[method, size].row("motion")}
        for method, size in keys
    ]  # fmt: skip
    for method, sizes in counts.items():
        rows += growth_rows(method, "frames", sizes, [times[method, size].median_ms for size in sizes])
    return rows


def turn_deg(rotations: Float[np.ndarray, "f 3 3"], exact: Float[np.ndarray, "f 3 3"]) -> float:
    """Give the largest angle between two sets of rotations, degrees, from the chord, which keeps its digits near 0."""
    chord = np.sqrt(((rotations.astype(np.float64) - exact) ** 2).sum(axis=(1, 2)).max())
    return float(np.degrees(2 * np.arcsin(min(chord / np.sqrt(8), 1))))


def panels() -> tuple[Panel, ...]:
    """Give the picture's panels."""
    return (
        Panel("One frame of the head", "methods", "pose_ms", "max_error_mm", "ms", "largest error of a vertex, mm",
              label="way", joined=False),
        Panel("Growth with frames", "frames", "frames", "motion_ms", "frames", "all frames, ms", series="method", growth=True),
    )  # fmt: skip


def notes() -> tuple[str, ...]:
    """Give what a reader has to know."""
    head = made_head()
    components = f"{head.exprdirs.shape[2]} expression components, {len(head.parents)} joints"
    return (
        f"The synthetic head: {head.n_vertices:,} vertices, {head.n_faces:,} triangles, {components}. Medians of interleaved rounds.",
        "What the error of float32 does over chains of joints is in the stability bench.",
        "Carried by NumPy, Gaussians get their opacities too, which the compiled way leaves to the harmonics' pass.",
    )
