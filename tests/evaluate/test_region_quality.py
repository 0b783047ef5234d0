"""Decibels by region: by hand from a known difference, and where only one region was touched."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from sacha_core.avatar.binding import initial_gaussians
from sacha_core.evaluate.region_quality import decibels, own_region_psnr
from sacha_core.flame.synthetic import synthetic_head
from sacha_core.regions.partition import partition_by

HEAD = synthetic_head("small")
REGIONS = partition_by(HEAD)
SIZE = (96, 140)


def test_decibels_are_those_of_the_mean_squared_error() -> None:
    found = decibels(np.array([3 * 100 * 0.01, 0.0, 0.0]), np.array([100.0, 5.0, 0.0]))
    assert found[0] == pytest.approx(20, abs=1e-9)
    assert found[1:] == (None, None)


def test_the_region_that_was_touched_is_the_farthest_off_and_what_is_the_same_has_no_decibels() -> None:
    gaussians = initial_gaussians(HEAD.n_faces, np.random.default_rng(0), 0)
    gaussians = replace(gaussians, opacity_logit=np.full(len(gaussians), 3, np.float32))
    nose = REGIONS.label("nose")
    touched = gaussians.sh_dc.copy()
    touched[REGIONS.labels[gaussians.binding] == nose] += 1.5
    told: list[int] = []
    both = (gaussians, replace(gaussians, sh_dc=touched))
    same, found = own_region_psnr(
        gaussians, both, HEAD, None, REGIONS, 16, SIZE, report=lambda progress: told.append(progress.done)
    )
    assert same == (None,) * len(REGIONS.regions)
    known = [value for value in found if value is not None]
    assert found[nose] == min(known)
    assert told == list(range(1, 17))
