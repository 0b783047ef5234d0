"""A stage's time is its own, whatever runs inside it."""

from __future__ import annotations

import pytest

from sacha_core.stopwatch import Stopwatch, timed


def test_stages_inside_one_another_share_the_time(monkeypatch) -> None:
    moments = iter([0, 1, 3, 6, 10, 15])
    monkeypatch.setattr("time.perf_counter", lambda: next(moments))
    watch = Stopwatch()
    with watch("outer"):  # from 0
        with watch("inner"):  # from 1 to 3
            pass
        with pytest.raises(KeyError), watch("inner"):  # from 6 to 10
            raise KeyError
    assert watch.seconds == {"outer": 15 - 2 - 4, "inner": 2 + 4}
    assert watch.counts == {"outer": 1, "inner": 2}


def test_nobody_measures_nothing() -> None:
    with timed(None, "stage") as nothing:
        assert nothing is None


def test_what_was_measured_elsewhere_is_not_counted_twice(monkeypatch) -> None:
    ticks = iter([0.0, 5.0])
    monkeypatch.setattr("sacha_core.stopwatch.time.perf_counter", lambda: next(ticks))
    watch = Stopwatch()
    with watch("all"):
        watch.tell("device", 2.0)
        watch.tell("device", 1.0)
    assert watch.seconds == {"all": 2.0, "device": 3.0}
    watch.tell("device", 1.0)  # with nothing running
    assert watch.seconds == {"all": 2.0, "device": 4.0}
