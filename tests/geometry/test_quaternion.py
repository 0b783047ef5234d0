"""Oracle: SciPy's Rotation; laws: group homomorphism, sign convention, dtype."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

from sacha_core.geometry import quaternion
from sacha_core.geometry.rotation import ANGLE_OFFSET_RAD, rotation_vectors_to_matrices

ROUNDING_64 = 1e-14  # a few dozen operations of float64 on numbers of size one
ROUNDING_32 = 2e-6  # the same in float32
FLAME_ANGLE = 3e-8  # FLAME's angle differs from the vector's length by up to sqrt(3) * 1e-8


def random_quaternions(seed: int, n: int = 200) -> np.ndarray:
    return np.random.default_rng(seed).normal(size=(n, 4))


def scipy_rotation(q: np.ndarray) -> Rotation:
    return Rotation.from_quat(q[..., [1, 2, 3, 0]])


def test_matrix_is_scipys() -> None:
    q = random_quaternions(0)
    np.testing.assert_allclose(quaternion.to_matrix(q), scipy_rotation(q).as_matrix(), atol=ROUNDING_64)


def test_product_is_scipys_composition() -> None:
    a, b = quaternion.normalise(random_quaternions(1)), quaternion.normalise(random_quaternions(2))
    np.testing.assert_allclose(
        quaternion.to_matrix(quaternion.multiply(a, b)),
        (scipy_rotation(a) * scipy_rotation(b)).as_matrix(),
        atol=ROUNDING_64,
    )


def test_from_matrix_inverts_to_matrix_up_to_sign_with_largest_component_positive() -> None:
    q = quaternion.normalise(random_quaternions(3, 2000))
    back = quaternion.from_matrix(quaternion.to_matrix(q))
    np.testing.assert_allclose(back * np.sign(np.sum(back * q, axis=1, keepdims=True)), q, atol=ROUNDING_64)
    assert (back[np.arange(len(q)), np.abs(back).argmax(axis=1)] > 0).all()


@pytest.mark.parametrize("axis", range(3))
def test_half_turns_where_w_vanishes(axis: int) -> None:
    rotation = -np.eye(3)
    rotation[axis, axis] = 1
    expected = np.zeros(4)
    expected[1 + axis] = 1
    np.testing.assert_array_equal(quaternion.from_matrix(rotation), expected)


@given(
    st.lists(st.floats(-1e3, 1e3), min_size=4, max_size=4).filter(lambda q: np.linalg.norm(q) > 1e-3),
    st.floats(1e-3, 1e3),
)
def test_direction_is_all_that_counts(q: list[float], factor: float) -> None:
    a = np.array(q)
    np.testing.assert_allclose(quaternion.to_matrix(a), quaternion.to_matrix(a * factor), atol=ROUNDING_64)
    assert abs(np.linalg.norm(quaternion.normalise(a)) - 1) < ROUNDING_64


def test_zero_quaternion_stays_finite() -> None:
    assert np.array_equal(quaternion.normalise(np.zeros((1, 4), np.float32)), np.zeros((1, 4)))


def test_float32_is_kept_and_agrees_with_float64() -> None:
    q = random_quaternions(4).astype(np.float32)
    for function in (quaternion.normalise, quaternion.to_matrix, lambda x: quaternion.multiply(x, x)):
        single = function(q)
        assert single.dtype == np.float32
        np.testing.assert_allclose(single, function(q.astype(np.float64)), rtol=ROUNDING_32, atol=ROUNDING_32)
    assert quaternion.from_matrix(quaternion.to_matrix(q)).dtype == np.float32


def test_empty_batches() -> None:
    assert quaternion.from_matrix(np.zeros((0, 3, 3))).shape == (0, 4)
    assert quaternion.multiply(np.zeros((0, 4)), np.zeros((0, 4))).shape == (0, 4)


def test_rotation_vectors_are_scipys() -> None:
    v = np.random.default_rng(5).normal(size=(300, 3)) * np.geomspace(1e-6, 3, 300)[:, None]
    np.testing.assert_allclose(rotation_vectors_to_matrices(v), Rotation.from_rotvec(v).as_matrix(), atol=FLAME_ANGLE)


@pytest.mark.parametrize("dtype", [np.float32, np.float64])
def test_a_vector_that_cancels_the_offset_hardly_turns(dtype: type) -> None:
    vector = np.full((1, 3), -dtype(ANGLE_OFFSET_RAD))
    np.testing.assert_allclose(rotation_vectors_to_matrices(vector)[0], np.eye(3), atol=FLAME_ANGLE)


def test_rotation_vector_zero_is_the_identity_in_both_precisions() -> None:
    for dtype in (np.float32, np.float64):
        matrix = rotation_vectors_to_matrices(np.zeros((2, 3), dtype))
        assert matrix.dtype == dtype
        np.testing.assert_array_equal(matrix, np.broadcast_to(np.eye(3), (2, 3, 3)))
