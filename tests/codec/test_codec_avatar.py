"""Whole avatars through the codec."""

from __future__ import annotations

import numpy as np
import pytest
from synthetic_avatars import random_avatar

from sacha_core.codec import decode, encode, inspect


@pytest.mark.parametrize("n", [0, 1, 2, 700])
@pytest.mark.parametrize("level", [1, 2, 3, 4])
def test_file_decodes_to_a_valid_avatar_of_the_same_make(n, level):
    avatar = random_avatar(n, seed=n)
    data = encode(avatar, level, drop_invisible=False)
    back = decode(data)
    back.gaussians.validate(avatar.head.n_faces)
    assert back.head == avatar.head
    assert back.scheme == avatar.scheme
    assert np.array_equal(np.sort(avatar.gaussians.binding), back.gaussians.binding)
    assert back.gaussians.sh_rest.shape == avatar.gaussians.sh_rest.shape
    assert back.motion is not None
    assert len(back.motion) == len(avatar.motion)
    assert inspect(data).total_bytes == len(data)
    assert encode(avatar, level, drop_invisible=False) == data
