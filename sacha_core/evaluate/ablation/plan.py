"""What an ablation shall do: which runs, with which options, in which folders."""

from __future__ import annotations

import hashlib
import json
import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

from sacha_core.errors import OptionError
from sacha_core.evaluate.ablation.result import RESULT, UNCOMPRESSED
from sacha_core.evaluate.picture_metrics import METRICS
from sacha_core.evaluate.splits import FRAMES
from sacha_core.train.options import TrainOptions
from sacha_core.train.output import WARM_UP_CHECKPOINT
from sacha_core.train.warm_up import warm_up_facts

__all__ = ["HEAD", "Dataset", "Judging", "PlannedRun", "WarmUp", "level_file", "planned_runs", "shared_warm_ups"]

HEAD = "head.npz"
MODEL = "model"
FILE_NAME = re.compile(r"[A-Za-z0-9][A-Za-z0-9._+-]*")


@dataclass(frozen=True)
class Dataset:
    """A capture to train on.

    Args:
        name: what results call it.
        root: its folder.
        head: file of the head that it was tracked with.
    """

    name: str
    root: Path
    head: Path


@dataclass(frozen=True)
class Judging:
    """How runs are judged.

    Args:
        levels: of the codec, each 1 to 4.
        images: at most so many of the held-out camera, and as many held-out expressions.
        metrics: of the pictures; PSNR and SSIM always come along.
        flip_images: at most so many of the images, evenly spread, are also judged by FLIP and LPIPS, which take long.

    Raises:
        OptionError: there is no image, or no such level or metric.
    """

    levels: tuple[int, ...] = (1, 2, 3, 4)
    images: int = FRAMES
    metrics: tuple[str, ...] = METRICS
    flip_images: int = 30

    def __post_init__(self) -> None:
        """Refuse what cannot be done."""
        if min(self.images, self.flip_images) < 1:
            fewer = min(self.images, self.flip_images)
            raise OptionError(f"{fewer} images to judge by were asked for, expected at least 1")
        wrong = [level for level in self.levels if not 1 <= level <= 4]
        if wrong or len(set(self.levels)) < len(self.levels):
            raise OptionError(f"levels are {', '.join(map(str, self.levels))}, expected some of 1, 2, 3, 4")
        if unknown := sorted(set(self.metrics) - set(METRICS)):
            raise OptionError(f"metric {unknown[0]!r} is unknown; expected some of {', '.join(METRICS)}")

    @property
    def points(self) -> tuple[int, ...]:
        """Levels with the uncompressed avatar before them."""
        return (UNCOMPRESSED, *sorted(self.levels))


@dataclass(frozen=True)
class PlannedRun:
    """One variant on one capture with one seed.

    Args:
        dataset: what it is trained on.
        variant: what results call it; `options.variant` is the one that its options come from.
        options: of the training.
        judging: how it is judged.
        out: the ablation's folder.
    """

    dataset: Dataset
    variant: str
    options: TrainOptions
    judging: Judging
    out: Path

    @property
    def name(self) -> str:
        """What progress calls it."""
        return f"{self.dataset.name} seed {self.options.seed} {self.variant}"

    @property
    def seed_folder(self) -> Path:
        """Where everything of its capture and seed lies."""
        return self.out / self.dataset.name / f"seed-{self.options.seed}"

    @property
    def folder(self) -> Path:
        """Where everything of it lies."""
        return self.seed_folder / self.variant

    @property
    def model(self) -> Path:
        """Where training's outcome lies."""
        return self.folder / MODEL

    @property
    def result(self) -> Path:
        """Its result, which is written last."""
        return self.folder / RESULT


@dataclass(frozen=True)
class WarmUp:
    """A warm-up that runs share.

    Args:
        run: any of them.
        folder: where it lies.
    """

    run: PlannedRun
    folder: Path

    @property
    def name(self) -> str:
        """What progress calls it."""
        return f"{self.run.dataset.name} seed {self.run.options.seed} {self.folder.name}"

    @property
    def checkpoint(self) -> Path:
        """What it comes to."""
        return self.folder / WARM_UP_CHECKPOINT


def level_file(folder: Path, level: int) -> Path:
    """Give the file of a run's avatar at a level of the codec."""
    return folder / f"level-{level}.sacha"


def planned_runs(
    out: Path, datasets: Sequence[Dataset], variants: Mapping[str, TrainOptions], seeds: int, judging: Judging
) -> tuple[PlannedRun, ...]:
    """Give all runs: seed by seed, so that what is done at any time compares all variants, those of one capture and seed together.

    Args:
        out: the ablation's folder.
        datasets: captures.
        variants: options by the name that results call them; the seed in them does not count.
        seeds: 0 and so many in all.
        judging: how runs are judged.

    Raises:
        OptionError: there is nothing to do, or a name is there twice or cannot be a folder's.
    """
    if seeds < 1:
        raise OptionError(f"{seeds} seeds were asked for, expected at least 1")
    names = [dataset.name for dataset in datasets]
    for what, given in (("dataset", names), ("variant", list(variants))):
        if not given:
            raise OptionError(f"there is no {what} to train, expected at least one")
        for name in given:
            if not FILE_NAME.fullmatch(name):
                raise OptionError(f"{what} {name!r} cannot name a folder, expected letters, digits and . _ + - only")
    if twice := sorted({name for name in names if names.count(name) > 1}):
        raise OptionError(
            f"several datasets are called {twice[0]!r}, by which results tell them apart; rename a folder"
        )
    return tuple(
        PlannedRun(dataset, variant, replace(options, seed=seed), judging, out)
        for seed in range(seeds)
        for dataset in datasets
        for variant, options in variants.items()
    )


def shared_warm_ups(runs: Sequence[PlannedRun]) -> dict[PlannedRun, WarmUp]:
    """Give the warm-up of each run that shares it with another; runs that are alone in theirs are trained from scratch.

    Args:
        runs: of any captures, seeds and variants.
    """
    groups: dict[Path, list[PlannedRun]] = {}
    for run in runs:
        groups.setdefault(_warm_up_folder(run), []).append(run)
    shared: dict[PlannedRun, WarmUp] = {}
    for folder, group in groups.items():
        if len(group) > 1 and group[0].options.schedule.warm_up > 1:
            shared |= dict.fromkeys(group, WarmUp(group[0], folder))
    return shared


def _warm_up_folder(run: PlannedRun) -> Path:
    """Name a warm-up by all that determines it, so that variants which come later find it again."""
    facts = json.dumps(warm_up_facts(run.options), sort_keys=True)
    return run.seed_folder / f"warm-up-{hashlib.sha256(facts.encode()).hexdigest()[:8]}"
