"""Where `render` looks from. Oracle: projecting the head's box by hand."""

from __future__ import annotations

from itertools import product
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from sacha_core.avatar.motion import Motion
from sacha_core.cli.cameras import Extent, RoundTheHead, ThroughCapture, extent_of, round_the_head
from sacha_core.errors import OptionError
from sacha_core.interchange.capture import Capture, View
from sacha_core.raster.camera import Camera

ROUNDING = 1e-9  # of float64 sums of a few terms of order 1
HEAD = Extent(np.array([0.01, 1.5, -0.02]), np.array([0.09, 0.16, 0.12]))


def pixels(camera: Camera, points: np.ndarray) -> np.ndarray:
    seen = points @ camera.rotation.T + camera.translation
    return seen[:, :2] / seen[:, 2:] * (camera.fx, camera.fy) + (camera.cx, camera.cy)


@given(azimuth=st.floats(-180, 180), width=st.integers(64, 2000), height=st.integers(64, 2000))
def test_the_head_fits_from_every_side_and_fills_the_image(azimuth: float, width: int, height: int) -> None:
    camera = round_the_head(HEAD, width, height, azimuth)
    corners = HEAD.centre + np.array(list(product((-1, 1), repeat=3))) * HEAD.half_size
    middle = pixels(camera, HEAD.centre[None])
    np.testing.assert_allclose(middle, [[width / 2, height / 2]], atol=1e-6)
    ends = pixels(camera, HEAD.centre + np.array([[0, 1, 0], [0, -1, 0]]) * HEAD.half_size)
    assert 0 <= ends[:, 1].min() < ends[:, 1].max() <= height
    round_box = HEAD.centre + (corners - HEAD.centre) * (0.7, 1, 0.7)  # an ellipsoid does not reach its box's corners
    found = pixels(camera, round_box)
    assert found.min() >= 0
    assert (found <= (width, height)).all()
    front = pixels(round_the_head(HEAD, width, height), corners)
    assert max(np.ptp(front[:, 0]) / width, np.ptp(front[:, 1]) / height) > 0.6


def test_azimuth_ninety_stands_at_the_subjects_left_and_sees_up_as_up() -> None:
    camera = round_the_head(HEAD, 100, 100, azimuth_deg=90.0, distance=2.0)
    np.testing.assert_allclose(camera.centre, HEAD.centre + np.array([2, 0, 0]), atol=ROUNDING)
    above = pixels(camera, HEAD.centre[None] + (0, 0.1, 0))
    assert above[0, 1] < 50
    front = pixels(camera, HEAD.centre[None] + (0, 0, 0.1))  # the nose points to the left of this picture
    assert front[0, 0] < 50
    high = round_the_head(HEAD, 100, 100, elevation_deg=30.0, distance=2.0)
    np.testing.assert_allclose(high.centre, HEAD.centre + 2 * np.array([0, 0.5, np.sqrt(0.75)]), atol=ROUNDING)


@pytest.mark.parametrize(
    "wrong", [{"elevation_deg": 90.0}, {"distance": 0.05}, {"distance": -1.0}, {"focal": 0.0}, {"focal": -3.0}]
)
def test_impossible_cameras_are_refused(wrong: dict[str, float]) -> None:
    with pytest.raises(OptionError, match="--"):
        round_the_head(HEAD, 10, 10, **wrong)


def test_extent_leaves_out_strays_and_what_does_not_show() -> None:
    rng = np.random.default_rng(0)
    means = rng.uniform(-1, 1, (10_000, 3)).astype(np.float32)
    opacities = np.full(10_000, 0.5, np.float32)
    means[:5] = 50.0
    means[5:500] = -70.0
    opacities[5:500] = 0.01
    extent = extent_of(means, opacities)
    np.testing.assert_allclose(extent.centre, 0, atol=0.02)
    np.testing.assert_allclose(extent.half_size, 1, atol=0.02)
    faint = extent_of(means, opacities / 100)  # as after an opacity reset
    np.testing.assert_array_equal(faint.half_size, extent.half_size)
    with pytest.raises(OptionError, match="nothing to look at"):
        extent_of(means[:0], opacities[:0])


def test_cameras_travel_round_the_head() -> None:
    looking = RoundTheHead(HEAD, 20, 30, (0.0, 45.0))
    turned = looking.cameras(7, 45.0)
    np.testing.assert_allclose(turned[0].centre, looking.cameras(0, 0.0)[1].centre, atol=ROUNDING)
    assert (turned[1].width, turned[1].height) == (20, 30)


def test_a_captures_cameras_stand_where_they_stood_at_that_time() -> None:
    cameras = [Camera.look_at(np.array([0.0, 0.0, 1.0 + t]), np.zeros(3), 40, 60, 100.0) for t in range(3)]
    views = tuple(View(t, 8, camera, Path("x"), None) for t, camera in enumerate(cameras))
    capture = Capture(Path("data"), None, None, Motion.rest(0, 0, 3), views[:2], views[2:], ())
    looking = ThroughCapture(capture, (8,))
    assert looking.cameras(1, 0.0) == [cameras[1].resized(40, 60)]
    assert looking.cameras(99, 0.0)[0].translation is cameras[0].translation
    assert ThroughCapture(capture, (8,), 20, 30).cameras(0, 0.0)[0].fx == 50.0
    with pytest.raises(OptionError, match=r"--camera 3: data has the cameras 8"):
        ThroughCapture(capture, (3,)).cameras(0, 0.0)
