"""Coding attributes in turn, the rest making up for what was rounded. Oracles are the decoder, and pictures by other cameras."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest

from sacha_core.avatar.gaussians import Gaussians
from sacha_core.codec import decode
from sacha_core.codec.encoder import encode_traced
from sacha_core.errors import OptionError
from sacha_core.rate.curvature import importance_of
from sacha_core.rate.judging import Judge
from sacha_core.rate.making_up import MakingUp, MakingUpOptions
from sacha_core.rate.pictures import own_pictures

LEVEL = 1
TURNS = ["opacity_logit", "log_scale", "quaternion", "position", "sh_rest"]
GAINED_DB = 0.5  # at the same steps, at least, on Gaussians that have nothing in common
SAME_SIZE = 1.02  # of the file, at most


class Recording:
    """Changes nothing of harmonics and colours, moves the rest a little, and notes what it was told of."""

    def __init__(self, moved: float) -> None:
        self.moved, self.seen, self.turns, self.calls = moved, dict[str, np.ndarray](), list[str](), list[int]()
        self.binding = np.zeros(0, np.int64)

    def after(self, gaussians: Gaussians, coded: frozenset[str]) -> Gaussians:
        (name,) = coded - set(self.turns)
        self.turns.append(name)
        self.seen[name], self.binding = getattr(gaussians, name).copy(), gaussians.binding
        given = {other: getattr(gaussians, other) for other in ("position", "log_scale") if other not in coded}
        return replace(gaussians, **{other: (value + self.moved).astype(np.float32) for other, value in given.items()})

    def through(
        self, gaussians: Gaussians, coded: frozenset[str], decode: Callable[[Gaussians], Gaussians]
    ) -> Gaussians:
        assert coded == set(TURNS[:-1])
        self.calls.append(np.count_nonzero(decode(gaussians).sh_rest))
        return gaussians


@pytest.mark.parametrize("harmonics", [True, False])
def test_what_was_told_of_is_what_the_decoder_gives(avatar, head, harmonics):
    none = np.zeros((len(avatar.gaussians), 0, 3), np.float32)
    given = avatar if harmonics else replace(avatar, gaussians=replace(avatar.gaussians, sh_rest=none))
    told, importance = Recording(0.05), importance_of(given, head)
    data, _ = encode_traced(given, LEVEL, head=head, importance=importance, remaining=told)
    back = decode(data, head=head).gaussians
    assert told.turns == (TURNS if harmonics else TURNS[:-1])
    assert len(told.calls) == int(harmonics)
    np.testing.assert_array_equal(back.binding, told.binding)
    for name, value in told.seen.items():
        np.testing.assert_array_equal(getattr(back, name), value, err_msg=name)


def test_moves_between_turns_are_coded(avatar, head):
    """Oracle: the mean of what is decoded moves by what was added in all turns before."""
    importance, moved = importance_of(avatar, head), 0.2
    files = [
        encode_traced(avatar, LEVEL, head=head, importance=importance, remaining=Recording(by))[0] for by in (0, moved)
    ]
    still, other = (decode(data, head=head).gaussians for data in files)
    assert np.mean(other.log_scale - still.log_scale) == pytest.approx(moved, abs=0.05)  # after opacities
    assert np.mean(other.position - still.position) == pytest.approx(3 * moved, abs=0.05)


def test_file_looks_better_when_the_rest_makes_up(avatar, head, monkeypatch):
    """Oracle: the protocol's judge; the same Gaussians in the same steps, which need no others then."""
    monkeypatch.setattr("sacha_core.codec.encoder.for_coding_in_turn", lambda plan: plan)
    poses, steps = own_pictures(avatar, head, 4, 3, 2, 0.5)
    posed, importance, judge = replace(avatar, motion=poses), importance_of(avatar, head), Judge(avatar, head)
    made = MakingUp(posed, head, steps, MakingUpOptions(40))
    files = [encode_traced(avatar, LEVEL, head=head, importance=importance, remaining=one)[0] for one in (None, made)]
    plain, fitted = (judge.quick(decode(data, head=head).gaussians) for data in files)
    assert fitted > plain + GAINED_DB
    assert len(files[1]) < SAME_SIZE * len(files[0])


def test_nothing_is_decided_in_turn_where_nobody_knows_what_numbers_are_worth(avatar, head):
    told = Recording(0.1)
    data, _ = encode_traced(avatar, LEVEL, head=head, remaining=told)
    assert data == encode_traced(avatar, LEVEL, head=head)[0]
    assert not told.turns


def test_nothing_to_look_at_is_refused(avatar, head):
    made = MakingUp(avatar, head, [], MakingUpOptions())
    with pytest.raises(OptionError, match="needs a motion and pictures"):
        made.after(avatar.gaussians, frozenset())


def test_no_steps_are_refused():
    with pytest.raises(OptionError, match="steps after each attribute"):
        MakingUpOptions(0)
