"""The gradient of the bits: exact through the prediction, and downhill for the encoder itself."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from synthetic_avatars import random_importance, small_head, smooth_avatar

from sacha_core.codec import encode, inspect
from sacha_core.codec.bit_gradient import bit_gradient, through_prediction
from sacha_core.codec.order import Layout, layout_by_triangle
from sacha_core.codec.prediction import Linear, Mixture, fit_mixture
from sacha_core.codec.template import template_of

ROUNDING = 1e-4  # of values of 2^24 units, whose predictions are rounded to whole ones
MOVED = {"position": 0.02, "log_scale": 0.02, "sh_dc": 0.02}
SECTION = {"position": "Position", "log_scale": "Scale", "sh_dc": "Colour"}


def off_by(layout: Layout, mixture: Mixture, values: np.ndarray) -> np.ndarray:
    """What predictions from the values themselves are off by."""
    known, off = Linear(mixture, values), np.zeros(values.shape)
    known.values = values.copy()
    for step in layout.passes:
        known.enter(step)
        for component in range(values.shape[1]):
            off[step.rows, component] = residual = known.residual(component)
            known.learn(component, residual)
    return off


def test_gradient_through_the_prediction_is_that_of_differences():
    """Oracle: what is off, before and after a move of all values at random; it is linear in them."""
    head, rng = small_head(), np.random.default_rng(0)
    template = template_of(head.v_template, head.faces)
    layout = layout_by_triangle(rng.poisson(1.5, head.n_faces), template)
    shape = (len(layout), 3)
    values = rng.integers(-(2**24), 2**24, shape) + (np.cumsum(rng.integers(-9, 10, shape), axis=0) << 18)
    mixture = fit_mixture(layout, values, np.full(shape, 2**10))
    assert mixture.weights.any(axis=(0, 2)).all()
    assert mixture.across.any()
    slopes, move = rng.normal(0, 1, shape), rng.integers(-(2**24), 2**24, shape)
    change = (slopes * (off_by(layout, mixture, values + move) - off_by(layout, mixture, values))).sum()
    expected = (through_prediction(layout, mixture, slopes) * move).sum()
    assert change == pytest.approx(expected, rel=ROUNDING)


@pytest.mark.parametrize("name", list(MOVED))
def test_files_grow_up_the_gradient_and_shrink_down_it(name):
    """Oracle: the encoder. The section of the numbers that move takes fewer bytes on one side, more on the other."""
    head = small_head()
    avatar = smooth_avatar(1500, head, n_harmonics=0, seed=3)
    rng = np.random.default_rng(4)
    noisy = getattr(avatar.gaussians, name) + rng.normal(0, 0.1, (1500, 3)).astype(np.float32)
    avatar = replace(avatar, gaussians=replace(avatar.gaussians, **{name: noisy}), motion=None)
    importance = random_importance(avatar.gaussians)
    slope = getattr(bit_gradient(avatar.gaussians, head, 3, importance), name)
    move = MOVED[name] * np.clip(slope / np.median(np.abs(slope)), -1, 1)
    sizes = []
    for sign in (-1, 0, 1):
        moved = replace(avatar.gaussians, **{name: (noisy + sign * move).astype(np.float32)})
        data = encode(replace(avatar, gaussians=moved), 3, head=head, importance=importance)
        sizes.append(next(s.n_bytes for s in inspect(data).sections if s.name == SECTION[name]))
    assert sizes[0] < sizes[1] < sizes[2]
