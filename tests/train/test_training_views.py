"""Training views: what they hold, in what order they come."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from sacha_core.perception.sensitivity_map import sensitivity_map
from sacha_core.progress import Progress
from sacha_core.raster.pool import Pool
from sacha_core.train.views import TrainingViews, box_of, epoch_order, spread_views


def test_a_target_is_the_image_its_map_and_the_box_around_both(tiny) -> None:
    target = TrainingViews(tiny.capture)[3]
    image = tiny.capture.image(tiny.capture.train[3])
    assert np.array_equal(target.image, image.transpose(2, 0, 1))
    assert np.array_equal(target.sensitivity == 255, sensitivity_map(image))
    left, top, right, bottom = target.box
    outside = np.ones(image.shape[:2], bool)
    outside[top:bottom, left:right] = False
    assert (image[outside] == 255).all()
    assert not target.sensitivity[outside].any()


def test_maps_are_made_at_the_stored_resolution_and_shrunk_with_the_image(tiny) -> None:
    target = TrainingViews(tiny.capture, 24, 24)[0]
    assert target.image.shape == (3, 24, 24)
    assert target.sensitivity.shape == (24, 24)
    assert (target.camera.width, target.camera.fx) == (24, tiny.capture.train[0].camera.fx / 2)
    stored = sensitivity_map(tiny.capture.image(tiny.capture.train[0]))
    assert target.sensitivity.mean() / 255 == pytest.approx(stored.mean(), abs=0.05)  # bicubic overshoot is cut off


def test_the_cache_holds_no_more_than_it_may(tiny) -> None:
    one = 4 * 48 * 48
    views = TrainingViews(tiny.capture, cache_bytes=3 * one)
    seen: list[Progress] = []
    views.preload(Pool(2), seen.append)
    assert sum(views[i] is views[i] for i in range(len(views))) == 3
    assert {progress.stage for progress in seen} <= {"read images"}
    assert np.array_equal(views[11].image, TrainingViews(tiny.capture)[11].image)


@given(st.integers(1, 60), st.integers(0, 5), st.integers(0, 5))
def test_an_epoch_shows_every_view_once_in_an_order_of_its_own(n_views, seed, epoch) -> None:
    order = epoch_order(n_views, seed, epoch)
    assert sorted(order) == list(range(n_views))
    assert np.array_equal(order, epoch_order(n_views, seed, epoch))
    if n_views > 20:
        assert not np.array_equal(order, epoch_order(n_views, seed, epoch + 1))
        assert not np.array_equal(order, epoch_order(n_views, seed + 1, epoch))


@given(st.integers(1, 40), st.integers(1, 7), st.integers(1, 400))
def test_views_are_spread_over_the_motion_and_every_camera_looks_at_all_of_it(tiny, timesteps, cameras, count) -> None:
    one = tiny.capture.train[0]
    order = np.random.default_rng(timesteps).permutation(timesteps * cameras)
    views = tuple(replace(one, timestep=int(i) // cameras * 3, camera_index=int(i) % cameras) for i in order)
    places = [(views[i].timestep // 3, views[i].camera_index) for i in spread_views(views, count)]
    assert places == sorted(set(places))
    seen = sorted({timestep for timestep, _ in places})
    assert places == [(timestep, camera) for timestep in seen for camera in range(cameras)]
    assert abs(len(places) - min(count, len(views))) <= max(cameras / 2, cameras - count)
    assert seen[0] == 0
    if len(seen) > 1:
        assert seen[-1] == timesteps - 1
        assert max(np.diff(seen)) - min(np.diff(seen)) <= 1


def test_a_box_of_nothing_is_empty() -> None:
    assert box_of(np.zeros((4, 5), bool)) == (0, 0, 0, 0)
    one = np.zeros((4, 5), bool)
    one[2, 3] = True
    assert box_of(one) == (3, 2, 4, 3)
