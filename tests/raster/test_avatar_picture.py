"""Pictures of avatars: binding, colours and drawing put together."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from sacha_core.avatar.binding import initial_gaussians, to_world
from sacha_core.avatar.gaussians import Gaussians
from sacha_core.errors import OptionError
from sacha_core.geometry.triangle import TriangleFrames, triangle_frames
from sacha_core.raster.camera import Camera
from sacha_core.raster.harmonics import sh_colours
from sacha_core.raster.rasteriser import Rasteriser
from sacha_core.raster.scene import render_avatar
from sacha_core.raster.splats import Splats

CAMERA = Camera.look_at(np.array([0.1, 0.1, 1.0]), np.zeros(3), 40, 50, 70.0)


def tetrahedron() -> tuple[Gaussians, TriangleFrames]:
    vertices = 0.05 * np.array([[1, 1, 1], [1, -1, -1], [-1, 1, -1], [-1, -1, 1]])
    frames = triangle_frames(vertices, np.array([[0, 1, 2], [0, 3, 1], [0, 2, 3], [1, 3, 2]]))
    rng = np.random.default_rng(0)
    gaussians = initial_gaussians(4, rng)
    opaque = np.full(4, 3.0, np.float32)
    sh_rest = rng.normal(size=gaussians.sh_rest.shape).astype(np.float32) * np.float32(0.3)
    return replace(gaussians, opacity_logit=opaque, log_scale=gaussians.log_scale - 1, sh_rest=sh_rest), frames


@pytest.mark.parametrize("degree", [None, 0, 2])
def test_picture_is_what_its_parts_give(degree: int | None) -> None:
    gaussians, frames = tetrahedron()
    picture = render_avatar(gaussians, frames, CAMERA, background=0.25, sh_degree=degree)
    world = to_world(gaussians, frames)
    colours = sh_colours(
        gaussians.sh_dc, gaussians.sh_rest, world.means, CAMERA.centre, 3 if degree is None else degree
    )
    splats = Splats(world.means, world.scales, world.quaternions, world.opacities, colours)
    frame = Rasteriser(1).forward(splats, CAMERA, np.full(3, 0.25))
    assert picture.colour.shape == (50, 40, 3)
    assert np.array_equal(picture.colour, frame.image.transpose(1, 2, 0))
    assert np.array_equal(picture.alpha, 1 - frame.transmittance)
    assert 0.9 < picture.alpha.max() <= 1
    assert picture.alpha.min() == 0


def test_colours_of_ones_choice_and_a_rasteriser_used_twice() -> None:
    gaussians, frames = tetrahedron()
    palette, own = np.eye(4, dtype=np.float32), Rasteriser(1)
    picture = render_avatar(gaussians, frames, CAMERA, 0.0, colours=palette[gaussians.binding], rasteriser=own)
    kept = picture.colour.copy()
    render_avatar(gaussians, frames, CAMERA, background=1.0, rasteriser=own)
    assert np.array_equal(picture.colour, kept)  # a picture is the caller's own
    assert np.abs(picture.colour.sum(axis=2) - picture.alpha).max() < 1e-6  # channels share the coverage out


def test_a_colour_too_few_and_a_degree_too_high_are_refused() -> None:
    gaussians, frames = tetrahedron()
    with pytest.raises(OptionError, match="3 colours for 4 Gaussians"):
        render_avatar(gaussians, frames, CAMERA, colours=np.ones((3, 3), np.float32))
    with pytest.raises(OptionError, match="degree 3 needs 15 coefficients"):
        render_avatar(replace(gaussians, sh_rest=gaussians.sh_rest[:, :3]), frames, CAMERA, sh_degree=3)
