"""Time left, and words for lengths of time. Oracle: a clock that the test turns."""

from __future__ import annotations

import io
import json
import sys

import pytest

from sacha_core.cli import waiting
from sacha_core.cli.console import table
from sacha_core.cli.waiting import Bar, JsonLines, PlainLines, TimeLeft, duration
from sacha_core.progress import Progress


class Clock:
    """A clock that goes on only when told to."""

    def __init__(self) -> None:
        self.now = 100.0

    def monotonic(self) -> float:
        return self.now


@pytest.fixture
def clock(monkeypatch: pytest.MonkeyPatch) -> Clock:
    turned = Clock()
    monkeypatch.setattr(waiting, "time", turned)
    return turned


def test_time_left_goes_by_the_pace_since_the_first_report(clock: Clock) -> None:
    left = TimeLeft()
    assert left.seconds(Progress("train", 500, 1000)) is None  # resumed in the middle: no pace yet
    clock.now += 10
    assert left.seconds(Progress("train", 600, 1000)) == pytest.approx(40)
    clock.now += 30
    assert left.seconds(Progress("train", 700, 1000)) == pytest.approx(60)
    assert left.seconds(Progress("train", 1000, 1000)) == 0
    clock.now += 5
    assert left.seconds(Progress("render", 1, 3)) is None  # another stage has another pace
    clock.now += 4
    assert left.seconds(Progress("render", 2, 3)) == pytest.approx(4)


def test_stages_that_go_on_at_once_have_each_a_pace_of_its_own(clock: Clock) -> None:
    left = TimeLeft()
    for step in range(1, 5):
        clock.now += 1
        slow, fast = left.seconds(Progress("slow", step, 10)), left.seconds(Progress("fast", 2 * step, 10))
    assert slow == pytest.approx(6)
    assert fast == pytest.approx(1)
    assert left.seconds(Progress("fast", 1, 10)) is None  # begun anew


def test_stages_that_go_on_at_once_have_each_a_line(clock: Clock, capsys: pytest.CaptureFixture[str]) -> None:
    lines = PlainLines()
    for done in range(1, 21):
        clock.now += 1
        for stage in ("one", "two"):
            lines.show(Progress(stage, done, 20))
    assert capsys.readouterr().err.splitlines() == ["one 16/20, 4 s left", "two 16/20, 4 s left"]


def test_json_lines_are_thinned_but_keep_the_ends_of_stages(clock: Clock, capsys: pytest.CaptureFixture[str]) -> None:
    lines = JsonLines()
    for stage in ("a", "b"):
        for done in range(1, 101):
            clock.now += 0.01
            lines.show(Progress(stage, done, 100))
    found = [json.loads(line) for line in capsys.readouterr().out.splitlines()]
    assert 20 <= len(found) <= 26
    assert [(one["stage"], one["done"]) for one in found if one["done"] in {1, 100}] == [
        ("a", 1), ("a", 100), ("b", 1), ("b", 100),
    ]  # fmt: skip


def test_a_log_file_gets_a_line_now_and_then(clock: Clock, capsys: pytest.CaptureFixture[str]) -> None:
    lines = PlainLines()
    for done in range(1, 101):
        clock.now += 1
        lines.show(Progress("train", done, 100, {"loss": 0.125}))
    found = capsys.readouterr().err.splitlines()
    assert 5 <= len(found) <= 7
    assert found[0] == "train 16/100, 1 min 24 s left  loss 0.125"


def test_the_bar_names_the_stage_its_time_and_its_figures(clock: Clock, monkeypatch: pytest.MonkeyPatch) -> None:
    terminal = io.StringIO()
    monkeypatch.setenv("FORCE_COLOR", "1")
    monkeypatch.setenv("COLUMNS", "120")
    monkeypatch.setattr(sys, "stderr", terminal)
    bar = Bar()
    bar.show(Progress("train", 1, 3, {"loss": 0.5}))
    clock.now += 4
    bar.show(Progress("train", 2, 3, {"loss": 0.25}))
    bar.close()
    text = terminal.getvalue()
    for part in ("train", "2/3", "4 s left", "loss 0.25"):
        assert part in text


@pytest.mark.parametrize(
    ("seconds", "words"), [(0, "0 s"), (59.4, "59 s"), (59.6, "1 min 00 s"), (200, "3 min 20 s"), (7500, "2 h 05 min")]
)
def test_duration(seconds: float, words: str) -> None:
    assert duration(seconds) == words


def test_table_aligns_names_left_and_figures_right() -> None:
    assert table(("section", "bytes"), [("Scale", "12"), ("Position", "3,456")]) == (
        "section   bytes\n--------  -----\nScale        12\nPosition  3,456"
    )


def test_finished_bars_make_room_where_there_are_many(monkeypatch: pytest.MonkeyPatch) -> None:
    terminal = io.StringIO()
    monkeypatch.setattr(sys, "stderr", terminal)
    bar = Bar()
    bar.show(Progress("lasting", 1, 2))
    for job in range(40):
        bar.show(Progress(f"job {job}", 1, 1))
    shown = [task.description for task in bar._bars.tasks]
    bar.close()
    assert len(shown) <= waiting.MOST_BARS
    assert {"lasting", "job 39"} <= set(shown)
