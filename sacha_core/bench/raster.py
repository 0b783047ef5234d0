"""The bench of the rasteriser: time and error by Gaussians, resolution, channels and threads, and of what one may leave out."""

from __future__ import annotations

import importlib.util
from collections.abc import Iterable
from dataclasses import dataclass
from itertools import product

import numpy as np
from jaxtyping import Float

from sacha_core.bench.clock import Times, interleave
from sacha_core.bench.growth import growth_rows, growth_table
from sacha_core.bench.picture_error import BAND, SIDE, picture_error
from sacha_core.bench.preset import Preset
from sacha_core.bench.raster_options import OPTIONS, option_rows
from sacha_core.bench.result import Bench, Column, Panel, Row, Table
from sacha_core.bench.scenes import front_camera, head_shell
from sacha_core.parallel.pool import available_threads
from sacha_core.progress import Progress, Report
from sacha_core.raster.camera import Camera
from sacha_core.raster.rasteriser import Frame, Rasteriser
from sacha_core.raster.splats import Splats
from sacha_core.stopwatch import Stopwatch

__all__ = ["TITLE", "Drawing", "measure"]

TITLE = "Rasteriser: run time against error"
SMALL, MIDDLE, LARGE = (275, 401), (550, 802), (1100, 1604)
GROWTH_SIZE = MIDDLE

MEASURES = (
    Column("forward_ms", "forward, ms"),
    Column("backward_ms", "backward, ms"),
    Column("total_ms", "both, ms"),
    Column("total_busy_ms", "processor, ms"),
    Column("max_error", "largest error"),
    Column("max_error_in_band", "in the band"),
)
SCENE = (
    Column("n", "Gaussians"),
    Column("width", "width"),
    Column("height", "height"),
    Column("channels", "channels"),
    Column("threads", "threads"),
)
IDENTITY = ("n", "width", "height", "channels", "threads")
SIZES = Table(
    "sizes", "Gaussians on a shell of a head's size, by number, resolution, channels and threads.", (*SCENE, *MEASURES), IDENTITY
)  # fmt: skip
GAUSSIANS = Table("gaussians", "From a thousand Gaussians to a million.", (*SCENE, *MEASURES), IDENTITY)
GROWTH = growth_table("Gaussians")
STAGES = Table(
    "stages",
    "Where that time goes: milliseconds that the caller waits, means.",
    (Column("stage", "stage"), *SCENE, Column("stage_ms", "ms")),
    ("stage", *IDENTITY),
)
PEERS = Table(
    "peers",
    "Against the same picture and gradient by plain float32 torch, tile after tile.",
    (Column("by", "by"), *SCENE, *MEASURES),
    ("by", *IDENTITY),
)


@dataclass
class Drawing:
    """One configuration: what is drawn, with what.

    Args:
        splats: n Gaussians.
        camera: from where.
        rasteriser: with a pool and buffers of its own, so that its last frame stays valid while others draw.
        upstream: (c, h, w) gradient that is taken back.
        frame: what was drawn last.
    """

    splats: Splats
    camera: Camera
    rasteriser: Rasteriser
    upstream: Float[np.ndarray, "c h w"]
    frame: Frame | None = None

    @classmethod
    def of(cls, splats: Splats, camera: Camera, threads: int, stopwatch: Stopwatch | None = None) -> Drawing:
        """Make the configuration."""
        shape = (splats.channels, camera.height, camera.width)
        upstream = np.random.default_rng(0).normal(size=shape).astype(np.float32)
        return cls(splats, camera, Rasteriser(threads, stopwatch=stopwatch), upstream)

    @property
    def background(self) -> Float[np.ndarray, " c"]:
        """White."""
        return np.ones(self.splats.channels, np.float32)

    def forward(self) -> None:
        """Draw."""
        self.frame = self.rasteriser.forward(self.splats, self.camera, self.background)

    def backward(self) -> None:
        """Take the gradient back."""
        assert self.frame is not None
        self.rasteriser.backward(self.frame, self.upstream)

    def about(self) -> Row:
        """Give what identifies the configuration."""
        return {
            "n": len(self.splats), "height": self.camera.height, "width": self.camera.width,
            "channels": self.splats.channels, "threads": self.rasteriser.threads,
            "scene": f"{len(self.splats):,} at {self.camera.width} x {self.camera.height}",
        }  # fmt: skip

    def error(self, n_patches: int) -> Row:
        """Compare with the exact picture."""
        self.forward()
        assert self.frame is not None
        depths = self.frame.bins.projection.depths[: len(self.splats)]
        return picture_error(self.frame.image, self.splats, self.camera, self.background, depths, n_patches).row()


