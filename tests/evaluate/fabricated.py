"""Results that nobody measured, shaped like real ones, for tests of what is made of results."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import numpy as np

from sacha_core.evaluate.ablation.result import (
    RESULT,
    Point,
    Quality,
    RegionQuality,
    RegionResult,
    RunResult,
    SizeBytes,
    write_result,
)
from sacha_core.regions.scheme import PAPER

DATASETS, VARIANTS, SEEDS, LEVELS = ("one", "two"), ("default", "rad-gp-pis", "sacha"), 3, (0, 1, 2, 3, 4)
MOTION_BYTES = 3000
BYTES_PER_GAUSSIAN = {0: 252.0, 1: 6.0, 2: 9.0, 3: 13.0, 4: 18.0}


def fabricated_results(
    datasets: Sequence[str] = DATASETS,
    variants: Sequence[str] = VARIANTS,
    seeds: int = SEEDS,
    levels: Sequence[int] = LEVELS,
    flip: bool = True,
) -> tuple[RunResult, ...]:
    """Make one result for each capture, variant and seed; later variants have fewer Gaussians and slightly worse pictures."""
    return tuple(
        fabricated(dataset, variant, seed, levels, flip, order)
        for dataset in datasets
        for seed in range(seeds)
        for order, variant in enumerate(variants)
    )


def fabricated(
    dataset: str, variant: str, seed: int, levels: Sequence[int] = LEVELS, flip: bool = True, order: int = 0
) -> RunResult:
    rng = np.random.default_rng([len(dataset), len(variant), seed])
    prunes = variant not in {"default", "ga", "rad"}
    regions = {}
    for place, name in enumerate(PAPER.regions):
        n = int(400 + 100 * place + rng.integers(50)) // (order + 1)
        modulator = 0.8 + 0.05 * place
        before = 2 * n if prunes else None
        regions[name] = RegionResult(n, int(0.8 * n), before, modulator, modulator + 0.1, 4e-4, 0.16 if prunes else 0.0)
    n = sum(region.n for region in regions.values())
    noise = float(rng.normal(0, 0.1))
    points = tuple(point(level, n, 31 - 0.2 * order + noise, flip) for level in levels)
    n_visible = sum(region.n_visible for region in regions.values())
    return RunResult(dataset, variant, seed, 3000, n, n_visible, 12 * order, 60.5, regions, points)


def point(level: int, n: int, psnr: float, flip: bool) -> Point:
    gaussians = int(n * BYTES_PER_GAUSSIAN[level])
    motion = MOTION_BYTES if level else 472 * 62
    loss = {0: 0.0, 1: 2.5, 2: 1.2, 3: 0.4, 4: 0.1}[level]
    view, expression = quality(psnr - loss, flip), quality(psnr - 2 - loss, flip)
    return Point(level, n, SizeBytes(gaussians, motion, gaussians + motion), 0.3 * bool(level), 0.1, view, expression)


def quality(psnr: float, flip: bool) -> Quality:
    error = 2.0 / psnr if flip else None
    regions = {
        name: RegionQuality(psnr - 3 + place / 2, error, 1000 * place) for place, name in enumerate(PAPER.regions, 1)
    }
    return Quality(100, psnr, 0.9 + psnr / 1000, error, None, None, regions)


def write_results(root: Path, results: Sequence[RunResult]) -> None:
    """Lay results out as an ablation does."""
    for result in results:
        write_result(root / result.dataset / f"seed-{result.seed}" / result.variant / RESULT, result)
