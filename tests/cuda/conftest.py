"""What the tests of the CUDA engine share."""

from __future__ import annotations

import pytest
from cuda_scenes import Stage, make_stage, make_state

from sacha_core.train.state import TrainState


@pytest.fixture(scope="session")
def stage() -> Stage:
    """Give a head and views of it."""
    return make_stage()


@pytest.fixture
def state(stage: Stage) -> TrainState:
    """Give Gaussians on the head, ready to be trained."""
    return make_state(stage)
