"""The paper's numbers, their scaling, and the variants by name."""

from __future__ import annotations

import json
from dataclasses import replace
from typing import get_args

import pytest
from hypothesis import given
from hypothesis import strategies as st

from sacha_core.cli.train import Variant
from sacha_core.errors import OptionError
from sacha_core.train.checkpoint import differing
from sacha_core.train.options import TrainOptions, from_record
from sacha_core.train.presets import VARIANTS, preset, scaled, variant
from sacha_core.train.warm_up import warm_up_facts


def test_the_paper_run() -> None:
    options = preset("paper")
    schedule = options.schedule
    assert (schedule.iterations, schedule.warm_up) == (360_000, 110_000)
    assert schedule.calibrations == (110_000, 160_000, 210_000, 260_000, 310_000)
    assert (options.density.threshold, options.pruning.ratio) == (3e-4, 0.2)
    assert (options.losses.sensitivity, options.rates.sensitivity_logit) == (1e-2, 1e-4)
    assert (options.pruning.scope, options.pruning.guard) == ("regions", "after")


def test_the_paper_schedule_scaled_to_itself_is_itself() -> None:
    assert scaled(360_000, "paper").schedule == preset("paper").schedule
    assert scaled(360_000, "paper").rates == preset("paper").rates


@given(st.integers(1, 400_000), st.sampled_from(VARIANTS))
def test_a_scaled_run_is_in_order(iterations, name) -> None:
    options = scaled(iterations, name)
    schedule = options.schedule
    assert schedule.iterations == iterations
    assert 1 <= schedule.warm_up <= iterations
    assert schedule.calibrations[0] == schedule.warm_up
    assert list(schedule.calibrations) == sorted(set(schedule.calibrations))
    assert schedule.densify_until <= iterations
    # a sensitivity can move as far as in the paper's run
    assert options.rates.sensitivity_logit * iterations == pytest.approx(36, rel=1e-9)
    if 2000 <= iterations < 20_000:
        assert iterations - schedule.calibrations[-1] >= 500
        assert max(schedule.opacity_resets) < schedule.warm_up
        assert 35 <= sum(schedule.densifies(i) for i in range(iterations)) <= 50 or name.startswith("sacha")


def test_variants_differ_as_their_names_say() -> None:
    of = {name: scaled(6000, name) for name in VARIANTS}
    without = {"ga", "default", "default-seen", "default-gp-pis", "mask"}
    assert {name for name in VARIANTS if not of[name].density.by_region} == without
    scopes = {name: of[name].pruning.scope for name in VARIANTS}
    assert [name for name in VARIANTS if scopes[name] == "none"] == ["ga", "default", "default-seen", "rad", "mask"]
    assert [name for name in VARIANTS if scopes[name] == "regions"] == ["paper", "paper-inverted", "paper-random"]
    assert [name for name in VARIANTS if scopes[name] == "weighted"] == [
        name for name in VARIANTS if name.startswith("sacha")
    ]
    assert {name for name in VARIANTS if of[name].pruning.score == "removal"} == {
        name for name in VARIANTS if name.startswith("sacha")
    }
    assert {of[name].pruning.ratio for name in VARIANTS if not name.startswith("sacha")} == {0.2}
    ours = of["sacha"].pruning
    assert (ours.ratio, ours.ratio_lowest, ours.ratio_highest) == pytest.approx((0.24, 0.12, 0.48), rel=1e-12)
    assert {name for name in VARIANTS if of[name].pruning.score == "lgs"} == {"rad-gp-lgs"}
    assert of["sacha"].schedule.densify_until == max(of["sacha"].schedule.calibrations)
    assert of["default"].schedule.densify_until == 6000
    assert {name for name in VARIANTS if of[name].pruning.hidden_at_end} == {"default-seen"}
    assert preset("ga").density.threshold == pytest.approx(2e-4, rel=1e-12)


def test_sacha_ends_growth_and_pruning_early() -> None:
    schedule = scaled(3000, "sacha").schedule
    assert schedule.calibrations == (917, 1105, 1292, 1479, 1667)
    assert schedule.densify_until == schedule.last_pruning == 1667
    paper = preset("sacha").schedule
    assert paper.calibrations == (110_000, 132_500, 155_000, 177_500, 200_000)
    assert paper.opacity_resets == (10_000, 60_000, 120_000, 180_000)
    assert all(paper.prunes(moment) for moment in paper.calibrations)
    assert preset("sacha").pruning.ratio == 0.2


@given(st.integers(1, 400_000), st.sampled_from(VARIANTS))
def test_settling_takes_no_pruning_from_a_scaled_run(iterations, name) -> None:
    schedule = scaled(iterations, name).schedule
    assert all(schedule.prunes(moment) for moment in schedule.calibrations)


@given(st.integers(200, 400_000), st.sampled_from(sorted(set(VARIANTS) - {"ga", "mask"})))
def test_all_but_raw_gaussian_avatars_and_masks_share_a_warm_up(iterations, name) -> None:
    assert warm_up_facts(scaled(iterations, name)) == warm_up_facts(scaled(iterations, "sacha"))
    assert differing(scaled(iterations, name), scaled(iterations, "sacha"), until_warm_up=True) is None


@pytest.mark.parametrize(
    ("rules", "control"),
    [("paper", "inverted"), ("paper", "random"), ("sacha", "inverted"), ("sacha", "random"), ("sacha", "uniform")],
)
def test_a_control_differs_from_its_variant_by_the_modulators_alone(rules, control) -> None:
    of = scaled(6000, f"{rules}-{control}")
    assert of.density.modulators == control
    same = replace(of, variant=rules, density=replace(of.density, modulators="learned"))
    assert same == scaled(6000, rules)


def test_the_command_line_knows_every_variant() -> None:
    assert get_args(Variant) == VARIANTS


def test_a_record_from_before_an_option_came_gets_its_default() -> None:
    record = json.loads(json.dumps(scaled(5000, "sacha").record()))
    del record["density"]["modulators"], record["pruning"]["power"], record["device"]
    assert from_record(record) == scaled(5000, "sacha")


def test_options_survive_a_json_file() -> None:
    options = scaled(5000, "sacha", TrainOptions(seed=3, width=275, height=401))
    options = replace(options, density=replace(options.density, region_weights=(("eyes", 2.0), ("nose", 0.5))))
    assert from_record(json.loads(json.dumps(options.record()))) == options


@pytest.mark.parametrize("change", [{"surprise": 1}, {"schedule": 3}, {"density": {"thresold": 1}}])
def test_other_records_are_refused(change) -> None:
    record = TrainOptions().record() | change
    with pytest.raises(OptionError, match="fields"):
        from_record(record)


def test_nonsense_is_named() -> None:
    with pytest.raises(OptionError, match=r"variant 'x' is unknown.*sacha"):
        variant(TrainOptions(), "x")
    for name, value in {"seed": -1, "sh_degree": 4, "threads": 0, "width": 3, "checkpoint_every": 0}.items():
        with pytest.raises(OptionError, match=name):
            TrainOptions(**{name: value})
    with pytest.raises(OptionError, match="iterations"):
        scaled(0)
    for ratio in (0.0, 1.5):
        with pytest.raises(OptionError, match=r"pruning\.ratio"):
            replace(TrainOptions(), pruning=replace(TrainOptions().pruning, ratio=ratio))
    with pytest.raises(OptionError, match=r"schedule\.calibrations is \(5,\).*110000"):
        replace(TrainOptions(), schedule=replace(TrainOptions().schedule, calibrations=(5,)))
