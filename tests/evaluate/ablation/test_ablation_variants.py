"""Variants as a command line names them."""

from __future__ import annotations

import pytest

from sacha_core.errors import OptionError
from sacha_core.evaluate.ablation.variants import variant_options
from sacha_core.train.presets import VARIANTS, scaled


def test_variants_are_the_trainers_own() -> None:
    """Oracle: the presets."""
    assert variant_options(VARIANTS, 3000) == {name: scaled(3000, name) for name in VARIANTS}


def test_options_are_set_for_all_or_one() -> None:
    """Oracle: by hand."""
    settings = [
        "sh_degree=1", "less:pruning.ratio=0.1", "less:schedule.opacity_resets=50", "less:density.means=visible", "width=64", "height=64",
    ]  # fmt: skip
    found = variant_options(["sacha", "less=sacha"], 600, settings)
    assert found["less"].pruning.ratio == 0.1
    assert found["less"].schedule.opacity_resets == (50,)
    assert found["less"].density.means == "visible"
    assert found["less"].variant == "sacha"
    assert (found["sacha"].sh_degree, found["sacha"].width) == (1, 64)
    assert found["sacha"].pruning == scaled(600, "sacha").pruning


@pytest.mark.parametrize(
    ("names", "settings", "line"),
    [
        (["nonsense"], [], "variant 'nonsense' is unknown; expected one of "),
        (["mine=nonsense"], [], "variant 'nonsense' is unknown; expected one of "),
        (["sacha", "sacha"], [], "variant 'sacha' is there twice"),
        (["sacha"], ["sh_degree"], "setting 'sh_degree' is not NAME=VALUE"),
        (["sacha"], ["rad:sh_degree=1"], "setting 'rad:sh_degree=1' is for variant 'rad'; expected one of sacha"),
        (["sacha"], ["seed=3"], "seeds are not set one by one; --seeds says how many"),
        (["sacha"], ["sacha:pruning.ration=0.3"], "option 'pruning.ration' is unknown; did you mean pruning.ratio"),
        (["sacha"], ["sh_degree=1.5"], "sh_degree is '1.5', expected a whole number"),
        (["sacha"], ["pruning.ratio=1.5"], "pruning.ratio is 1.5, expected above 0 and below 1"),
    ],
)
def test_what_makes_no_sense_is_refused(names: list[str], settings: list[str], line: str) -> None:
    """Oracle: the message."""
    with pytest.raises(OptionError) as error:
        variant_options(names, 600, settings)
    assert str(error.value).startswith(line)