def measure(preset: Preset, report: Report) -> Bench:
    """Measure the grid of sizes, growth, the options, and a plain peer where torch is there to be one."""
    most = preset.threads or available_threads()
    parts = (sizes, stages, gaussians, option_rows, peers)
    rows: list[Row] = []
    for done, part in enumerate(parts):
        report(Progress("bench raster", done, len(parts)))
        rows += part(preset, most)
    report(Progress("bench raster", len(parts), len(parts)))
    more = [row for row in rows if row["table"] in {STAGES.name, GROWTH.name}]
    tables = (SIZES, STAGES, OPTIONS, GAUSSIANS, GROWTH, PEERS)
    return Bench([row for row in rows if row not in more], tables, panels(most), notes(rows), more=more)


def sizes(preset: Preset, most: int) -> list[Row]:
    """Time the grid."""
    counts = preset.of((500,), (10_000, 50_000), (10_000, 50_000, 200_000))
    resolutions = preset.of(((40, 60),), (SMALL, MIDDLE), (SMALL, MIDDLE, LARGE))
    channels = preset.of((4,), (3, 4), (1, 3, 4))
    threads = (
        sorted({1, most}) if preset.extent != "full" else sorted({*(2**k for k in range(most.bit_length())), most})
    )
    shells = {(n, c): head_shell(n, c) for n, c in product(counts, channels)}
    drawings = [
        Drawing.of(shells[n, c], front_camera(*size), t) for n, size, c, t in product(counts, resolutions, channels, threads)
    ]  # fmt: skip
    return timed("sizes", drawings, preset, rounds=preset.of(3, 11, 25), patches=preset.of(4, 24, 64))


def stages(preset: Preset, most: int) -> list[Row]:
    """Take a forward and a backward pass apart."""
    n, size = preset.of((500, (40, 60)), (50_000, MIDDLE), (50_000, MIDDLE))
    times = preset.of(2, 40, 100)
    rows: list[Row] = []
    for threads in sorted({1, most}):
        watch = Stopwatch()
        drawing = Drawing.of(head_shell(n), front_camera(*size), threads, watch)
        for k in range(times + 1):
            if k == 1:  # compiled, and memory touched
                watch.seconds.clear()
            drawing.forward()
            drawing.backward()
        about = drawing.about()
        rows += [
            {"table": "stages", "stage": stage, **about, "of": f"{about['scene']}, {threads} thread" + "s" * (threads > 1),
             "stage_ms": 1000 * seconds / times}
            for stage, seconds in watch.seconds.items()
        ]  # fmt: skip
    return rows


def gaussians(preset: Preset, most: int) -> list[Row]:
    """Time growth with the number of Gaussians, and fit it."""
    counts = preset.of((200, 500, 1000), (1000, 10_000, 100_000, 1_000_000),
                       (1000, 3000, 10_000, 30_000, 100_000, 300_000, 1_000_000))  # fmt: skip
    size = preset.of((40, 60), GROWTH_SIZE, GROWTH_SIZE)
    drawings = [Drawing.of(head_shell(n), front_camera(*size), most) for n in counts]
    rows = timed("gaussians", drawings, preset, rounds=preset.of(3, 5, 15), patches=preset.of(2, 8, 32))
    for of in ("forward", "backward", "total"):
        rows += growth_rows(of, "Gaussians", counts, [row[f"{of}_ms"] for row in rows if row["table"] == "gaussians"])
    return rows


