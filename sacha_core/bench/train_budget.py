"""What a budget of training buys: iterations against time and held-out quality."""

from __future__ import annotations

import time
from pathlib import Path
from tempfile import TemporaryDirectory

from sacha_core.bench.preset import Preset
from sacha_core.bench.result import Column, Row, Table
from sacha_core.bench.scenes import made_head
from sacha_core.evaluate.views import evaluate_avatar
from sacha_core.flame.model import HeadModel
from sacha_core.interchange.capture import Capture, read_capture
from sacha_core.interchange.capture_writer import CaptureWriter
from sacha_core.progress import Progress, Report, silent
from sacha_core.synthesis.film import film, plan_takes
from sacha_core.synthesis.options import SynthOptions
from sacha_core.train.loop import train
from sacha_core.train.options import TrainOptions
from sacha_core.train.output import TrainedModel
from sacha_core.train.presets import scaled

__all__ = ["BUDGET", "budget_rows", "filmed"]

VARIANT = "sacha"
WARM_UP = 40  # iterations that nobody times: kernels are compiled in them
BUDGET = Table(
    "budget",
    f"Training `{VARIANT}` for so many iterations; PSNR and SSIM by a camera, and in expressions, that training never saw.",
    (Column("iterations", "iterations"), Column("train_s", "training, s", 1), Column("n", "Gaussians"),
     Column("view_psnr", "camera, dB", 2), Column("view_ssim", "SSIM", 3),
     Column("expression_psnr", "expressions, dB", 2), Column("expression_ssim", "SSIM", 3)),
    ("iterations",),
)  # fmt: skip


def budget_rows(preset: Preset, report: Report) -> list[Row]:
    """Train for each budget, and judge what comes out.

    The capture is the named one, or one filmed for this, small enough that the shortest budgets show what they are worth.
    """
    with TemporaryDirectory(prefix="sacha-bench-") as name:
        folder = Path(name)
        capture, head = preset.film or (filmed(folder / "capture", made_head(), film_options(preset)), made_head())
        rows: list[Row] = []
        budgets = preset.of((20,), (150, 300, 600, 1200), (300, 600, 1200, 2400, 4800))
        trained(capture, head, min(budgets[0], WARM_UP), folder / "warm-up", preset)
        for done, iterations in enumerate(budgets):
            report(Progress("bench train: budgets", done, len(budgets)))
            rows.append(budget_row(capture, head, iterations, folder / str(iterations), preset))
        return rows


def budget_row(capture: Capture, head: HeadModel, iterations: int, folder: Path, preset: Preset) -> Row:
    """Train once, and judge."""
    begun = time.perf_counter()
    model = trained(capture, head, iterations, folder, preset)
    seconds = time.perf_counter() - begun
    found = evaluate_avatar(model.gaussians, head, capture, model.motion, limit=preset.of(2, 24, 100))
    return {
        "table": "budget", "iterations": iterations, "train_s": seconds, "train_ms": 1000 * seconds, "n": len(model.gaussians),
        "view_psnr": found.novel_view.psnr, "view_ssim": found.novel_view.ssim,
        "expression_psnr": found.novel_expression.psnr, "expression_ssim": found.novel_expression.ssim,
    }  # fmt: skip


def trained(capture: Capture, head: HeadModel, iterations: int, folder: Path, preset: Preset) -> TrainedModel:
    """Train once."""
    options = scaled(iterations, VARIANT, TrainOptions(seed=preset.seed, threads=preset.threads, device="cpu"))
    return train(capture, head, options, folder)


def film_options(preset: Preset) -> SynthOptions:
    """Give what is filmed."""
    width, height = preset.of((24, 36), (138, 200), (275, 401))
    return SynthOptions(
        train=preset.of(("EXP-5",), ("EMO-1", "EXP-5"), ("EMO-1", "EXP-2", "EXP-3", "EXP-5")),
        train_timesteps=preset.of(2, 5, 8),
        test_timesteps=preset.of(1, 3, 6),
        cameras=preset.of((0, 8), tuple(range(0, 16, 2)), tuple(range(16))),
        width=width,
        height=height,
        seed=preset.seed,
        supersample=preset.of(1, 2, 2),
    )


def filmed(folder: Path, head: HeadModel, options: SynthOptions, report: Report = silent) -> Capture:
    """Film a capture.

    Args:
        folder: where its images go.
        head: who performs.
        options: what is filmed.
        report: told how far it is.
    """
    takes = plan_takes(head, options)
    writer = CaptureWriter(
        folder, f"synthetic-{options.seed}", head.reference, origin=options.origin(head.reference.sha256)
    )
    sequences = {take.name: writer.sequence(take.name, take.tracked, tuple(take.cameras)) for take in takes}
    for take in takes:
        for picture in film(head, take, options, report=report):
            sequences[take.name].add(
                picture.timestep, picture.camera_index, picture.camera, picture.image, picture.mask
            )
        sequences[take.name].finish()
    writer.finish([sequences[name] for name in options.train], [sequences[options.test]])
    return read_capture(folder)
