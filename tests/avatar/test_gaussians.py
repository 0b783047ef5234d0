"""Laws of subsetting, and every check with the message that it promises."""

from __future__ import annotations

from dataclasses import fields, replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from sacha_core.avatar.binding import initial_gaussians
from sacha_core.avatar.gaussians import Gaussians
from sacha_core.avatar.motion import Motion
from sacha_core.errors import FormatError


def numbered(n: int) -> Gaussians:
    """Gaussians that carry their row in every attribute."""
    rows = np.arange(n, dtype=np.float32)
    start = initial_gaussians(n, np.random.default_rng(0))
    return replace(
        start,
        **{
            f.name: np.broadcast_to(
                rows.reshape(-1, *[1] * (getattr(start, f.name).ndim - 1)), getattr(start, f.name).shape
            )
            for f in fields(Gaussians)
            if f.name not in {"binding", "sensitivity_logit"}
        },
        sensitivity_logit=rows,
    )


@given(st.lists(st.integers(0, 9), max_size=15))
def test_selecting_rows_takes_every_attribute_along(rows: list[int]) -> None:
    picked = numbered(10).select(np.array(rows, np.int64))
    assert len(picked) == len(rows)
    for f in fields(Gaussians):
        value = getattr(picked, f.name)
        np.testing.assert_array_equal(
            value.reshape(len(rows), -1)[:, 0] if value.size else value, rows if value.size else value
        )


def test_a_mask_selects_like_its_indices() -> None:
    keep = np.random.default_rng(0).random(10) < 0.5
    np.testing.assert_array_equal(
        numbered(10).select(keep).position, numbered(10).select(np.flatnonzero(keep)).position
    )


def test_selecting_twice_is_selecting_the_selection() -> None:
    first, second = np.array([7, 3, 3, 1]), np.array([2, 0])
    np.testing.assert_array_equal(
        numbered(10).select(first).select(second).binding, numbered(10).select(first[second]).binding
    )


def test_attributes_that_are_missing_stay_missing() -> None:
    assert initial_gaussians(4, np.random.default_rng(0)).select(np.array([1])).sensitivity_logit is None


@pytest.mark.parametrize("n", [0, 1, 10])
def test_sound_gaussians_pass(n: int) -> None:
    numbered(n).validate(max(n, 1))


@pytest.mark.parametrize("name", [f.name for f in fields(Gaussians) if f.name != "binding"])
@pytest.mark.parametrize("poison", [np.nan, np.inf, -np.inf])
def test_numbers_that_are_not_finite(name: str, poison: float) -> None:
    gaussians = numbered(10)
    value = getattr(gaussians, name).copy()
    value[(6, *[-1] * (value.ndim - 1))] = poison
    with pytest.raises(FormatError, match=f"{name} of Gaussian 6 is not finite"):
        replace(gaussians, **{name: value}).validate(10)


@pytest.mark.wrong_shapes
def test_rows_that_disagree() -> None:
    with pytest.raises(FormatError, match=r"opacity_logit has 9 rows, expected 10"):
        replace(numbered(10), opacity_logit=np.zeros(9, np.float32)).validate(10)


def test_coefficients_of_no_degree() -> None:
    with pytest.raises(FormatError, match="sh_rest has 7 coefficients, expected 0, 3, 8 or 15"):
        replace(numbered(10), sh_rest=np.zeros((10, 7, 3), np.float32)).validate(10)


@pytest.mark.parametrize("n_frames", [0, 1, 3])
def test_rest_is_a_motion(n_frames: int) -> None:
    motion = Motion.rest(5, 7, n_frames)
    motion.validate()
    assert len(motion) == n_frames
    assert motion.eyes.shape == (n_frames, 6)


@pytest.mark.parametrize("name", ["shape", "static_offset", "expression", "jaw", "eyes", "translation"])
def test_motions_that_are_not_finite(name: str) -> None:
    motion = replace(Motion.rest(5, 7, 4), static_offset=np.zeros((9, 3), np.float32))
    value = getattr(motion, name).copy()
    value[2] = np.nan
    with pytest.raises(FormatError, match=f"motion parameter {name} is not finite at row 2"):
        replace(motion, **{name: value}).validate()


@pytest.mark.parametrize("name", ["shape", "static_offset", "expression", "jaw", "eyes", "translation"])
def test_motions_beyond_any_head(name: str) -> None:
    motion = replace(Motion.rest(5, 7, 4), static_offset=np.zeros((9, 3), np.float32))
    value = getattr(motion, name).copy()
    value[2] = -(2.0**30)
    replace(motion, **{name: value}).validate()
    value[2:] = -1e30
    with pytest.raises(FormatError, match=rf"motion parameter {name} is 1e\+30 at row 2, expected at most 1.07"):
        replace(motion, **{name: value}).validate()


@pytest.mark.parametrize("rate", [0.0, -1.0, np.nan, np.inf, 1001.0])
def test_frame_rates_that_are_none(rate: float) -> None:
    with pytest.raises(FormatError, match="is not between 0 and 1000 frames a second"):
        Motion.rest(1, 1, frame_rate=rate).validate()


@pytest.mark.wrong_shapes
def test_frames_that_disagree() -> None:
    with pytest.raises(FormatError, match="motion parameter neck has 3 frames, expected 4"):
        replace(Motion.rest(1, 1, 4), neck=np.zeros((3, 3), np.float32)).validate()


@pytest.mark.wrong_shapes
@pytest.mark.parametrize(
    "name", ["position", "log_scale", "quaternion", "opacity_logit", "sh_dc", "sh_rest", "binding"]
)
def test_validate_names_the_attribute_of_another_shape(name):
    gaussians = numbered(4)
    array = getattr(gaussians, name)
    with pytest.raises(FormatError, match=rf"{name} has shape \(4, .*, expected \(rows"):
        replace(gaussians, **{name: np.repeat(array[..., None], 2, axis=-1)}).validate(10)


@pytest.mark.wrong_shapes
@pytest.mark.parametrize(
    ("name", "shape"), [("rotation", (4, 4)), ("eyes", (4, 3)), ("static_offset", (5, 2)), ("shape", (2, 1))]
)
def test_validate_names_the_parameter_of_another_shape(name, shape):
    motion = replace(Motion.rest(2, 3, 4), **{name: np.zeros(shape, np.float32)})
    with pytest.raises(FormatError, match=rf"motion parameter {name} has shape .*, expected \(rows"):
        motion.validate()
