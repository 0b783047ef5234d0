"""Numbers of triangles and regions against loops over Gaussians, one by one, and differences against subtraction."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from sacha_core.avatar.binding import initial_gaussians
from sacha_core.avatar.gaussians import Gaussians
from sacha_core.density.events import Calibration, Pruning
from sacha_core.density.scores_file import Scores
from sacha_core.regions.partition import Partition
from sacha_core.scene.avatar_views import Shown, avatar_table, avatar_views, measures_of
from sacha_core.scene.measures import Measure, areas_cm2, view_of
from sacha_core.scene.missing import missing_views
from sacha_core.scene.palettes import MIDDLE
from sacha_core.scene.region_table import whole_bytes

F, R, N = 12, 3, 60
SINGLE = 1e-6  # values are float32
REGIONS = Partition("paper", ("a", "b", "none"), ((1, 2, 3), (4, 5, 6), (7, 8, 9)), (np.arange(F) % 2).astype(np.uint8))


def gaussians_of(seed: int, n: int = N, learned: bool = True) -> Gaussians:
    rng = np.random.default_rng(seed)
    made = initial_gaussians(F, rng, 0).select(rng.integers(1, F, n))  # none on the first triangle
    logits = rng.normal(0, 1, n).astype(np.float32)
    return replace(made, opacity_logit=logits, sensitivity_logit=-logits if learned else None)


def calibration(numbers: tuple[float | None, ...]) -> Calibration:
    none, counts = (None,) * R, (0,) * R
    return Calibration(7, counts, counts, none, none, none, None, None, None, numbers, numbers, numbers, "plain")


def scores_of(gaussians: Gaussians, *events: Calibration | Pruning, scheme: str = "paper") -> Scores:
    return Scores(gaussians, np.ones(len(gaussians)), F, scheme, events)


def by_name(measures: list[Measure]) -> dict[str, Measure]:
    return {measure.name: measure for measure in measures}


AREA = np.linspace(0, 2, F)  # the first has none


def sums(gaussians: Gaussians, of: Callable[[int], float]) -> tuple[list[float], list[float]]:
    """Add up a number of every Gaussian, by triangle and by region."""
    triangles, regions = [0.0] * F, [0.0] * R
    for row, face in enumerate(gaussians.binding.tolist()):
        triangles[face] += of(row)
        regions[face % 2] += of(row)
    return triangles, regions


def test_counts_densities_opacities_and_sensitivities_are_those_of_a_loop() -> None:
    gaussians = gaussians_of(1)
    found = by_name(measures_of(Shown("x", gaussians), AREA, REGIONS))
    count, count_of = sums(gaussians, lambda _: 1)
    assert found["count"].values.tolist() == count
    assert found["count"].values.dtype == np.int32
    assert found["count"].by_region is not None
    assert found["count"].by_region.tolist() == count_of
    for name, logit in (("opacity", gaussians.opacity_logit), ("sensitivity", gaussians.sensitivity_logit)):
        assert logit is not None
        mass, mass_of = sums(gaussians, lambda row, logit=logit: 1 / (1 + math.exp(-logit[row])))  # type: ignore[misc]
        if name == "sensitivity":  # a mean, and none where there is nothing
            mass = [m / c if c else math.nan for m, c in zip(mass, count, strict=True)]
            mass_of = [m / c if c else math.nan for m, c in zip(mass_of, count_of, strict=True)]
        assert found[name].values == pytest.approx(mass, rel=SINGLE, nan_ok=True)
        assert found[name].by_region == pytest.approx(mass_of, rel=SINGLE, nan_ok=True)
    density = [c / a if a else math.nan for c, a in zip(count, AREA.tolist(), strict=True)]
    assert found["density"].values == pytest.approx(density, rel=SINGLE, nan_ok=True)
    areas = [AREA[0::2].sum(), AREA[1::2].sum(), 0]
    expected = [c / a if a else math.nan for c, a in zip(count_of, areas, strict=True)]
    assert found["density"].by_region == pytest.approx(expected, rel=SINGLE, nan_ok=True)


def test_the_last_calibration_tells_modulators_thresholds_and_ratios() -> None:
    gaussians = gaussians_of(2, learned=False)
    scores = scores_of(gaussians_of(3), calibration((9.0,) * R), calibration((0.5, 2.0, None)))
    found = by_name(measures_of(Shown("x", gaussians, scores), AREA, REGIONS))
    for name in ("modulator", "threshold", "ratio"):
        assert found[name].values.tolist() == [0.5, 2.0] * (F // 2)
        assert found[name].by_region == pytest.approx([0.5, 2.0, math.nan], nan_ok=True)
    assert "before pruning" in found["sensitivity"].about
    assert not missing_views(Shown("x", gaussians, scores, np.ones(F)), REGIONS)


def test_modulators_follow_from_sensitivities_where_there_is_no_calibration() -> None:
    gaussians = gaussians_of(4)
    found = by_name(measures_of(Shown("x", gaussians), AREA, REGIONS))
    assert gaussians.sensitivity_logit is not None
    learned = 1 / (1 + np.exp(-gaussians.sensitivity_logit.astype(float)))
    of = [learned[gaussians.binding % 2 == region].mean() for region in (0, 1)]
    assert found["modulator"].by_region == pytest.approx([learned.mean() / of[0], learned.mean() / of[1], 1.0])
    assert not {"threshold", "ratio"} & found.keys()
    missing = missing_views(Shown("x", gaussians), REGIONS)
    assert any("Threshold and pruning ratio" in line and "sacha score" in line for line in missing)
    assert any("Bytes" in line for line in missing)


def test_without_anything_to_go_by_views_are_absent_and_named() -> None:
    bare = Shown("x", gaussians_of(5, learned=False))
    assert set(by_name(measures_of(bare, AREA, REGIONS))) == {"count", "density", "opacity"}
    assert any(
        line.startswith("Sensitivity, modulator, threshold and pruning ratio") for line in missing_views(bare, REGIONS)
    )
    without = measures_of(Shown("x", gaussians_of(5)), AREA, None)
    assert {measure.name for measure in without} == {"count", "density", "opacity", "sensitivity"}
    assert all(measure.by_region is None for measure in without)
    assert all(view_of(measure).by_region == [] for measure in without)


def test_changes_are_here_less_there() -> None:
    here, there = (
        Shown(name, gaussians_of(seed), None, spent) for name, seed, spent in (("a", 6, AREA), ("b", 7, 2 * AREA))
    )
    now, then = (by_name(measures_of(shown, AREA, REGIONS)) for shown in (here, there))
    views = avatar_views(list(now.values()), list(then.values()))
    assert list(views) == [*now, *(f"{name}_change" for name in now)]
    for name, measure in now.items():
        change = views[f"{name}_change"]
        expected = measure.values.astype(float) - then[name].values.astype(float)
        assert change.values == pytest.approx(expected, rel=SINGLE, abs=SINGLE, nan_ok=True)
        assert np.array_equal(change.levels > MIDDLE, (expected > 0) & (change.levels != MIDDLE))
        assert (change.levels[np.isnan(expected)] == 0).all()
    assert views["count_change"].values.dtype == np.int32
    table = avatar_table(here, AREA, REGIONS, there)
    assert table.before is not None
    assert table.change is not None
    assert table.bytes_change is not None
    assert table.change.tolist() == (table.gaussians - table.before).tolist()
    assert table.bytes_change.sum() == round(AREA.sum()) - round(2 * AREA.sum())
    assert table.before_name == "b"
    swapped = avatar_views(list(then.values()), list(now.values()))
    assert np.array_equal(swapped["count_change"].values, -views["count_change"].values)


def test_scores_tell_what_there_was_before_pruning() -> None:
    before = gaussians_of(8)
    pruning = Pruning(9, "pis", "off", *((0,) * R,) * 4)
    for events, name in (((pruning,), "before pruning"), ((), "when scored")):
        table = avatar_table(Shown("x", before.select(np.arange(10)), scores_of(before, *events)), AREA, REGIONS, None)
        assert table.before is not None
        assert (table.before.sum(), table.gaussians.sum(), table.before_name) == (N, 10, name)


@pytest.mark.parametrize("scheme", ["mine", "wide-eyes"])
def test_a_calibration_of_other_regions_counts_for_nothing(scheme: str) -> None:
    gaussians = gaussians_of(2)
    shown = Shown("x", gaussians, scores_of(gaussians, calibration((0.5, 2.0, 1.0)), scheme=scheme))
    found = by_name(measures_of(shown, AREA, replace(REGIONS, name="mine")))
    assert not {"threshold", "ratio"} & found.keys()
    assert "modulator" in found
    assert any("Threshold" in line for line in missing_views(shown, replace(REGIONS, name="mine")))


def test_areas_are_halves_of_parallelograms() -> None:
    vertices = np.array([[0, 0, 0], [0.03, 0, 0], [0, 0.04, 0], [0, 0, 0.05]], np.float32)
    assert areas_cm2(vertices, np.array([[0, 1, 2], [0, 2, 3], [1, 1, 2]])) == pytest.approx([6, 10, 0], rel=SINGLE)


@given(st.lists(st.floats(0, 1e7), min_size=1, max_size=30))
def test_rounded_bytes_add_up_and_none_is_off_by_more_than_one(amounts: list[float]) -> None:
    rounded = whole_bytes(np.array(amounts))
    assert rounded.sum() == round(float(np.array(amounts).sum()))
    assert np.abs(rounded - np.array(amounts)).max() <= 1
