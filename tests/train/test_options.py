"""Defaults are the numbers of the paper and of GaussianAvatars' public code."""

from __future__ import annotations

from dataclasses import asdict

import pytest

from sacha_core.errors import OptionError
from sacha_core.train.options import (
    DensityOptions,
    ImportanceOptions,
    LossOptions,
    PruningOptions,
    Schedule,
    TrainOptions,
    from_record,
)


def test_losses() -> None:
    assert asdict(LossOptions()) == {
        "l1": 0.8, "ssim": 0.2, "sensitivity": 0.01, "position": 0.01, "position_limit": 1, "scale": 1, "scale_limit": 0.6,
        "mask": 0,
    }  # fmt: skip


def test_growth_and_what_it_removes() -> None:
    density = DensityOptions()
    assert (density.threshold, density.threshold_lowest, density.threshold_highest) == (3e-4, 1.5e-4, 6e-4)
    assert (density.largest_clone, density.largest, density.lowest_opacity, density.reset_opacity) == (
        0.01,
        0.1,
        0.005,
        0.01,
    )
    assert (density.means, density.spread) == ("plain", "world")


def test_pruning_and_its_score() -> None:
    pruning, importance = PruningOptions(), ImportanceOptions()
    assert (pruning.ratio, pruning.ratio_lowest, pruning.ratio_highest) == (0.2, 0.1, 0.4)
    assert (importance.views, importance.pixel_factor, importance.gaussian_factor) == (1500, 1, 1)
    assert importance.volume_space == "local"
    assert importance.visible_pixels * 120 == 10  # of the views and pixels that "visible" was measured with


def test_the_moments_of_the_paper_run() -> None:
    schedule = Schedule()
    densified = [i for i in range(schedule.iterations + 1) if schedule.densifies(i)]
    assert densified == list(range(12_000, 360_000, 2000))
    assert schedule.opacity_resets == (10_000, *range(60_000, 360_000, 60_000))
    assert (schedule.position_decay, schedule.sh_every, schedule.size_prune_from) == (360_000, 1000, 60_000)
    # an importance score needs opacities that have settled
    assert all(c - r >= 10_000 for c in schedule.calibrations for r in schedule.opacity_resets if r <= c)


def test_a_record_with_a_choice_that_there_is_not_is_refused() -> None:
    record = TrainOptions().record()
    assert from_record(record) == TrainOptions()
    record["density"]["gradient"] = "signed"
    with pytest.raises(OptionError, match=r"^options\.density\.gradient is signed, expected one of ndc, absolute$"):
        from_record(record)
