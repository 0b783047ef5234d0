"""The clock against a machine whose time is known: a counter that each piece of work sets forward."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np
import pytest

from sacha_core.bench.clock import Clock, Times, interleave


@dataclass
class FakeMachine:
    """Work takes as long as it says, on so many cores."""

    now: float = 100.0
    worked: float = 7.0
    calls: list[str] = field(default_factory=list)

    def task(self, name: str, seconds: list[float], cores: int = 1):
        remaining = iter(seconds)

        def run() -> None:
            took = next(remaining)
            self.calls.append(name)
            self.now += took
            self.worked += cores * took

        return run

    @property
    def clock(self) -> Clock:
        return Clock(lambda: self.now, lambda: self.worked)


def test_each_candidate_is_called_once_a_round_and_rounds_begin_with_another() -> None:
    machine = FakeMachine()
    tasks = {name: machine.task(name, [1.0] * 4) for name in "abc"}
    interleave(tasks, rounds=3, warm_up=1, clock=machine.clock)
    assert "".join(machine.calls) == "abc" + "abc" + "bca" + "cab"


def test_times_are_those_of_the_work_without_its_warm_up() -> None:
    machine = FakeMachine()
    tasks = {
        "slow": machine.task("slow", [99.0, 3.0, 1.0, 2.0, 8.0, 4.0]),
        "two cores": machine.task("two cores", [9.0] + [0.5] * 5, 2),
    }
    times = interleave(tasks, rounds=5, clock=machine.clock)
    row = times["slow"].row("draw")
    assert row == pytest.approx(
        {"draw_ms": 3000, "draw_min_ms": 1000, "draw_q1_ms": 2000, "draw_q3_ms": 4000, "draw_busy_ms": 3000}
    )
    assert times["two cores"].row("draw")["draw_busy_ms"] == pytest.approx(1000)
    assert times["two cores"].median_ms == pytest.approx(500)


@pytest.mark.parametrize(("budget", "expected"), [(0.0, 3), (3.5, 4), (5.0, 5), (1e9, 7)])
def test_no_round_begins_after_the_budget_but_the_least_are_run(budget: float, expected: int) -> None:
    machine = FakeMachine()
    times = interleave({"a": machine.task("a", [1.0] * 8)}, rounds=7, budget_s=budget, clock=machine.clock)
    assert len(times["a"].wall_s) == expected


def test_a_single_round_has_no_quartiles() -> None:
    machine = FakeMachine()
    times = interleave({"a": machine.task("a", [2.0])}, rounds=1, least=1, warm_up=0, clock=machine.clock)
    assert times["a"].row("a") == pytest.approx({"a_ms": 2000, "a_min_ms": 2000, "a_busy_ms": 2000})


def test_a_sum_is_taken_round_by_round() -> None:
    """The median of sums, not the sum of medians."""
    one = Times(np.array([1.0, 2.0, 9.0]), np.array([1.0, 1.0, 1.0]))
    other = Times(np.array([9.0, 2.0, 1.0]), np.array([0.5, 0.5, 0.5]))
    assert (one + other).row("both")["both_ms"] == pytest.approx(10_000)
    assert (one + other).row("both")["both_busy_ms"] == pytest.approx(1500)


def test_no_candidates_no_times() -> None:
    assert interleave({}, rounds=3) == {}


def test_the_real_clock_sees_work() -> None:
    times = interleave({"work": lambda: sum(range(200_000))}, rounds=3)
    assert times["work"].wall_s.min() > 0
    assert times["work"].busy_s.sum() > 0
