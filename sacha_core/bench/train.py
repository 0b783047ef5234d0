"""The bench of training: what a budget buys, what an iteration costs over the rasteriser's share, and where it goes."""

from __future__ import annotations

import copy
from collections.abc import Callable, Iterator
from dataclasses import replace
from functools import partial
from itertools import count, product

import numpy as np

from sacha_core.avatar.binding import to_world
from sacha_core.bench.clock import Times, interleave
from sacha_core.bench.growth import growth_rows, growth_table
from sacha_core.bench.preset import Preset
from sacha_core.bench.result import Bench, Column, Panel, Row, Table
from sacha_core.bench.train_budget import BUDGET, VARIANT, budget_rows
from sacha_core.bench.trial import DEGREE, Trial, made_trial
from sacha_core.flame.posing import Poser
from sacha_core.geometry.triangle import triangle_frames
from sacha_core.parallel.pool import Pool, available_threads
from sacha_core.progress import Progress, Report
from sacha_core.raster.bounds import image_bounds
from sacha_core.raster.harmonics import sh_colours
from sacha_core.raster.rasteriser import Rasteriser
from sacha_core.raster.splats import Splats
from sacha_core.stopwatch import Stopwatch
from sacha_core.train.cpu_engine import CpuEngine

__all__ = ["TITLE", "measure"]

TITLE = "Training: budget against quality, and where an iteration goes"
CAMERAS = 4  # that see each pose of a trial
MARGIN = 10  # pixels that training draws around the avatar, for the window of SSIM
SMALL, MIDDLE = (275, 401), (550, 802)
STAGE_ITERATIONS = 60
WHOLE, REST = "the whole iteration", "between the stages"

ITERATION = Table(
    "iteration",
    "One iteration (posing, drawing, loss, gradients, Adam) against the rasteriser's own forward and backward pass on the same Gaussians "
    "and cameras: over the whole image, and over the part of it that training draws.",
    (Column("n", "Gaussians"), Column("width", "width"), Column("height", "height"), Column("threads", "threads"),
     Column("iteration_ms", "iteration, ms"), Column("iteration_busy_ms", "processor, ms"), Column("raster_ms", "rasteriser, ms"),
     Column("raster_ratio", "iteration / rasteriser", 2), Column("cropped_ms", "cropped, ms"),
     Column("cropped_ratio", "iteration / cropped", 2)),
    ("n", "width", "height", "threads"),
)  # fmt: skip
STAGES = Table(
    "stages",
    f"Where an iteration goes, means of {STAGE_ITERATIONS}; the stages do not overlap.",
    (Column("stage", "stage"), Column("n", "Gaussians"), Column("width", "width"), Column("height", "height"),
     Column("threads", "threads"), Column("stage_ms", "ms")),
    ("stage", "n", "width", "height", "threads"),
)  # fmt: skip
GROWTH = growth_table("Gaussians")


def measure(preset: Preset, report: Report) -> Bench:
    """Measure iterations against the rasteriser, stages, and budgets."""
    most = preset.threads or available_threads()
    report(Progress("bench train: iterations", 0, 2))
    rows = iteration_rows(preset, most)
    report(Progress("bench train: stages", 1, 2))
    rows += stage_rows(preset, most)
    rows += budget_rows(preset, report)
    return Bench(rows, (BUDGET, ITERATION, STAGES, GROWTH), panels(), notes(preset))


def iteration_rows(preset: Preset, most: int) -> list[Row]:
    """Time iterations and the rasteriser alone, turn by turn."""
    counts = preset.of((300, 600), (5000, 20_000, 50_000), (5000, 10_000, 20_000, 50_000, 100_000))
    sizes = preset.of(((32, 48),), (SMALL, MIDDLE), (SMALL, MIDDLE))
    tasks: dict[tuple[str, int, tuple[int, int], int], Callable[[], None]] = {}
    for n, size in product(counts, sizes):
        trial = made_trial(n, size, CAMERAS)
        for threads in sorted({1, most}):
            iteration, whole, cropped = turns(trial, threads)
            tasks["iteration", n, size, threads] = iteration
            tasks["raster", n, size, threads] = whole
            tasks["cropped", n, size, threads] = cropped
    rounds = preset.of(3, 2 * 2 * CAMERAS, 8 * 2 * CAMERAS)  # each view as often as any other
    times = interleave(tasks, rounds, budget_s=preset.of(1, 40, 240), warm_up=2)
    rows: list[Row] = []
    for n, (width, height), threads in product(counts, sizes, sorted({1, most})):
        of = {what: times[what, n, (width, height), threads] for what in ("iteration", "raster", "cropped")}
        rows.append(
            {"table": "iteration", "n": n, "width": width, "height": height, "threads": threads,
             "size": f"{width} x {height}, {threads} thread" + "s" * (threads > 1),
             **of["iteration"].row("iteration"), **of["raster"].row("raster"), **of["cropped"].row("cropped"),
             "raster_ratio": ratio(of["iteration"], of["raster"]), "cropped_ratio": ratio(of["iteration"], of["cropped"])}
        )  # fmt: skip
    for width, height in sizes:
        costs = [times["iteration", n, (width, height), most].median_ms for n in counts]
        rows += growth_rows(f"iteration at {width} x {height}", "Gaussians", counts, costs)
    return rows


