"""Figures of a report against hand computations; oracle: the formulas, with pencil and paper."""

from __future__ import annotations

import math
from dataclasses import replace

import pytest
from fabricated import fabricated, fabricated_results

from sacha_core.errors import OptionError
from sacha_core.evaluate.ablation.result import RunResult, SizeBytes
from sacha_core.evaluate.report.comparisons import pairs
from sacha_core.evaluate.report.differences import difference_entries
from sacha_core.evaluate.report.entry import NOVEL_EXPRESSION, NOVEL_VIEW, Entry, Seeds
from sacha_core.evaluate.report.grid import Index
from sacha_core.evaluate.report.own import own_entries
from sacha_core.evaluate.report.rates import rate_entries
from sacha_core.evaluate.report.runs import Runs
from sacha_core.evaluate.report.targets import judge_targets
from sacha_core.evaluate.report.text import difference, value

EXACT = 1e-12  # the same few operations in another order
INTERPOLATED = 1e-6  # relative; integrals of cubics in floating point


def runs_of(*results: RunResult) -> Runs:
    (runs,) = Runs.by_dataset(results)
    return runs


def with_n(result: RunResult, n: int) -> RunResult:
    return replace(result, n=n)


def shifted(result: RunResult, variant: str, bytes_factor: float = 1, psnr: float = 0, flip: float = 0) -> RunResult:
    """Give a result whose every point takes so many times the bytes, with so much added to what is measured."""

    def moved(quality: object) -> object:
        regions = {
            name: replace(one, psnr=one.psnr + psnr, flip=one.flip + flip)
            for name, one in quality.regions.items()  # type: ignore[attr-defined]
        }
        return replace(quality, psnr=quality.psnr + psnr, flip=quality.flip + flip, regions=regions)  # type: ignore[type-var, attr-defined]

    points = tuple(
        replace(
            point,
            bytes=SizeBytes(round(point.bytes.gaussians * bytes_factor), 0, 0),
            novel_view=moved(point.novel_view),
            novel_expression=moved(point.novel_expression),
        )
        for point in result.points
    )
    return replace(result, variant=variant, points=points)


def large(variant: str, seed: int) -> RunResult:
    """Give a result of so many bytes that rounding them to whole ones does not show."""
    result = fabricated("one", variant, seed)
    return shifted(result, variant, 1000.0)


def test_mean_and_spread_divide_by_one_less_than_the_seeds() -> None:
    entry = Entry("", "", "", "", "", Seeds({0: 1.0, 1: 2.0, 2: 6.0}))
    assert entry.mean == 3.0
    assert entry.sd == pytest.approx(math.sqrt((4 + 1 + 9) / 2), rel=EXACT)
    assert math.isnan(Entry("", "", "", "", "", Seeds({0: 1.0})).sd)
    assert math.isnan(Entry("", "", "", "", "", Seeds({})).mean)


def test_paired_differences_are_taken_seed_by_seed() -> None:
    ours, theirs = (50, 80, 220), (100, 100, 200)
    results = [with_n(fabricated("one", "sacha", seed), n) for seed, n in enumerate(ours)]
    results += [with_n(fabricated("one", "default", seed), n) for seed, n in enumerate(theirs)]
    runs = runs_of(*results)
    find = Index(difference_entries(runs, [("sacha", "default")], own_entries(runs)), "one")
    entry = find("sacha", "Gaussians", against="default")
    assert entry is not None
    assert entry.values == pytest.approx((-50.0, -20.0, 10.0), rel=EXACT)  # percent
    assert entry.mean == pytest.approx(-20.0, rel=EXACT)
    assert entry.sd == pytest.approx(30.0, rel=EXACT)
    assert entry.n_positive == 1
    assert difference(entry, 1) == "\N{MINUS SIGN}20.0 ± 30.0 % (1/3)"


def test_a_seed_without_its_partner_is_left_out_and_named() -> None:
    results = [fabricated("one", "sacha", seed) for seed in (0, 1)] + [
        fabricated("one", "default", seed) for seed in (1, 2)
    ]
    runs = runs_of(*results)
    find = Index(difference_entries(runs, [("sacha", "default")], own_entries(runs)), "one")
    entry = find("sacha", "psnr", against="default", setting=NOVEL_VIEW, level=0)
    assert entry is not None
    assert set(entry.seeds.values) == {1}
    assert entry.why_missing == "seeds 0, 2: no run"
    assert difference(entry, 2).endswith("[1 of 3 seeds]")


def test_bd_rate_of_curves_that_are_one_shifted_is_the_shift() -> None:
    results = []
    for seed, factor in enumerate((0.5, 0.6, 0.55)):
        anchor = large("default", seed)
        results += [anchor, shifted(anchor, "sacha", factor)]
    runs = runs_of(*results)
    find = Index(rate_entries(runs, [("sacha", "default")]), "one")
    for setting in (NOVEL_VIEW, NOVEL_EXPRESSION):
        for metric, region in (("psnr", None), ("flip", None), ("psnr", "eyes")):
            entry = find("sacha", f"BD-rate ({metric})", against="default", setting=setting, region=region)
            assert entry is not None
            assert entry.values == pytest.approx((-50.0, -40.0, -45.0), rel=INTERPOLATED)
            assert entry.mean == pytest.approx(-45.0, rel=INTERPOLATED)
            assert entry.sd == pytest.approx(5.0, rel=INTERPOLATED)
        top = find("sacha", "bytes at the best common quality (psnr)", against="default", setting=setting)
        assert top is not None
        assert top.values == pytest.approx((-50.0, -40.0, -45.0), rel=INTERPOLATED)
        shared = find("sacha", "range in common (psnr)", against="default", setting=setting)
        assert shared is not None
        assert shared.values == pytest.approx((100.0,) * 3, rel=EXACT)


