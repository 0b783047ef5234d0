"""The parts that the exact loss is made of, against SciPy and theorems; that it is what training computes, the matrix holds."""

from __future__ import annotations

import numpy as np
import pytest
import torch
from scipy.ndimage import correlate1d
from scipy.spatial.transform import Rotation

from sacha_core.avatar.motion import Motion
from sacha_core.bench.stability.exact_head import ExactHead, rotation_of
from sacha_core.bench.stability.exact_step import harmonics, quaternions, structural_similarity
from sacha_core.flame.posing import Poser
from sacha_core.flame.synthetic import synthetic_head
from sacha_core.geometry.triangle import triangle_frames

ROUNDING = 1e-12
FLAME_ANGLE = 3e-8  # FLAME's angle differs from the vector's length by up to sqrt(3) * 1e-8


def test_rotations_are_scipys() -> None:
    for vector in np.random.default_rng(0).normal(size=(20, 3)) * np.geomspace(1e-7, 6, 20)[:, None]:
        expected = Rotation.from_rotvec(vector).as_matrix()
        np.testing.assert_allclose(rotation_of(torch.from_numpy(vector)), expected, atol=FLAME_ANGLE)


def test_quaternions_are_scipys_up_to_sign() -> None:
    turns = Rotation.random(200, rng=np.random.default_rng(1))
    found = quaternions(torch.from_numpy(turns.as_matrix())).numpy()
    expected = turns.as_quat()[:, [3, 0, 1, 2]]
    np.testing.assert_allclose(found * np.sign((found * expected).sum(1, keepdims=True)), expected, atol=ROUNDING)


def test_harmonics_are_orthonormal_on_the_sphere() -> None:
    """By Gauss-Legendre quadrature, exact for polynomials of this degree; and the first of each degree has the published sign."""
    nodes, weights = np.polynomial.legendre.leggauss(8)
    angles = 2 * np.pi * np.arange(16) / 16
    z, phi = (grid.ravel() for grid in np.meshgrid(nodes, angles, indexing="ij"))
    across = np.sqrt(1 - z**2)
    basis = harmonics(torch.from_numpy(np.stack([across * np.cos(phi), across * np.sin(phi), z], 1)), 3).numpy()
    area = np.repeat(weights, len(angles)) * 2 * np.pi / len(angles)
    np.testing.assert_allclose(np.einsum("nk,nl,n->kl", basis, basis, area), np.eye(16), atol=ROUNDING)
    along_z = harmonics(torch.tensor([[0.0, 0, 1]], dtype=torch.float64), 3)[0]
    assert [k for k in range(16) if along_z[k] != 0] == [0, 2, 6, 12]
    diagonal = harmonics(torch.tensor([[0.6, 0.48, 0.64]], dtype=torch.float64), 1)[0]
    assert [float(torch.sign(value)) for value in diagonal] == [1, -1, 1, -1]


def test_similarity_is_scipys_filter_in_the_published_formula() -> None:
    rng = np.random.default_rng(2)
    image, wanted = rng.random((2, 3, 21, 17))
    taps = np.exp(-(np.arange(-5, 6) ** 2) / (2 * 1.5**2))

    def blur(planes: np.ndarray) -> np.ndarray:
        for axis in (1, 2):
            planes = correlate1d(planes, taps / taps.sum(), axis=axis, mode="constant")
        return planes

    x, y = blur(image), blur(wanted)
    xx, yy, xy = blur(image**2) - x * x, blur(wanted**2) - y * y, blur(image * wanted) - x * y
    expected = ((2 * x * y + 1e-4) * (2 * xy + 9e-4) / ((x * x + y * y + 1e-4) * (xx + yy + 9e-4))).mean()
    found = structural_similarity(torch.from_numpy(image), torch.from_numpy(wanted))
    assert float(found) == pytest.approx(expected, abs=ROUNDING)


@pytest.mark.parametrize("n_expressions", [0, 5, 60])
def test_the_head_is_the_posers_in_float64(n_expressions: int) -> None:
    head, rng = synthetic_head("small"), np.random.default_rng(3)
    used = min(n_expressions, head.exprdirs.shape[2])
    expression = np.zeros((1, n_expressions), np.float32)
    expression[0, :used] = rng.normal(size=used)
    parts = {name: rng.normal(size=(1, width)).astype(np.float32) for name, width in (("rotation", 3), ("neck", 3), ("jaw", 3), ("eyes", 6), ("translation", 3))}  # fmt: skip  # noqa: E501
    offsets = rng.normal(0, 1e-3, (head.n_vertices, 3)).astype(np.float32)
    motion = Motion(rng.normal(size=4).astype(np.float32), offsets, expression, **parts)
    leaves = {
        name: torch.from_numpy(part[0].astype(np.float64)) for name, part in {**parts, "expression": expression}.items()
    }
    exact = ExactHead(head, motion)
    vertices = exact.vertices(leaves)
    np.testing.assert_allclose(vertices, Poser(head, motion, np.float64)(0), atol=ROUNDING)
    rotation, scale, origin = exact.frames(vertices)
    frames = triangle_frames(vertices.numpy(), head.faces)
    np.testing.assert_allclose(rotation, frames.rotation, atol=1e-9)  # slivers magnify rounding
    np.testing.assert_allclose(scale, frames.scale, rtol=1e-9)
    np.testing.assert_allclose(origin, frames.origin, atol=ROUNDING)
