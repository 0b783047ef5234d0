"""Stages of an iteration recorded as CUDA graphs: launched at once instead of kernel by kernel."""

from __future__ import annotations

from collections.abc import Callable, Hashable
from dataclasses import dataclass
from typing import Any

import torch
from torch import Tensor

__all__ = ["Recorder"]

WARM_UP = 2  # calls that run plainly, so that what is set up on first use is no part of a recording

Stage = Callable[..., tuple[Tensor, ...]]


@dataclass
class Recording:
    """One stage.

    Args:
        key: shapes of the tensors it is given, and what else it depends on.
        calls: with that key.
        run: what replays it; None until it is recorded.
    """

    key: Hashable
    calls: int = 0
    run: Stage | None = None


class Recorder:
    """Runs stages, and replays them as graphs once their shapes have settled.

    A stage must neither wait for the device nor allocate by what it computes; what it changes must stay where it is. Its results hold until
    its next call.

    Args:
        enabled: whether to record; if not, every stage just runs.
    """

    def __init__(self, enabled: bool) -> None:
        self._enabled = enabled
        self._recordings: dict[str, Recording] = {}

    def forget(self) -> None:
        """Drop all recordings: what stages change has moved."""
        self._recordings.clear()

    def __call__(
        self, name: str, stage: Stage, *tensors: Tensor, key: Hashable = None, learns: bool = False
    ) -> tuple[Tensor, ...]:
        """Run a stage.

        Args:
            name: of the stage.
            stage: gives tensors from tensors.
            tensors: what it is given.
            key: what else it depends on.
            learns: whether gradients go back through it.
        """
        if not self._enabled:
            return stage(*tensors)
        full = (key, tuple((tensor.shape, learns and tensor.requires_grad) for tensor in tensors))
        found = self._recordings.get(name)
        if found is None or found.key != full:
            found = self._recordings[name] = Recording(full)
        found.calls += 1
        if found.calls <= WARM_UP:
            return stage(*tensors)
        if found.run is None:
            found.run = record_with_gradients(stage, tensors) if learns else record(stage, tensors)
        return found.run(*tensors)


def record(stage: Stage, tensors: tuple[Tensor, ...]) -> Stage:
    """Record a stage without gradients; recording does not run it."""
    inputs = [tensor.clone() for tensor in tensors]
    graph = torch.cuda.CUDAGraph()
    with torch.cuda.graph(graph):
        outputs = stage(*inputs)

    def run(*given: Tensor) -> tuple[Tensor, ...]:
        for kept, tensor in zip(inputs, given, strict=True):
            kept.copy_(tensor)
        graph.replay()
        return outputs

    return run


def record_with_gradients(stage: Stage, tensors: tuple[Tensor, ...]) -> Stage:
    """Record a stage and its way back."""
    make: Callable[..., Any] = torch.cuda.make_graphed_callables
    samples = tuple(tensor.detach().clone().requires_grad_(tensor.requires_grad) for tensor in tensors)
    run: Stage = make(stage, samples, allow_unused_input=True)
    return run