def ratio(one: Times, other: Times) -> float:
    """Give the ratio of two medians."""
    return one.median_ms / other.median_ms


def turns(trial: Trial, threads: int) -> tuple[Callable[[], None], Callable[[], None], Callable[[], None]]:
    """Give three functions, each of which takes the views of a trial in turn.

    Returns:
        One does an iteration; one draws the Gaussians and takes a gradient back, over the whole image; one does so over the part of it that
        training draws.
    """
    engine = opened(trial, threads)
    pool = Pool(threads)
    rasterisers = Rasteriser(pool=pool), Rasteriser(pool=pool)
    splats = [splats_of(trial, k) for k in range(len(trial.targets))]
    height, width = trial.targets[0].sensitivity.shape
    upstream = np.random.default_rng(0).normal(size=(4, height, width)).astype(np.float32)

    def draw(rasteriser: Rasteriser, k: int, box: tuple[int, int, int, int]) -> None:
        left, top, w, h = box
        frame = rasteriser.forward(splats[k], trial.targets[k].camera.crop(*box), np.ones(4, np.float32))
        rasteriser.backward(frame, upstream[:, top : top + h, left : left + w])

    def whole(turn: Iterator[int]) -> None:
        draw(rasterisers[0], next(turn) % len(splats), (0, 0, width, height))

    def cropped(turn: Iterator[int]) -> None:
        k = next(turn) % len(splats)
        some, camera = splats[k], trial.targets[k].camera
        box = image_bounds(some.means, some.scales, some.opacities, camera, margin=MARGIN, pool=pool)
        draw(rasterisers[1], k, box or (0, 0, width, height))

    def iteration(turn: Iterator[int]) -> None:
        trial.step(engine, next(turn))

    return partial(iteration, count(1)), partial(whole, count(1)), partial(cropped, count(1))


def opened(trial: Trial, threads: int) -> CpuEngine:
    """Give an engine at a trial's beginning."""
    engine = CpuEngine(trial.head, trial.motion, replace(trial.options, threads=threads))
    engine.put(copy.deepcopy(trial.state))
    return engine


def splats_of(trial: Trial, k: int) -> Splats:
    """Give a trial's Gaussians as its view k would draw them first."""
    gaussians, target = trial.state.gaussians(), trial.targets[k]
    frames = triangle_frames(Poser(trial.head, trial.motion)(target.timestep), trial.head.faces)
    world = to_world(gaussians, frames)
    colours = sh_colours(gaussians.sh_dc, gaussians.sh_rest, world.means, target.camera.centre, DEGREE)
    sensitivity = np.full((len(colours), 1), 0.1, np.float32)
    return Splats(
        world.means, world.scales, world.quaternions, world.opacities, np.concatenate([colours, sensitivity], 1)
    )


def stage_rows(preset: Preset, most: int) -> list[Row]:
    """Take an iteration apart."""
    n, (width, height) = preset.of((300, (32, 48)), (20_000, SMALL), (20_000, SMALL))
    rows: list[Row] = []
    iterations = preset.of(2, STAGE_ITERATIONS, STAGE_ITERATIONS)
    trial = made_trial(n, (width, height), CAMERAS)
    for threads in sorted({1, most}):
        engine = opened(trial, threads)
        trial.run(engine, iterations)
        engine.stopwatch = Stopwatch()
        with engine.stopwatch(REST):
            trial.run(engine, iterations, iterations + 1)
        stages = engine.stopwatch.seconds
        rows += [
            {"table": "stages", "stage": stage, "n": n, "width": width, "height": height, "threads": threads,
             "stage_ms": 1000 * seconds / iterations,
             "scene": f"{n:,} Gaussians at {width} x {height}, {threads} thread" + "s" * (threads > 1)}
            for stage, seconds in [(WHOLE, sum(stages.values())), *stages.items()]
        ]  # fmt: skip
    return rows


def panels() -> tuple[Panel, ...]:
    """Give the picture's panels."""
    psnr = {"view_psnr": "held-out camera", "expression_psnr": "held-out expressions"}
    return (
        Panel("What a budget buys", "budget", "train_s", psnr, "training, s", "PSNR, dB", label="iterations", log_y=False),
        Panel("An iteration", "iteration", "n", "iteration_ms", "Gaussians", "ms", series="size", growth=True),
        Panel("An iteration over the rasteriser's share", "iteration", "n", "raster_ratio", "Gaussians",
              "iteration / forward and backward pass", series="size", log_y=False),
        Panel("Where an iteration goes", "stages", "stage_ms", "stage", "ms", "", series="scene", log_x=False, log_y=False, bars=True),
    )  # fmt: skip


def notes(preset: Preset) -> tuple[str, ...]:
    """Give what a reader has to know."""
    filmed = (
        "the named capture" if preset.film is not None else "a capture of the synthetic head, filmed small for this"
    )
    return (
        f"Budgets train `{VARIANT}` on {filmed}, each once; a run's quality is the same to the bit each time, its seconds are not.",
        f"Iterations train a made avatar with harmonics of degree {DEGREE}, one camera each; medians of interleaved rounds.",
        "Gradients go back through the projection and on to the pose in the stage `gradients`; the rasteriser alone has one of its own.",
    )
