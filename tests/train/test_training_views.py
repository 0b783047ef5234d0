"""Training views: what they hold, in what order they come."""

from __future__ import annotations

import threading
from dataclasses import replace
from itertools import count

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from sacha_core.errors import DatasetError
from sacha_core.parallel.pool import Pool
from sacha_core.perception.sensitivity_map import sensitivity_map
from sacha_core.progress import Progress
from sacha_core.train.views import AHEAD, TrainingViews, box_of, decoded_ahead, epoch_steps, spread_views


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


@given(st.integers(1, 12), st.integers(1, 6), st.integers(1, 8), st.integers(0, 5), st.integers(0, 5))
def test_an_epoch_shows_every_view_once_in_an_order_of_its_own(tiny, timesteps, cameras, most, seed, epoch) -> None:
    views = tuple(
        replace(tiny.capture.train[0], timestep=t, camera_index=c) for t in range(timesteps) for c in range(cameras)
    )
    steps = epoch_steps(views, most, seed, epoch)
    assert sorted(index for step in steps for index in step) == list(range(len(views)))
    assert all(len({views[index].timestep for index in step}) == 1 for step in steps)
    sizes = [most] * (cameras // most) + [cameras % most] * (cameras % most > 0)
    assert sorted(map(len, steps)) == sorted(sizes * timesteps)
    assert steps == epoch_steps(views, most, seed, epoch)
    if len(steps) > 20:
        assert steps != epoch_steps(views, most, seed, epoch + 1)
        assert steps != epoch_steps(views, most, seed + 1, epoch)


def test_what_is_left_of_a_timestep_comes_anywhere_in_an_epoch(tiny) -> None:
    """And not behind its full steps, where every epoch would end with steps of few cameras."""
    views = tuple(replace(tiny.capture.train[0], timestep=t, camera_index=c) for t in range(6) for c in range(5))
    places = [
        place for epoch in range(50) for place, step in enumerate(epoch_steps(views, 4, 0, epoch)) if len(step) == 1
    ]
    assert np.bincount(places, minlength=12).min() > 0
    assert np.mean(places) == pytest.approx(5.5, abs=1.0)  # the middle; 300 places spread by 3.5 each


@pytest.mark.parametrize("room", [0, 3, 1 << 30], ids=["nothing kept", "some kept", "all kept"])
def test_decoding_ahead_gives_what_asking_gives_and_not_far_ahead(tiny, room) -> None:
    views, whole = TrainingViews(tiny.capture, cache_bytes=room * 4 * 48 * 48), TrainingViews(tiny.capture)
    steps = [(3,), (0, 1), (11,), (3,)] * 8
    asked = 0

    def counted():
        nonlocal asked
        for asked, step in enumerate(steps, 1):  # noqa: B007
            yield step

    for found, (step, targets) in enumerate(zip(steps, decoded_ahead(views, counted()), strict=True), 1):
        assert asked - found <= AHEAD
        for index, target in zip(step, targets, strict=True):
            assert np.array_equal(target.image, whole[index].image)
            assert (target.timestep, target.box) == (whole[index].timestep, whole[index].box)


def test_decoding_ahead_stops_with_whoever_asks_and_says_which_image_is_broken_when_its_turn_comes(
    tiny, tmp_path
) -> None:
    broken = tmp_path / "broken.png"
    broken.write_bytes(b"none")
    first, *others = tiny.capture.train
    capture = replace(tiny.capture, train=(replace(first, image_path=broken), *others))
    ahead = decoded_ahead(TrainingViews(capture, cache_bytes=0), iter([(1,), (0,), (2,)]))
    assert len(next(ahead)) == 1
    with pytest.raises(DatasetError, match=r"broken\.png"):
        next(ahead)
    endless = decoded_ahead(TrainingViews(tiny.capture, cache_bytes=0), ((i % 12,) for i in count()))
    next(endless)
    endless.close()
    for thread in threading.enumerate():
        if "sacha-decode" in thread.name:
            thread.join(timeout=10)
            assert not thread.is_alive()


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
