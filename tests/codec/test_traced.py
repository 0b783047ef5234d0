"""Encoding tells which Gaussian went where. The oracle is the decoder: what it gives must be what was at those rows."""

from __future__ import annotations

import numpy as np
import pytest
from synthetic_avatars import random_avatar

from sacha_core.codec import decode
from sacha_core.codec.encoder import encode_traced

OPACITY_ERROR = 0.03  # of theta = arcsin sqrt opacity; the coarsest steps are 0.065 wide


@pytest.mark.parametrize("drop", [False, True])
def test_decoded_gaussians_are_those_of_the_rows_that_were_told(drop):
    avatar = random_avatar(400, n_frames=2, n_harmonics=3)
    data, rows = encode_traced(avatar, 4, drop_invisible=drop)
    back, given = decode(data).gaussians, avatar.gaussians.select(rows)
    assert len(np.unique(rows)) == len(rows) == len(back)
    assert (len(rows) < len(avatar.gaussians)) == drop
    np.testing.assert_array_equal(back.binding, given.binding)
    theta = [np.arctan(np.exp(one.opacity_logit / 2)) for one in (back, given)]
    np.testing.assert_allclose(*theta, atol=OPACITY_ERROR)
