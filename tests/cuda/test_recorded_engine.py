"""The engine with its stages recorded, on the CPU: a trace of torch's operations stands for a CUDA graph.

Like a graph, a trace repeats the same operations on the same memory: what Python has decided or computed by the time of recording is baked
in. So a stage that depends on anything but its tensors, its key and memory that stays in place goes astray here as it would there.
"""

from __future__ import annotations

import copy
from typing import Any

import numpy as np
import pytest
import torch
from cuda_scenes import DEGREE
from torch.fx.experimental.proxy_tensor import make_fx

from sacha_core.train.cuda import graphs
from sacha_core.train.state import ATTRIBUTES, FITTED_MOTION

NOTHING: frozenset[str] = frozenset()


def require_no_waiting(trace) -> None:
    """Refuse what gives Python a number, or a result whose size is one: a device would have to be waited for."""
    done = {str(node.target) for node in trace.graph.nodes if node.op == "call_function"}
    assert len(done) > 5
    assert not [
        name
        for name in done
        if any(word in name for word in ("_local_scalar_dense", "nonzero", "unique", "masked_select"))
    ]


def record(stage, tensors):
    """Trace a stage. That runs it once, as recording does not; so this run is taken for the first replay."""
    inputs = [tensor.clone() for tensor in tensors]
    outputs: list[Any] = []

    def noting(*given):
        outputs.append(stage(*given))
        return outputs[0]

    trace = make_fx(noting)(*inputs)
    require_no_waiting(trace)

    def run(*given):
        if outputs:
            return outputs.pop()
        for kept, tensor in zip(inputs, given, strict=True):
            kept.copy_(tensor)
        return trace(*inputs)

    return run


def record_with_gradients(stage, tensors):
    """Trace a stage that changes nothing, and its way back."""
    learns = [tensor.requires_grad for tensor in tensors]

    def leaves(given):
        return [tensor.detach().requires_grad_(learn) for tensor, learn in zip(given, learns, strict=True)]

    def back(given, slopes):
        inputs = leaves(given)
        outputs = [output for output in stage(*inputs) if output.requires_grad]
        wanted = [tensor for tensor, learn in zip(inputs, learns, strict=True) if learn]
        return torch.autograd.grad(outputs, wanted, slopes, materialize_grads=True)

    given = [tensor.detach().clone() for tensor in tensors]
    smooth = [output.requires_grad for output in stage(*leaves(given))]
    slopes = [torch.ones_like(output) for output, learn in zip(stage(*given), smooth, strict=True) if learn]
    forward, backward = make_fx(stage)(*given), make_fx(back)(given, slopes)
    require_no_waiting(forward)
    require_no_waiting(backward)

    class Replay(torch.autograd.Function):
        @staticmethod
        def forward(_, *inputs):
            for kept, tensor in zip(given, inputs, strict=True):
                kept.copy_(tensor)
            return tuple(forward(*given))

        @staticmethod
        def backward(_, *gradients):
            coming = [gradient for gradient, learn in zip(gradients, smooth, strict=True) if learn]
            for kept, gradient in zip(slopes, coming, strict=True):
                kept.copy_(gradient)
            found = iter(backward(given, slopes))
            return tuple(next(found) if learn else None for learn in learns)

    return Replay.apply


def rates(iteration: int) -> dict[str, float]:
    return {name: 1e-3 / (iteration + place) for place, name in enumerate((*ATTRIBUTES, *FITTED_MOTION))}


def trained(engine, state, targets, iterations: int):
    """Train through everything that may come between two iterations: in the first eighteen."""
    engine.put(copy.deepcopy(state))
    losses = []
    for iteration in range(1, iterations + 1):
        degree = 0 if iteration < 4 else DEGREE  # harmonics come into use
        views = targets[:3] if 7 <= iteration < 11 else [targets[(0, 4, 1)[iteration % 3]]]  # more cameras for a while
        engine.differentiate(iteration, views, degree)
        void = NOTHING
        if iteration in {12, 14}:
            taken = engine.take()
            if iteration == 12:  # opacities are reset
                taken.values["opacity_logit"][:] = -1
                void = frozenset({"opacity_logit"})
            else:  # Gaussians go
                rows = np.arange(len(taken))[3:]
                for arrays in (taken.values, taken.first, taken.second):
                    arrays |= {name: arrays[name][rows].copy() for name in ATTRIBUTES}
                taken.binding = taken.binding[rows].copy()
                taken.gradient_sum, taken.gradient_count = (
                    taken.gradient_sum[rows].copy(),
                    taken.gradient_count[rows].copy(),
                )
                void = frozenset(ATTRIBUTES)
            engine.put(taken)
        engine.advance(rates(iteration), void)
        if iteration % 4 == 0:
            losses.append(engine.losses())
    return copy.deepcopy(engine.take()), losses


@pytest.mark.slow
@pytest.mark.parametrize(
    ("fine_tune", "iterations", "count"),
    # posing begins anew five times, the loss and the statistics do not mind the degree, and Adam not the cameras
    [(True, 18, 5 + 4 + 4 + 3), (False, 4, 1 + 1 + 1 + 1)],
)
def test_a_recorded_engine_does_to_the_bit_what_a_plain_one_does(
    stage, state, monkeypatch, fine_tune, iterations, count
) -> None:
    recordings = []

    def noted(make):
        def recording(*given):
            recordings.append(given[0])
            return make(*given)

        return recording

    monkeypatch.setattr(graphs, "record", noted(record))
    monkeypatch.setattr(graphs, "record_with_gradients", noted(record_with_gradients))
    plain, losses = trained(stage.engine(fine_tune=fine_tune), state, stage.targets, iterations)
    assert not recordings
    engine = stage.engine(fine_tune=fine_tune)
    engine._record = graphs.Recorder(enabled=True)
    recorded, losses_ = trained(engine, state, stage.targets, iterations)
    assert len(recordings) == count
    assert losses_ == losses
    for kind in ("values", "first", "second"):
        for name, array in getattr(plain, kind).items():
            assert np.array_equal(getattr(recorded, kind)[name], array), (kind, name)
    assert np.array_equal(recorded.gradient_sum, plain.gradient_sum)
    assert np.array_equal(recorded.gradient_count, plain.gradient_count)
    assert recorded.steps == plain.steps


@pytest.mark.slow
def test_a_recorded_engine_finds_faults(stage, state, monkeypatch) -> None:
    monkeypatch.setattr(graphs, "record", record)
    monkeypatch.setattr(graphs, "record_with_gradients", record_with_gradients)
    state.values["neck"][2, 0] = np.inf
    ends = []
    for enabled in (False, True):
        engine = stage.engine()
        engine._record = graphs.Recorder(enabled)
        engine.put(copy.deepcopy(state))
        for iteration in range(1, 9):
            engine.differentiate(iteration, [stage.targets[4 if iteration in {5, 7} else 0]], DEGREE)
            engine.advance(rates(iteration), NOTHING)
        ends.append(engine.take())
    assert ends[1].faults == ends[0].faults
    assert ends[1].faults.count == 2
    assert all(np.array_equal(ends[1].values[name], array, equal_nan=True) for name, array in ends[0].values.items())
