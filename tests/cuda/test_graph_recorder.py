"""When a stage runs plainly, is recorded and is replayed; recording itself needs a device, so a stand-in keeps a list."""

from __future__ import annotations

import pytest
import torch

from sacha_core.train.cuda import graphs
from sacha_core.train.cuda.graphs import WARM_UP, Recorder


@pytest.fixture
def events(monkeypatch: pytest.MonkeyPatch) -> list[str]:
    """Give the list of what happens."""
    happened: list[str] = []

    def recording(word):
        def record(stage, tensors):
            happened.append(word)

            def run(*given):
                happened.append("replay")
                return stage(*given)

            return run

        return record

    monkeypatch.setattr(graphs, "record", recording("record"))
    monkeypatch.setattr(graphs, "record_with_gradients", recording("record both ways"))
    return happened


def double(tensor):
    return (2 * tensor,)


def test_a_stage_is_recorded_after_its_warm_up(events) -> None:
    recorder = Recorder(enabled=True)
    for call in range(WARM_UP + 3):
        (result,) = recorder("double", double, torch.tensor([float(call)]))
        assert float(result) == 2 * call
    assert events == ["record", "replay", "replay", "replay"]


@pytest.mark.parametrize(
    "change",
    [
        lambda recorder: recorder("double", double, torch.zeros(2)),
        lambda recorder: recorder("double", double, torch.zeros(1), key=1),
        lambda recorder: recorder("double", double, torch.zeros(1), learns=True, key=2),
        lambda recorder: recorder.forget(),
    ],
)
def test_other_shapes_or_constants_begin_anew(events, change) -> None:
    recorder = Recorder(enabled=True)
    for _ in range(WARM_UP + 1):
        recorder("double", double, torch.zeros(1))
    events.clear()
    change(recorder)
    for _ in range(WARM_UP):
        recorder("double", double, torch.zeros(1))
    assert events == []
    recorder("double", double, torch.zeros(1))
    assert events == ["record", "replay"]


def test_stages_that_learn_are_recorded_both_ways(events) -> None:
    recorder = Recorder(enabled=True)
    for _ in range(WARM_UP + 1):
        recorder("double", double, torch.zeros(1, requires_grad=True), learns=True)
        recorder("other", double, torch.zeros(1))
    assert events == ["record both ways", "replay", "record", "replay"]


def test_whether_gradients_are_wanted_matters_to_stages_that_learn_alone(events) -> None:
    recorder = Recorder(enabled=True)
    for learns, expected in ((False, ["record", "replay"]), (True, [])):
        for call in range(WARM_UP + 1):
            recorder(f"double {learns}", double, torch.zeros(1, requires_grad=call == 0), learns=learns)
        assert events == expected
        events.clear()


def test_nothing_is_recorded_where_nobody_asks(events) -> None:
    recorder = Recorder(enabled=False)
    for _ in range(WARM_UP + 3):
        recorder("double", double, torch.zeros(1))
    assert events == []
