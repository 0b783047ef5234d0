"""Options by name: what is set is what was said, and what makes no sense is named with what was expected."""

from __future__ import annotations

from dataclasses import replace

import pytest

from sacha_core.cli.train import written
from sacha_core.errors import OptionError
from sacha_core.train.options import TrainOptions, from_record
from sacha_core.train.presets import scaled
from sacha_core.train.settings import known_settings, with_settings


def test_settings_change_what_they_name_and_nothing_else() -> None:
    base = scaled(6000, "sacha")
    made = with_settings(
        base,
        ["pruning.ratio=0.3", "density.means=visible", "width=275", "schedule.calibrations=2000, 3000",
         "density.region_weights=eyes:2,mouth:1.5", "pruning.hidden_first=yes", "schedule.prunings=2500", "importance.views=none"],
    )  # fmt: skip
    expected = replace(
        base,
        width=275,
        schedule=replace(base.schedule, calibrations=(2000, 3000), prunings=(2500,)),
        density=replace(base.density, means="visible", region_weights=(("eyes", 2.0), ("mouth", 1.5))),
        pruning=replace(base.pruning, ratio=0.3, hidden_first=True),
        importance=replace(base.importance, views=None),
    )
    assert made == expected
    assert from_record(made.record()) == made


def test_settings_are_made_all_at_once() -> None:
    made = with_settings(
        TrainOptions(), ["pruning.ratio_lowest=0.5", "pruning.ratio_highest=0.6"]
    )  # alone, 0.5 is above 0.4
    assert (made.pruning.ratio_lowest, made.pruning.ratio_highest) == (0.5, 0.6)


@pytest.mark.parametrize(
    ("setting", "message"),
    [
        ("pruning.rato=0.3", r"^option 'pruning.rato' is unknown; did you mean pruning.ratio"),
        ("ratio=0.3", r"^option 'ratio' is unknown; did you mean pruning.ratio"),
        ("qqqq=0.3", r"^option 'qqqq' is unknown; sacha train --list-options"),
        ("variant=ga", r"^option 'variant' is unknown"),
        ("pruning.ratio", r"^setting 'pruning.ratio' is not NAME=VALUE"),
        ("pruning.ratio=much", r"^pruning.ratio is 'much', expected a number$"),
        ("pruning.ratio=2", r"^pruning.ratio is 2.0, expected above 0 and below 1$"),
        ("pruning.ratio=nan", r"^pruning.ratio is nan"),
        ("pruning.score=best", r"^pruning.score is best, expected one of pis, lgs"),
        ("pruning.scope=some", r"^pruning.scope is 'some', expected one of none, all, each, weighted, regions$"),
        ("seed=1.5", r"^seed is '1.5', expected a whole number$"),
        ("threads=x", r"^threads is 'x', expected a whole number, or none$"),
        ("fine_tune=maybe", r"^fine_tune is 'maybe', expected yes or no$"),
        ("schedule.calibrations=1,b", r"^schedule.calibrations is '1,b', expected whole numbers with commas between$"),
        ("density.region_weights=eyes", r"^density.region_weights is 'eyes', expected NAME:NUMBER"),
        ("density.region_weights=eyes:0", r"^density.region_weights of eyes is 0.0, expected a number above 0$"),
    ],
)
def test_what_makes_no_sense_is_named(setting, message) -> None:
    with pytest.raises(OptionError, match=message):
        with_settings(TrainOptions(), [setting])


def test_every_option_says_what_it_is_and_what_it_takes() -> None:
    for name, setting in known_settings().items():
        assert setting.expected, name
        weights_and_rates = name.startswith(("losses.", "rates."))  # whose names say it, with their docstring
        assert setting.doc or weights_and_rates, name


def test_every_option_can_be_set_to_its_default() -> None:
    """Writing is the command's; reading it back gives the options themselves."""
    settings = [f"{name}={written(setting.default)}" for name, setting in known_settings().items()]
    assert with_settings(TrainOptions(), settings) == TrainOptions()
