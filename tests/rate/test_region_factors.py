"""Errors that count more in some regions: the oracle are pictures of those regions, decoded."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from sacha_core.cli.encoding import region_factors
from sacha_core.codec import decode
from sacha_core.codec.levels import level_at
from sacha_core.errors import OptionError
from sacha_core.raster.scene import render_avatar
from sacha_core.rate.encoding import RenderingEncoder
from sacha_core.rate.views import protocol_shots
from sacha_core.regions.labels import label_triangles
from sacha_core.regions.partition import Partition
from sacha_core.regions.scheme import PAPER
from sacha_core.regions.scheme_file import write_scheme_file

FACTOR = 8
GAINED_DB = 1.0  # at least, in the region, at fewer bytes, on average: 3.6 over twelve such avatars, that differ by 2.6
FLOAT32 = 1e-5  # of a sigmoid in float32


@pytest.fixture(scope="module")
def avatar(matt_avatars):
    return matt_avatars[0]


def test_region_that_counts_more_looks_better_in_a_smaller_file(matt_avatars, head):
    gains_db = []
    for avatar in matt_avatars:
        factors = region_factors([f"mouth={FACTOR}"], avatar, head)
        mouth = label_triangles(head)[avatar.gaussians.binding] == PAPER.label("mouth")
        np.testing.assert_array_equal(factors, np.where(mouth, FACTOR, 1))
        plain = RenderingEncoder(avatar, head).encode(level_at(2.0)).data
        steered = RenderingEncoder(avatar, head, factors=factors).encode(level_at(1.6)).data
        assert len(steered) < len(plain)
        gains_db.append(
            10 * np.log10(error_within(mouth, avatar, head, plain) / error_within(mouth, avatar, head, steered))
        )
    assert np.mean(gains_db) > GAINED_DB


def error_within(marked, avatar, head, data):
    """Give the squared error of a file, summed over views, where the marked Gaussians are what is seen."""
    decoded, error = decode(data, head=head).gaussians, 0.0
    (shot, *_) = protocol_shots(avatar, head, 1, 0.5)
    for camera in shot.cameras[2:14:4]:
        colours = np.repeat(marked.astype(np.float32)[:, None], 3, axis=1)
        here = render_avatar(avatar.gaussians, shot.frames, camera, 0.0, colours=colours).colour[..., 0] > 0.5
        drawn, truth = (render_avatar(one, shot.frames, camera).colour[here] for one in (decoded, avatar.gaussians))
        error += ((drawn - truth) ** 2).mean()
    return error


@pytest.mark.parametrize("weight", ["mouth", "mouth=0", "chin=2", "mouth=nan"])
def test_what_is_no_weight_of_a_region_is_refused(avatar, head, weight):
    with pytest.raises(OptionError):
        region_factors([weight], avatar, head)


def test_no_weights_are_no_factors(avatar, head):
    assert region_factors([], avatar, head) is None


def test_learned_weights_are_one_over_the_modulators(avatar, head):
    """Oracle: equation 8 of the paper, region by region."""
    rng = np.random.default_rng(3)
    logits = rng.normal(0, 2, len(avatar.gaussians)).astype(np.float32)
    learned = replace(avatar, gaussians=replace(avatar.gaussians, sensitivity_logit=logits))
    regions, a = label_triangles(head)[avatar.gaussians.binding], 1 / (1 + np.exp(-logits.astype(np.float64)))
    expected = np.zeros(len(a))
    for region in np.unique(regions):
        expected[regions == region] = (a[regions == region].mean() / a.mean()) ** 2
    np.testing.assert_allclose(region_factors(["learned=2"], learned, head), expected, rtol=FLOAT32)
    np.testing.assert_array_equal(region_factors(["learned=0"], learned, head), 1)
    mouth = regions == PAPER.label("mouth")
    both = region_factors(["learned=2", "mouth=3"], learned, head)
    np.testing.assert_allclose(both, np.where(mouth, 3, 1) * expected, rtol=FLOAT32)


@pytest.mark.parametrize("weight", ["learned", "learned=much", "learned=-1", "learned=17"])
def test_what_was_not_learnt_is_no_weight(avatar, head, weight):
    with pytest.raises(OptionError, match="learned"):
        region_factors([weight], avatar, head)


def test_regions_of_ones_own_are_weighed_where_they_are_named(avatar, head, tmp_path):
    halves = Partition(
        "halves", ("low", "high"), ((9, 90, 200), (250, 20, 30)), (np.arange(head.n_faces) % 2).astype(np.uint8)
    )
    file = tmp_path / "halves.scheme.npz"
    write_scheme_file(file, halves)
    found = region_factors(["high=3"], avatar, head, file)
    np.testing.assert_array_equal(found, np.where(avatar.gaussians.binding % 2 == 1, 3, 1))
    with pytest.raises(OptionError, match="mouth"):
        region_factors(["mouth=3"], avatar, head, file)
    assert region_factors([], avatar, head, file) is None