def test_flip_at_equal_bytes_of_curves_that_are_one_shifted_is_the_shift() -> None:
    anchors = [large("default", seed) for seed in range(3)]
    better = [
        shifted(anchor, "sacha", flip=shift) for anchor, shift in zip(anchors, (-0.001, -0.002, -0.003), strict=True)
    ]
    find = Index(rate_entries(runs_of(*anchors, *better), [("sacha", "default")]), "one")
    entry = find("sacha", "difference at equal bytes (flip)", against="default", setting=NOVEL_VIEW, region="mouth")
    assert entry is not None
    assert entry.values == pytest.approx((-0.001, -0.002, -0.003), rel=INTERPOLATED)
    assert entry.n_positive == 0


def outcomes_of(*results: RunResult) -> dict[tuple[str, str | None], tuple[str, str]]:
    runs = runs_of(*results)
    judged = judge_targets("one", rate_entries(runs, pairs(runs.variants, "default")))
    return {(one.claim, one.measured.setting): (one.verdict, one.remark) for one in judged}


def test_targets_hold_by_the_mean_and_where_asked_by_more_than_the_spread() -> None:
    anchors = [large("default", seed) for seed in range(3)]
    ours = [
        shifted(anchor, "sacha", 0.5, flip=shift)
        for anchor, shift in zip(anchors, (-0.0005, -0.0005, 0.0001), strict=True)
    ]
    found = outcomes_of(*anchors, *ours)
    assert found["45 % fewer bytes of Gaussians than default at equal PSNR", NOVEL_VIEW] == ("held", "")
    assert found["FLIP no worse than default's at equal bytes", NOVEL_VIEW][0] == "held"
    missed = [shifted(anchor, "sacha", 0.56) for anchor in anchors]
    assert (
        outcomes_of(*anchors, *missed)["45 % fewer bytes of Gaussians than default at equal PSNR", NOVEL_VIEW][0]
        == "not held"
    )


@pytest.mark.parametrize(
    ("shifts", "verdict"), [((-0.001, -0.002, -0.003), "held"), ((-0.003, -0.0005, 0.002), "not held")]
)
def test_better_by_more_than_the_spread_asks_for_a_mean_beyond_it(shifts: tuple[float, ...], verdict: str) -> None:
    anchors = [large("default", seed) for seed in range(3)]
    ours = [shifted(anchor, "sacha", flip=shift) for anchor, shift in zip(anchors, shifts, strict=True)]
    claim = "FLIP in the eyes better than default's at equal bytes, by more than the seed spread"
    assert outcomes_of(*anchors, *ours)[claim, NOVEL_EXPRESSION][0] == verdict


def test_targets_that_cannot_be_decided_say_why() -> None:
    anchors = [large("default", seed) for seed in range(3)]
    claim = "45 % fewer bytes of Gaussians than default at equal PSNR"
    one_missing = outcomes_of(*anchors, *(shifted(anchor, "sacha") for anchor in anchors[:2]))
    assert one_missing[claim, NOVEL_VIEW] == ("not decided", "seed 2: sacha: no run")
    apart = outcomes_of(*anchors, *(shifted(anchor, "sacha", psnr=20) for anchor in anchors))
    assert apart[claim, NOVEL_VIEW] == (
        "not decided", "seeds 0, 1, 2: the curves have no quality in common, sacha is better throughout",
    )  # fmt: skip
    never_run = outcomes_of(*anchors)
    assert never_run[claim, NOVEL_VIEW] == ("not decided", "not both were run")
    single = outcomes_of(anchors[0], shifted(anchors[0], "sacha", flip=-0.001))
    spread = "FLIP in the eyes better than default's at equal bytes, by more than the seed spread"
    assert single[spread, NOVEL_VIEW] == ("not decided", "one seed has no spread")


def test_a_variants_own_figures_are_what_its_results_say() -> None:
    results = fabricated_results(("one",))
    runs = runs_of(*results)
    find = Index(own_entries(runs), "one")
    entry = find("sacha", "psnr", setting=NOVEL_EXPRESSION, region="ears", level=2)
    expected = [r.point(2).novel_expression.regions["ears"].psnr for r in results if r.variant == "sacha"]  # type: ignore[union-attr]
    assert entry is not None
    assert list(entry.values) == expected
    hidden = find("default", "hidden share")
    assert hidden is not None
    assert hidden.values == pytest.approx(
        [100 * (1 - r.n_visible / r.n) for r in results if r.variant == "default"], rel=EXACT
    )


def test_figures_are_set_as_text() -> None:
    entry = Entry("", "", "", "", "", Seeds({0: 1234.5, 1: 1235.5}))
    assert value(entry, 1) == "1,235.0 ± 0.7"
    assert value(entry, 2, per=1000.0) == "1.24 ± 0.00" or value(entry, 2, per=1000.0) == "1.23 ± 0.00"
    assert value(None, 1) == "\N{EN DASH}"
    assert value(Entry("", "", "", "", "", Seeds({0: -0.001})), 2) == "0.00"


def test_two_results_of_one_run_are_refused() -> None:
    with pytest.raises(OptionError, match="two results of sacha with seed 0 on one"):
        Runs.by_dataset([fabricated("one", "sacha", 0), fabricated("one", "sacha", 0)])
