"""What the tests of the CUDA engine share."""

from __future__ import annotations

from collections.abc import Iterator

import pytest
from cuda_scenes import Stage, make_stage, make_state

from sacha_core.bench.exact import one_thread
from sacha_core.train.state import TrainState


@pytest.fixture(autouse=True)
def one_torch_thread() -> Iterator[None]:
    """Keep torch on one thread: on tensors so small more of them only wait for each other."""
    with one_thread():
        yield


@pytest.fixture(scope="session")
def stage() -> Stage:
    """Give a head and views of it."""
    return make_stage()


@pytest.fixture
def state(stage: Stage) -> TrainState:
    """Give Gaussians on the head, ready to be trained."""
    return make_state(stage)
