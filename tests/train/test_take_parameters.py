"""What kernels take a pose from: the same numbers that `PosedHead.pose` is given for a timestep."""

from __future__ import annotations

import numpy as np
import pytest

from sacha_core.flame.posing import TURNS
from sacha_core.train.kernels.pose_and_place import take_parameters
from sacha_core.train.state import FITTED_MOTION

TIMESTEPS, WIDTHS = 3, {"rotation": 3, "neck": 3, "jaw": 3, "eyes": 6, "translation": 3}


@pytest.mark.parametrize("joints", [1, 3, 5])
@pytest.mark.parametrize(("given", "known"), [(4, 4), (4, 2), (2, 4), (0, 3), (3, 0)])
def test_a_row_is_copied_as_far_as_the_head_goes(joints, given, known) -> None:
    rng = np.random.default_rng(0)
    widths = WIDTHS | {"expression": given}
    motion = {name: rng.normal(size=(TIMESTEPS, widths[name])).astype(np.float32) for name in FITTED_MOTION}
    expression, vectors, translation = (np.full(shape, np.nan, np.float32) for shape in (known, (joints, 3), 3))
    for timestep in range(TIMESTEPS):
        take_parameters(timestep, tuple(motion.values()), expression, vectors, translation)
        turns = np.concatenate([motion[name][timestep] for name in TURNS]).reshape(5, 3)
        expected = np.zeros(known, np.float32)
        expected[: min(given, known)] = motion["expression"][timestep, :known]
        assert np.array_equal(vectors, turns[:joints])
        assert np.array_equal(expression, expected)
        assert np.array_equal(translation, motion["translation"][timestep])
