"""The float64 compositor that others are held to, against loops that follow the definition literally, and against finite differences."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
import torch

from sacha_core.bench.exact import draw, leaves_of
from sacha_core.raster.camera import Camera
from sacha_core.raster.splats import Splats

ROUNDING = 1e-12  # float64, some tens of terms
SLOPE = 1e-7  # of central differences in float64, relative to the largest of their kind
STEP = 1e-5


def scene(seed: int, n: int, channels: int = 3, size: float = 0.05, spread: float = 0.15) -> Splats:
    rng = np.random.default_rng(seed)
    arrays = (
        rng.normal(size=(n, 3)) * spread,
        size * np.exp(rng.normal(size=(n, 3)) * 0.6),
        rng.normal(size=(n, 4)),
        rng.uniform(0.02, 1, n),
        rng.uniform(0, 1, (n, channels)),
    )
    return Splats(*(a.astype(np.float32) for a in arrays))


def view(width: int = 12, height: int = 17, focal: float = 18.0) -> Camera:
    looking = Camera.look_at(np.array([0.3, 0.2, 0.95]), np.array([0.01, -0.02, 0.0]), width, height, focal)
    return replace(looking, fy=1.1 * focal, cx=width / 2 + 1.3, cy=height / 2 - 0.7)


def depths_of(splats: Splats, camera: Camera) -> np.ndarray:
    return (splats.means @ camera.rotation[2] + camera.translation[2]).astype(np.float32)


def naive(splats: Splats, camera: Camera, background: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """One pixel and one Gaussian after the other."""
    means, scales, quaternions, opacities, colours = (
        np.asarray(a, np.float64)
        for a in (splats.means, splats.scales, splats.quaternions, splats.opacities, splats.colours)
    )
    projected = []
    left, right, top, bottom = camera.edges
    for g in np.argsort(depths_of(splats, camera), kind="stable"):
        x, y, z = camera.rotation @ means[g] + camera.translation
        if z <= 0.1:
            continue
        w, i, j, k = quaternions[g] / np.linalg.norm(quaternions[g])
        turn = np.array([
            [1 - 2 * (j * j + k * k), 2 * (i * j - w * k), 2 * (i * k + w * j)],
            [2 * (i * j + w * k), 1 - 2 * (i * i + k * k), 2 * (j * k - w * i)],
            [2 * (i * k - w * j), 2 * (j * k + w * i), 1 - 2 * (i * i + j * j)],
        ])  # fmt: skip
        shape = camera.rotation @ turn @ np.diag(scales[g] ** 2) @ turn.T @ camera.rotation.T
        slack_x, slack_y = 0.15 * (right - left), 0.15 * (bottom - top)
        u, v = np.clip(x / z, left - slack_x, right + slack_x), np.clip(y / z, top - slack_y, bottom + slack_y)
        jacobian = np.array([[camera.fx / z, 0, -camera.fx * u / z], [0, camera.fy / z, -camera.fy * v / z]])
        conic = np.linalg.inv(jacobian @ shape @ jacobian.T + 0.3 * np.eye(2))
        projected.append((g, camera.fx * x / z + camera.cx, camera.fy * y / z + camera.cy, conic))
    image = np.zeros((splats.channels, camera.height, camera.width))
    transmittance = np.ones((camera.height, camera.width))
    for row in range(camera.height):
        for column in range(camera.width):
            t = 1.0
            for g, mean_x, mean_y, conic in projected:
                d = np.array([column + 0.5 - mean_x, row + 0.5 - mean_y])
                alpha = opacities[g] * np.exp(-0.5 * d @ conic @ d)
                if alpha < 1 / 255:
                    continue
                alpha = min(alpha, 0.99)
                if t * (1 - alpha) <= 1e-4:
                    break
                image[:, row, column] += alpha * t * colours[g]
                t *= 1 - alpha
            image[:, row, column] += t * background
            transmittance[row, column] = t
    return image, transmittance


@pytest.mark.parametrize(("n", "size"), [(0, 0.05), (1, 0.05), (40, 0.05), (60, 0.3)])
def test_it_is_what_the_definition_says_pixel_by_pixel(n: int, size: float) -> None:
    splats, camera, background = scene(n, n, 3, size), view(), np.array([1.0, 0.4, 0.0])
    if n == 60:
        splats.opacities[:] = 0.9  # so that pixels close
    frame = draw(leaves_of(splats), camera, background, depths_of(splats, camera))
    image, transmittance = naive(splats, camera, background)
    np.testing.assert_allclose(frame.image, image, atol=ROUNDING)
    np.testing.assert_allclose(frame.transmittance, transmittance, atol=ROUNDING)
    assert (transmittance.min() < 2e-3) == (n == 60)


def test_a_crop_is_that_part_of_the_picture() -> None:
    splats, camera = scene(3, 30, 4, 0.3, 0.5), view()
    depths = depths_of(splats, camera)
    whole = draw(leaves_of(splats), camera, np.ones(4), depths)
    part = draw(leaves_of(splats), camera.crop(3, 5, 6, 7), np.ones(4), depths)
    assert not whole.decisions.follows.all()  # whose limits are the whole image's
    np.testing.assert_allclose(part.image, whole.image[:, 5:12, 3:9], atol=ROUNDING)
    np.testing.assert_allclose(part.band, whole.band[5:12, 3:9], atol=ROUNDING)


def test_what_cannot_be_a_splat_is_left_out_and_passes_no_gradient() -> None:
    good, camera = scene(4, 20), view()
    expected = draw(leaves_of(good), camera, np.ones(3), depths_of(good, camera)).image
    bad = Splats(*(np.concatenate([getattr(good, name), getattr(good, name)[:6]]) for name in vars(good)))
    bad.means[20], bad.scales[21], bad.quaternions[22], bad.opacities[23] = np.nan, np.inf, 0, 1e-3
    bad.scales[24], bad.means[25] = 1e6, camera.centre
    depths = np.nan_to_num(depths_of(bad, camera), nan=np.inf)
    leaves = leaves_of(bad, learn=True)
    frame = draw(leaves, camera, np.ones(3), depths)
    np.testing.assert_array_equal(frame.image.detach(), expected)
    frame.image.sum().backward()
    assert all(torch.isfinite(leaf.grad).all() and not leaf.grad[20:].any() for leaf in leaves.values())


def test_with_its_decisions_kept_it_is_smooth_and_has_the_same_gradient() -> None:
    """Theorem: the gradient of automatic differentiation is the limit of central differences, threshold or not."""
    splats, camera, background = scene(5, 25, 3, 0.2, 0.5), view(), np.array([1.0, 0.4, 0.0])
    splats.opacities[::2] = 0.995  # clamped in the middle, and pixels that close
    depths = depths_of(splats, camera)
    leaves = leaves_of(splats, learn=True)
    frame = draw(leaves, camera, background, depths)
    upstream = torch.from_numpy(np.random.default_rng(1).normal(size=frame.image.shape))
    (frame.image * upstream).sum().backward()
    assert frame.decisions.clamped.any()
    assert not frame.decisions.follows.all()

    def loss() -> float:
        with torch.no_grad():
            again = draw(leaves, camera, background, depths, decisions=frame.decisions)
        assert np.isinf(again.band).all()
        return float((again.image * upstream).sum())

    for name, leaf in leaves.items():
        flat, gradient = leaf.data.view(-1), leaf.grad.view(-1)
        for at in range(0, len(flat), 3):
            before, ends = float(flat[at]), []
            for sign in (1, -1):
                flat[at] = before + sign * STEP
                ends.append(loss())
            flat[at] = before
            slope = (ends[0] - ends[1]) / (2 * STEP)
            assert abs(slope - float(gradient[at])) < SLOPE * float(gradient.abs().max()), (name, at)
