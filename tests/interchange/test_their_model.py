"""Oracle: what GaussianAvatars' programs do with a model folder, step by step, and the sizes that they insist on."""

from __future__ import annotations

from argparse import Namespace
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from plyfile import PlyData

from sacha_core.avatar.binding import initial_gaussians
from sacha_core.avatar.motion import Motion
from sacha_core.interchange.gaussian_avatars import fitted_offsets, for_their_viewer, read_model, write_model

V, BARE = 5143, 5023
N_FRAMES = 3


def motion(n_offsets: int, n_shape: int = 50, n_expression: int = 50) -> Motion:
    rng = np.random.default_rng(0)
    rest = Motion.rest(n_shape, n_expression, N_FRAMES)
    offset = rng.normal(size=(n_offsets, 3)).astype(np.float32)
    expression = rng.normal(size=(N_FRAMES, n_expression)).astype(np.float32)
    return replace(rest, shape=rng.normal(size=n_shape).astype(np.float32), static_offset=offset, expression=expression)


@pytest.mark.parametrize("n_offsets", [0, BARE, V])
def test_their_viewer_finds_what_it_takes(tmp_path: Path, n_offsets: int) -> None:
    """As `local_viewer.py` and `render.py` open a model: arguments evaluated, columns by the beginning of their names, arrays by name."""
    given = motion(n_offsets)
    gaussians = initial_gaussians(10144, np.random.default_rng(0), sh_degree=1)
    gaussians.sh_rest[:] = np.random.default_rng(1).normal(size=gaussians.sh_rest.shape)
    place = write_model(
        tmp_path, 30_000, replace(gaussians, sensitivity_logit=gaussians.opacity_logit), for_their_viewer(given)
    )
    arguments = eval((tmp_path / "cfg_args").read_text(), {"Namespace": Namespace})  # noqa: S307  (as they do)
    assert arguments.sh_degree == 3
    assert arguments.bind_to_mesh
    assert arguments.white_background
    assert place == tmp_path / "point_cloud" / "iteration_30000"

    rows = PlyData.read(place / "point_cloud.ply").elements[0]
    names = [prop.name for prop in rows.properties]
    for start, count in (("f_rest_", 45), ("scale_", 3), ("rot", 4), ("binding", 1)):
        assert sum(name.startswith(start) for name in names) == count, start
    rest = np.stack([rows[f"f_rest_{i}"] for i in range(45)], axis=1).reshape(-1, 3, 15)
    np.testing.assert_array_equal(rest[:, :, :3].transpose(0, 2, 1), gaussians.sh_rest)
    np.testing.assert_array_equal(rows["binding_0"].astype(np.int32), gaussians.binding)

    with np.load(place / "flame_param.npz") as archive:
        arrays = {name: archive[name] for name in archive.files}
    shapes = {name: array.shape for name, array in arrays.items()}
    assert shapes == {
        "shape": (300,), "expr": (N_FRAMES, 100), "rotation": (N_FRAMES, 3), "neck_pose": (N_FRAMES, 3),
        "jaw_pose": (N_FRAMES, 3), "eyes_pose": (N_FRAMES, 6), "translation": (N_FRAMES, 3),
        "static_offset": (1, V, 3), "dynamic_offset": (N_FRAMES, V, 3),
    }  # fmt: skip
    assert {array.dtype for array in arrays.values()} == {np.dtype(np.float32)}
    np.testing.assert_array_equal(arrays["expr"][:, :50], given.expression)
    np.testing.assert_array_equal(arrays["static_offset"][0, : len(given.static_offset)], given.static_offset)
    assert not arrays["expr"][:, 50:].any()
    assert not arrays["static_offset"][0, len(given.static_offset) :].any()


def test_one_of_theirs_is_read(tmp_path: Path) -> None:
    """A folder as they write it: uncompressed arrays, of which one is all zeros, no head.json, arguments of their own."""
    gaussians, wide = initial_gaussians(10144, np.random.default_rng(0)), for_their_viewer(motion(V, 300, 100))
    (tmp_path / "cfg_args").write_text("Namespace(sh_degree=3, source_path='/data/074')")
    place = write_model(tmp_path, 600_000, gaussians, wide)
    with np.load(place / "flame_param.npz") as archive:
        np.savez(place / "flame_param.npz", **{name: archive[name] for name in archive.files})
    back, back_motion = read_model(tmp_path)
    assert (tmp_path / "cfg_args").read_text() == "Namespace(sh_degree=3, source_path='/data/074')"  # theirs stays
    assert back_motion is not None
    np.testing.assert_array_equal(back_motion.static_offset, wide.static_offset)
    np.testing.assert_array_equal(back_motion.expression, wide.expression)
    for name in ("position", "sh_dc", "sh_rest", "binding", "quaternion", "log_scale", "opacity_logit"):
        np.testing.assert_array_equal(getattr(back, name), getattr(gaussians, name))


def test_offsets_gain_and_lose_the_teeth_only() -> None:
    bare, whole, other = motion(BARE), motion(V), motion(77)
    gained = fitted_offsets(bare, V).static_offset
    np.testing.assert_array_equal(gained[:BARE], bare.static_offset)
    assert not gained[BARE:].any()
    np.testing.assert_array_equal(fitted_offsets(whole, BARE).static_offset, whole.static_offset[:BARE])
    for given, n_vertices in ((bare, BARE), (whole, V), (other, V), (motion(0), V), (whole, 77)):
        assert fitted_offsets(given, n_vertices) is given
