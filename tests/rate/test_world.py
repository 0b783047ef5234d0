"""Gaussians in the world of a pose. The oracle are the array operations of `avatar.binding`."""

from __future__ import annotations

from dataclasses import fields, replace

import numpy as np

from sacha_core.avatar.avatar import Avatar
from sacha_core.avatar.binding import initial_gaussians, to_world
from sacha_core.flame.synthetic import synthetic_head
from sacha_core.parallel.pool import Pool
from sacha_core.rate.views import protocol_shots
from sacha_core.rate.world import in_world

ROUNDING = 2e-6  # of float32, summed in another order


def test_carried_as_array_operations_carry():
    head, rng = synthetic_head("small"), np.random.default_rng(1)
    gaussians = initial_gaussians(head.n_faces, rng, 0)
    shape, f4 = gaussians.position.shape, np.float32
    gaussians = replace(
        gaussians,
        position=rng.normal(0, 1, shape).astype(f4),
        log_scale=rng.normal(-1, 2, shape).astype(f4),
        quaternion=rng.normal(0, 1, (len(gaussians), 4)).astype(f4),
        opacity_logit=rng.normal(0, 3, len(gaussians)).astype(f4),
    )
    for shot in protocol_shots(Avatar(gaussians, head.reference), head, 3):
        ours, theirs = in_world(gaussians, shot.stance, Pool(2)), to_world(gaussians, shot.frames)
        alone = in_world(gaussians, shot.stance)
        for field in fields(theirs):
            one, other = getattr(ours, field.name), getattr(theirs, field.name)
            assert one.dtype == other.dtype
            np.testing.assert_array_equal(one, getattr(alone, field.name))
            np.testing.assert_allclose(one, other, rtol=ROUNDING, atol=ROUNDING)


def test_nothing_stays_nothing():
    head = synthetic_head("small")
    nothing = initial_gaussians(head.n_faces, np.random.default_rng(0), 1).select(np.zeros(0, np.int64))
    (shot,) = protocol_shots(Avatar(nothing, head.reference), head, 1)
    assert len(in_world(nothing, shot.stance).means) == 0
