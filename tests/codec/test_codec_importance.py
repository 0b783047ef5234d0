"""Importance handed to the encoder: rows follow the Gaussians', and what cannot be theirs is refused."""

from __future__ import annotations

from dataclasses import fields, replace

import numpy as np
import pytest

from sacha_core.codec.importance import GaussianImportance
from sacha_core.codec.rotation import sort_axes
from sacha_core.errors import FormatError


def importance_of(n: int, k: int, seed: int = 0) -> GaussianImportance:
    rng = np.random.default_rng(seed)
    shapes = {"opacity": (n,), "sh_rest": (n, k, 3), "colour_metric": (n, k + 1, k + 1)}
    return GaussianImportance(**{f.name: rng.random(shapes.get(f.name, (n, 3))) for f in fields(GaussianImportance)})


def test_rows_are_selected_in_every_attribute() -> None:
    given, rows = importance_of(9, 8), np.array([4, 0, 7])
    found = given.select(rows)
    assert len(found) == 3
    for f in fields(given):
        np.testing.assert_array_equal(getattr(found, f.name), getattr(given, f.name)[rows])


def test_axes_follow_those_of_the_sorted_gaussian() -> None:
    """Oracle: `sort_axes` itself, given what is to be sorted as the log-scales."""
    given = importance_of(50, 0)
    order = np.argsort(-given.log_scale, axis=1, kind="stable")
    found = given.with_axes(order)
    np.testing.assert_array_equal(found.log_scale, sort_axes(given.log_scale, np.eye(4)[np.zeros(50, int)])[0])
    np.testing.assert_array_equal(np.sort(found.rotation, axis=1), np.sort(given.rotation, axis=1))
    np.testing.assert_array_equal(found.position, given.position)


@pytest.mark.parametrize(
    ("change", "said"),
    [
        ({"opacity": np.zeros(4)}, "importance opacity has 4 rows, expected 5"),
        ({"position": np.zeros((5, 2))}, r"importance position has shape \(5, 2\)"),
        ({"opacity": np.array([0, 0, np.nan, 0, 0])}, "importance opacity of Gaussian 2 is negative or not finite"),
        ({"sh_dc": np.full((5, 3), -1.0)}, "importance sh_dc of Gaussian 0 is negative or not finite"),
        ({"sh_rest": np.zeros((5, 3, 3))}, "importance sh_rest is of 3 coefficients, expected 8"),
        ({"colour_metric": np.zeros((5, 4, 4))}, r"importance colour_metric is of \(4, 4\), expected \(9, 9\)"),
    ],
)
def test_what_is_not_of_these_gaussians_is_refused(change: dict[str, np.ndarray], said: str) -> None:
    good = importance_of(5, 8)
    good.validate(5, 8)
    replace(good, colour_metric=None).select(np.arange(4)).validate(4, 8)
    with pytest.raises(FormatError, match=said):
        replace(good, **change).validate(5, 8)