def timed(table: str, drawings: Iterable[Drawing], preset: Preset, rounds: int, patches: int) -> list[Row]:
    """Time configurations turn by turn, and compare each with the exact picture.

    A picture does not depend on the number of threads, so it is compared once for all of them.
    """
    drawings = list(drawings)
    tasks = {(k, part): getattr(d, part) for k, d in enumerate(drawings) for part in ("forward", "backward")}
    times = interleave(tasks, rounds, budget_s=preset.of(1, 20, 240))
    rows: list[Row] = []
    errors: dict[tuple[object, ...], Row] = {}
    for k, drawing in enumerate(drawings):
        about = drawing.about()
        picture = tuple(about[key] for key in IDENTITY if key != "threads")
        if picture not in errors:
            errors[picture] = drawing.error(patches)
        rows.append(
            {"table": table, **about, **three_times(times[k, "forward"], times[k, "backward"]), **errors[picture]}
        )
    return rows


def three_times(forward: Times, backward: Times) -> Row:
    """Give forward, backward and both under the names of a row."""
    return {**forward.row("forward"), **backward.row("backward"), **(forward + backward).row("total")}


def peers(preset: Preset, most: int) -> list[Row]:
    """Time the plain peer against the rasteriser; no rows where torch is missing."""
    if importlib.util.find_spec("torch") is None:
        return []
    from sacha_core.bench.raster_plain import PlainRasteriser, on_threads  # noqa: PLC0415 (torch)

    n, size = preset.of((500, (40, 60)), (50_000, SMALL), (50_000, MIDDLE))
    ours = Drawing.of(head_shell(n), front_camera(*size), most)
    ours.forward()
    assert ours.frame is not None
    depths = ours.frame.bins.projection.depths[:n]
    plain = PlainRasteriser()
    scene = (ours.splats, ours.camera, ours.background)
    tasks = {
        "forward": ours.forward,
        "backward": ours.backward,
        "plain forward": lambda: plain.forward(*scene),
        "plain both": lambda: plain.forward_backward(*scene, ours.upstream),
    }
    with on_threads(most):
        times = interleave(tasks, rounds=3)
        image = plain.forward(*scene).numpy()
    mine = {**three_times(times["forward"], times["backward"]), **ours.error(preset.of(2, 24, 64))}
    theirs = {**times["plain forward"].row("forward"), **times["plain both"].row("total"),
              **picture_error(image, *scene, depths, preset.of(2, 24, 64)).row()}  # fmt: skip
    theirs["backward_ms"] = theirs["total_ms"] - theirs["forward_ms"]
    about = ours.about()
    return [
        {"table": "peers", "by": "sacha", **about, **mine},
        {"table": "peers", "by": "plain torch", **about, **theirs},
    ]


def panels(most: int) -> tuple[Panel, ...]:
    """Give the picture's panels."""
    width, height = GROWTH_SIZE
    both, error = "forward and backward, ms", "largest error"
    return (
        Panel("What one may leave out", "options", "total_ms", "max_error", f"harmonics, {both}", error, label="option", joined=False),
        Panel("By Gaussians and resolution", "sizes", "total_ms", "max_error", both, error, series="scene", joined=False),
        Panel(f"Growth, {width} x {height}, {most} threads", "gaussians", "n",
              {"forward_ms": "forward", "backward_ms": "backward"}, "Gaussians", "ms", growth=True),
        Panel("Where the time goes", "stages", "stage_ms", "stage", "ms", "", series="of", log_x=False, log_y=False, bars=True),
    )  # fmt: skip


def notes(rows: list[Row]) -> tuple[str, ...]:
    """Give what a reader has to know."""
    pixels = max(row["error_pixels"] for row in rows if row["table"] == "sizes")
    error = (
        "Errors are differences of a colour (0 to 1) from a float64 compositor without tiles or boxes, in the rasteriser's depth order, "
        f"on {pixels:,} pixels of each picture ({SIDE} x {SIDE} patches, most of them where Gaussians lie)."
    )
    band = (
        "In the band: pixels where a decision at a threshold (alpha at 1/255 or 0.99, transmittance at 1e-4) is closer than "
        f"{BAND:.0e}, so that float32 may decide otherwise than float64; one changes a colour by 1/255 at most."
    )
    return (
        "Medians of interleaved rounds: wall time, and processor time of all threads for both passes together.",
        error,
        band,
        "Gaussians keep their size as their number grows, so they overlap more and more.",
    )
