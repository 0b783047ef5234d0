"""What numbers are worth to pictures, against derivatives by finite differences of drawing the avatar itself."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import fields, replace

import numpy as np
import pytest

from sacha_core.avatar.avatar import Avatar
from sacha_core.avatar.gaussians import Gaussians
from sacha_core.flame.model import HeadModel
from sacha_core.geometry.quaternion import multiply
from sacha_core.geometry.triangle import triangle_frames
from sacha_core.raster.camera import Camera
from sacha_core.raster.rasteriser import Rasteriser
from sacha_core.raster.scene import render_avatar
from sacha_core.rate.curvature import importance_of, measure_importance
from sacha_core.rate.stances import Stance
from sacha_core.rate.views import Shot

TIMES = 600  # the same view, each with signs of its own: the estimate's relative error is sqrt(2 / 600) = 0.06
SPREAD = 0.35  # six of those
BIAS = 0.05  # of the mean over all numbers: chance, and what pixels at edges add to the differences
STEP = 2e-2  # of central differences: a pixel that drops below 1/255 at the edge adds (1/255 / 4e-2)^2 = 0.01
EXACT = 0.02  # of what is measured without chance, for that reason and where an edge at 1/255 moved


def scene(head: HeadModel) -> tuple[Gaussians, Shot]:
    """Ten Gaussians before the face, and the camera that looks at them from near."""
    n, rng = 10, np.random.default_rng(3)
    frames = triangle_frames(head.v_template, head.faces)
    front = np.argsort(-frames.origin[:, 2])[:n].astype(np.int32)
    f4 = np.float32
    gaussians = Gaussians(
        position=rng.normal(0, 0.5, (n, 3)).astype(f4),
        log_scale=(np.log(0.006 / frames.scale[front])[:, None] + rng.normal(0, 0.4, (n, 3))).astype(f4),
        quaternion=rng.normal(0, 1, (n, 4)).astype(f4),
        opacity_logit=rng.uniform(-1, 1.5, n).astype(f4),
        sh_dc=rng.uniform(-0.5, 1, (n, 3)).astype(f4),
        sh_rest=rng.normal(0, 0.1, (n, 3, 3)).astype(f4),
        binding=front,
    )
    middle = frames.origin[front].mean(axis=0).astype(np.float64)
    camera = Camera.look_at(middle + np.array([0.1, 0.05, 0.5]), middle, 28, 28, 300.0)
    return gaussians, Shot(Stance(frames), (camera,))


def turned(gaussians: Gaussians, axis: int, by: np.ndarray) -> Gaussians:
    turn = np.zeros((len(gaussians), 4))
    turn[:, 0], turn[:, 1 + axis] = np.cos(by / 2), np.sin(by / 2)
    unit = gaussians.quaternion / np.linalg.norm(gaussians.quaternion, axis=1, keepdims=True)
    return replace(gaussians, quaternion=multiply(unit.astype(np.float64), turn).astype(np.float32))


def faded(gaussians: Gaussians, by: np.ndarray) -> Gaussians:
    theta = np.arctan(np.exp(gaussians.opacity_logit.astype(np.float64) / 2)) + by
    return replace(gaussians, opacity_logit=(2 * np.log(np.tan(theta))).astype(np.float32))


def moved(gaussians: Gaussians, name: str, at: tuple[int, ...], by: np.ndarray) -> Gaussians:
    value = getattr(gaussians, name).copy()
    value[(slice(None), *at)] += by.astype(np.float32)
    return replace(gaussians, **{name: value})


def changes() -> dict[str, list[tuple[tuple[int, ...], Callable[[Gaussians, np.ndarray], Gaussians]]]]:
    """Give for each importance its components, and how to change one of them."""
    plain = {"position": (3,), "log_scale": (3,), "sh_dc": (3,), "sh_rest": (3, 3)}
    found = {
        name: [(at, lambda g, by, name=name, at=at: moved(g, name, at, by)) for at in np.ndindex(shape)]
        for name, shape in plain.items()
    }
    found["rotation"] = [((axis,), lambda g, by, axis=axis: turned(g, axis, by)) for axis in range(3)]
    found["opacity"] = [((), faded)]
    return found


def test_estimates_are_squares_of_derivatives(head: HeadModel, rasteriser: Rasteriser) -> None:
    """Oracle: central differences of the rendered picture by every number that is coded."""
    gaussians, shot = scene(head)
    found = measure_importance(gaussians, [shot] * TIMES, seed=1, rasteriser=rasteriser)
    ratios = []
    for name, components in changes().items():
        for at, change in components:
            expected = np.zeros(len(gaussians))
            for row in range(len(gaussians)):
                by = np.zeros(len(gaussians))
                by[row] = STEP
                up, down = (
                    render_avatar(change(gaussians, sign * by), shot.frames, shot.cameras[0], rasteriser=rasteriser)
                    .colour.astype(np.float64)
                    .copy()
                    for sign in (1, -1)
                )
                expected[row] = (((up - down) / (2 * STEP)) ** 2).sum()
            measured = getattr(found, name)[(slice(None), *at)]
            np.testing.assert_allclose(measured, expected, rtol=SPREAD, atol=0.02 * expected.max(), err_msg=name)
            ratios.append(measured.sum() / expected.sum())
    assert abs(np.mean(ratios) - 1) < BIAS


def test_the_metric_tells_what_changes_of_all_coefficients_cost(head: HeadModel, rasteriser: Rasteriser) -> None:
    """Oracle: pictures with the coefficients of one channel of one Gaussian changed at random."""
    gaussians, shot = scene(head)
    found = measure_importance(gaussians, [shot] * TIMES, seed=2, rasteriser=rasteriser)
    assert found.colour_metric is not None
    before = render_avatar(gaussians, shot.frames, shot.cameras[0], rasteriser=rasteriser).colour.astype(np.float64)
    rng = np.random.default_rng(0)
    for row in range(len(gaussians)):
        error = rng.normal(0, 0.05, 4).astype(np.float32)
        dc, rest = gaussians.sh_dc.copy(), gaussians.sh_rest.copy()
        dc[row, 1] += error[0]
        rest[row, :, 1] += error[1:]
        after = render_avatar(
            replace(gaussians, sh_dc=dc, sh_rest=rest), shot.frames, shot.cameras[0], rasteriser=rasteriser
        )
        expected = ((after.colour - before) ** 2).sum()
        assert error @ found.colour_metric[row] @ error == pytest.approx(expected, rel=SPREAD)


def test_an_avatar_is_measured_in_its_own_or_in_stock_poses(head: HeadModel) -> None:
    """The same bytes for the same seed; and a Gaussian that nobody can see is worth nothing."""
    gaussians, _ = scene(head)
    hidden = gaussians.opacity_logit.copy()
    hidden[4] = -8
    avatar = Avatar(replace(gaussians, opacity_logit=hidden), head.reference)
    found, again = importance_of(avatar, head), importance_of(avatar, head)
    found.validate(len(gaussians), 3)
    for f in fields(found):
        np.testing.assert_array_equal(getattr(found, f.name), getattr(again, f.name))
    assert found.opacity[4] == found.sh_dc[4].sum() == 0
    assert (np.delete(found.opacity, 4) > 0).all()
