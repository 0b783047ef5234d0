"""The stand-in against gsplat itself, where that is installed: its signatures, and its own plain functions, which need no device."""

from __future__ import annotations

import inspect

import gsplat_stand_in as stand_in
import numpy as np
import pytest
import torch

gsplat = pytest.importorskip("gsplat", reason="gsplat is an extra; its signatures are checked where it is installed")
plain = pytest.importorskip("gsplat.cuda._torch_impl")

FUNCTIONS = ("fully_fused_projection", "isect_tiles", "isect_offset_encode", "rasterize_to_pixels")
PLACES = 1e-4  # pixels, float32 sums of some hundred
RELATIVE = 1e-4
WIDTH, HEIGHT, TILE = 70, 45, 16


@pytest.mark.parametrize("name", FUNCTIONS)
def test_the_stand_in_takes_what_gsplat_takes(name) -> None:
    ours, theirs = (inspect.signature(getattr(module, name)).parameters for module in (stand_in, gsplat))
    known = [parameter for parameter in theirs.values() if parameter.name in ours]
    assert [(one.name, one.kind, one.default) for one in known] == [
        (one.name, one.kind, one.default) for one in ours.values()
    ]
    # what a later gsplat may have more can be left out
    assert all(
        parameter.default is not inspect.Parameter.empty for parameter in theirs.values() if parameter.name not in ours
    )


@pytest.fixture
def scene():
    """Give Gaussians before, beside and behind two cameras."""
    rng = np.random.default_rng(0)
    n = 60
    means = torch.from_numpy(rng.normal(0, 0.4, (n, 3)).astype(np.float32))
    quaternions = torch.from_numpy(rng.normal(size=(n, 4)).astype(np.float32))
    scales = torch.from_numpy(np.exp(rng.normal(-3.5, 0.7, (n, 3))).astype(np.float32))
    views = torch.eye(4).repeat(2, 1, 1)
    views[0, 2, 3], views[1, 2, 3], views[1, 0, 3] = 1.0, 0.2, 0.1
    intrinsics = torch.tensor([[60.0, 0, 33], [0, 66, 20], [0, 0, 1]]).repeat(2, 1, 1)
    return means, quaternions, scales, views, intrinsics


def test_projection_is_that_of_the_plain_function(scene) -> None:
    means, quaternions, scales, views, intrinsics = scene
    opacities = torch.ones(len(means))  # the plain function's boxes are those of opaque Gaussians
    radii, places, depths, conics, _ = stand_in.fully_fused_projection(
        means, None, quaternions, scales, views, intrinsics, WIDTH, HEIGHT, near_plane=0.1, opacities=opacities
    )
    covariances, _ = plain._quat_scale_to_covar_preci(quaternions, scales, compute_preci=False)
    expected = plain._fully_fused_projection(means, covariances, views, intrinsics, WIDTH, HEIGHT, near_plane=0.1)
    shown = (radii > 0).all(-1)
    assert shown.any()
    assert not shown.all()
    assert torch.equal(shown, (expected[0] > 0).all(-1))
    assert (radii - expected[0])[shown].abs().max() <= 1  # rounded up from 3.3290 or 3.33 standard deviations
    assert (places - expected[1])[shown].abs().max() < PLACES
    assert torch.allclose(depths[shown], expected[2][shown])
    assert torch.allclose(conics[shown], expected[3][shown], rtol=RELATIVE, atol=RELATIVE)


def test_lists_of_tiles_are_those_of_the_plain_function(scene) -> None:
    means, quaternions, scales, views, intrinsics = scene
    radii, places, depths, _, _ = stand_in.fully_fused_projection(
        means,
        None,
        quaternions,
        scales,
        views,
        intrinsics,
        WIDTH,
        HEIGHT,
        near_plane=0.1,
        opacities=torch.ones(len(means)),
    )
    grid = (-(-WIDTH // TILE), -(-HEIGHT // TILE))
    tiles, keys, order = stand_in.isect_tiles(places, radii, depths, TILE, *grid)
    expected = plain._isect_tiles(places.nan_to_num(), radii, depths.nan_to_num(), TILE, *grid)
    assert torch.equal(tiles, expected[0])
    assert torch.equal(keys, expected[1])
    assert torch.equal(order, expected[2])
    offsets = stand_in.isect_offset_encode(keys, 2, *grid)
    assert torch.equal(offsets, plain._isect_offset_encode(keys, 2, *grid).view_as(offsets))
