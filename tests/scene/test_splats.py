"""Gaussians as point attributes. Oracle: the engine's own Gaussians in the world, turned by SciPy."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

import sacha_core
from sacha_core.avatar.binding import to_world
from sacha_core.flame.synthetic import synthetic_head
from sacha_core.geometry.triangle import triangle_frames
from sacha_core.raster.harmonics import sh_colours
from sacha_core.scene.splats import Z_UP, Splats, splats_of, write_splats

ROUNDING = 5e-7  # of float32, of metres and of products of unit quaternions


@pytest.fixture(scope="module")
def made() -> tuple[sacha_core.Gaussians, object, Splats]:
    head, rng = synthetic_head("small"), np.random.default_rng(8)
    gaussians = sacha_core.initial_gaussians(head.n_faces, rng)
    spread = {"position": 0.4, "log_scale": 0.5, "quaternion": 1.0, "opacity_logit": 2.0, "sh_dc": 1.0, "sh_rest": 0.2}
    gaussians = replace(
        gaussians,
        **{key: rng.normal(0, s, getattr(gaussians, key).shape).astype(np.float32) for key, s in spread.items()},
    )
    frames = triangle_frames(head.v_template, head.faces)
    return gaussians, frames, splats_of(gaussians, frames)


def test_they_stand_where_the_engine_has_them_with_z_up(made) -> None:
    gaussians, frames, splats = made
    world = to_world(gaussians, frames)
    np.testing.assert_allclose(splats.position, world.means @ Z_UP.T, atol=ROUNDING)
    assert np.array_equal(splats.scale, world.scales)
    expected = Rotation.from_matrix(Z_UP) * Rotation.from_quat(world.quaternions[:, [1, 2, 3, 0]])
    found = Rotation.from_quat(splats.rotation[:, [1, 2, 3, 0]])
    assert (expected * found.inv()).magnitude().max() < 5 * ROUNDING
    np.testing.assert_allclose(np.linalg.norm(splats.rotation, axis=1), 1, atol=ROUNDING)
    assert (Z_UP @ (0, 1, 0) == (0, 0, 1)).all()


def test_what_is_local_gives_the_world_by_the_triangles_frame(made) -> None:
    _, frames, splats = made
    rotation, scale, origin = (getattr(frames, name)[splats.binding] for name in ("rotation", "scale", "origin"))
    means = np.einsum("nij,nj->ni", rotation, splats.position_local) * scale[:, None] + origin
    np.testing.assert_allclose(means @ Z_UP.T, splats.position, atol=ROUNDING)
    np.testing.assert_allclose(splats.scale_local * scale[:, None], splats.scale, rtol=1e-5)


def test_colours_are_linear_and_harmonics_turned(made) -> None:
    gaussians, _, splats = made
    srgb = np.where(
        splats.color[:, :3] <= 0.0031308, 12.92 * splats.color[:, :3], 1.055 * splats.color[:, :3] ** (1 / 2.4) - 0.055
    )
    centre = np.array([0.0, 0.0, 3.0])
    dc_only = sh_colours(gaussians.sh_dc, gaussians.sh_rest, gaussians.position, centre, 0)
    np.testing.assert_allclose(srgb, dc_only, atol=1e-6)
    np.testing.assert_allclose(splats.color[:, 3], 1 / (1 + np.exp(-gaussians.opacity_logit.astype(float))), atol=1e-7)
    means = gaussians.position
    full = sh_colours(gaussians.sh_dc + 4, gaussians.sh_rest, means, centre, 3)
    turned = sh_colours(gaussians.sh_dc + 4, splats.sh, means @ Z_UP.T, Z_UP @ centre, 3)
    np.testing.assert_allclose(turned, full, atol=5e-6)


def test_a_folder_holds_them_and_is_whole_once_it_has_its_json(made, tmp_path: Path) -> None:
    splats = made[2]
    write_splats(splats, tmp_path)
    told = json.loads((tmp_path / "splats.json").read_text())
    assert told == {"n_faces": splats.n_faces, "sh_degree": 3}
    for name in ("position", "scale", "rotation", "color", "sh", "binding", "scale_local"):
        assert np.array_equal(np.load(tmp_path / f"{name}.npy"), getattr(splats, name))
