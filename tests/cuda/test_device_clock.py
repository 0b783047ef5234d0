"""Times of stages that a device tells; its events are made up, as there may be none."""

from __future__ import annotations

from dataclasses import dataclass

import pytest
import torch

from sacha_core.stopwatch import Stopwatch
from sacha_core.train.cuda.clock import DeviceClock

MOMENTS_MS = (0.0, 20.0, 20.0, 50.0, 50.0, 60.0)  # at which the device comes to the marks, one after the other


@dataclass
class Event:
    """A mark in a queue that runs at a pace of its own."""

    moments: list[float]
    at_ms: float = -1.0
    waited: bool = False

    def record(self) -> None:
        self.at_ms = self.moments.pop(0)

    def synchronize(self) -> None:
        self.waited = True

    def elapsed_time(self, end: Event) -> float:
        assert end.waited
        return end.at_ms - self.at_ms


@pytest.fixture
def clock(monkeypatch: pytest.MonkeyPatch) -> DeviceClock:
    moments = list(MOMENTS_MS)
    monkeypatch.setattr(torch.cuda, "Event", lambda **_: Event(moments))
    return DeviceClock(torch.device("cuda"))


def test_stages_of_a_device_add_up_to_the_time_that_passed(clock, monkeypatch) -> None:
    ticks = iter([0.0, 0.1])  # seconds of the host
    monkeypatch.setattr("sacha_core.stopwatch.time.perf_counter", lambda: next(ticks))
    watch = Stopwatch()
    with watch("rest"):
        for stage in ("drawing", "loss", "drawing"):
            with clock(watch, stage):
                pass
        clock.settle(watch)
        clock.settle(watch)  # there is nothing more to tell
    assert watch.seconds == pytest.approx({"rest": 0.04, "drawing": 0.03, "loss": 0.03})


def test_where_nobody_wants_to_know_nothing_is_marked(clock) -> None:
    with clock(None, "drawing"):
        pass
    watch = Stopwatch()
    clock.settle(watch)
    assert watch.seconds == {}
