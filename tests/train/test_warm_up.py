"""A warm-up trained once for several runs."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from sacha_core.errors import OptionError
from sacha_core.train.checkpoint import differing
from sacha_core.train.loop import train
from sacha_core.train.options import Schedule, TrainOptions
from sacha_core.train.presets import VARIANTS, scaled
from sacha_core.train.warm_up import train_warm_up, warm_up_facts, warm_up_options

SHORT = Schedule(
    iterations=24, position_decay=24, sh_every=6, densify_from=3, densify_every=4, densify_until=24, warm_up=12,
    calibrations=(12, 18), opacity_resets=(6,),
)  # fmt: skip


def options(**changes: object) -> TrainOptions:
    return replace(TrainOptions(schedule=SHORT, checkpoint_every=5, threads=1), **changes)  # type: ignore[arg-type]


def test_branching_from_a_shared_warm_up_gives_what_training_throughout_gives(tiny, tmp_path: Path) -> None:
    """Oracle: the same run without a warm-up of its own, to the bit."""
    chosen = options()
    whole = train(tiny.capture, tiny.head, chosen, tmp_path / "whole")
    shared = train_warm_up(tiny.capture, tiny.head, chosen, tmp_path / "warm-up")
    branch = train(tiny.capture, tiny.head, chosen, tmp_path / "branch", start_from=shared)
    assert branch.events == whole.events
    for name in ("position", "log_scale", "opacity_logit", "sh_dc", "binding"):
        np.testing.assert_array_equal(getattr(branch.gaussians, name), getattr(whole.gaussians, name))


def test_an_interrupted_warm_up_goes_on(tiny, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Oracle: the warm-up that nobody interrupted, to the byte."""
    whole = train_warm_up(tiny.capture, tiny.head, options(), tmp_path / "whole")

    class Enough(Exception):  # noqa: N818
        pass

    def interrupt(progress: object) -> None:
        if (tmp_path / "cut" / "checkpoint.npz").exists():
            raise Enough

    slow = replace(options(), image_cache_bytes=0)
    monkeypatch.setattr("sacha_core.train.loop.REPORT_EVERY_S", 0.0)
    with pytest.raises(Enough):
        train_warm_up(tiny.capture, tiny.head, slow, tmp_path / "cut", interrupt)
    assert not (tmp_path / "cut" / whole.name).exists()
    resumed = train_warm_up(tiny.capture, tiny.head, options(), tmp_path / "cut")
    first, second = np.load(whole), np.load(resumed)
    assert first.files == second.files
    for name in first.files:
        if name != "header":  # which tells the cache's size
            np.testing.assert_array_equal(first[name], second[name])


def test_runs_share_a_warm_up_just_where_the_trainer_lets_one_begin_with_the_others() -> None:
    """Oracle: `differing`, by which the trainer refuses a checkpoint."""
    runs = {name: scaled(600, name) for name in VARIANTS}
    for first in runs.values():
        for second in runs.values():
            same = warm_up_facts(first) == warm_up_facts(second)
            assert same == (differing(first, second, until_warm_up=True) is None)
        assert differing(warm_up_options(first), first, until_warm_up=True) is None


def test_a_warm_up_of_nothing_is_refused(tiny, tmp_path: Path) -> None:
    """Oracle: the message."""
    none = options(schedule=replace(SHORT, warm_up=1))
    with pytest.raises(OptionError, match="warm_up is 1, expected at least 2"):
        train_warm_up(tiny.capture, tiny.head, none, tmp_path)
