"""Oracles: the source itself, and a count of what was asked of it."""

from __future__ import annotations

import threading

import numpy as np
import pytest
from posed_heads import random_motion

from sacha_core.animation.source import GroupsAhead, InMemory
from sacha_core.avatar.motion import Motion
from sacha_core.errors import FormatError, OptionError

GROUP, N_FRAMES = 4, 18


class Counted:
    """A motion in groups that lists which were made, and on which threads."""

    frame_rate = 25.0
    group_frames = GROUP

    def __init__(self, n_frames: int = N_FRAMES, damaged: int | None = None) -> None:
        self.motion, self.damaged = random_motion(n_frames), damaged
        self.made: list[int] = []
        self.threads: set[str] = set()

    def __len__(self) -> int:
        return len(self.motion)

    def still(self) -> Motion:
        return self.motion.frames(slice(0))

    def group(self, number: int) -> Motion:
        self.threads.add(threading.current_thread().name)
        self.made.append(number)
        if number == self.damaged:
            raise FormatError(f"motion group {number}: spoiled", 123)
        return self.motion.frames(slice(number * GROUP, (number + 1) * GROUP))


def settled(ahead: GroupsAhead) -> None:
    """Wait until nothing is being made."""
    for future in list(ahead._groups.values()):
        future.exception()


def test_every_frame_is_the_motion_s():
    source = Counted()
    ahead = GroupsAhead(source)
    for index in [*range(N_FRAMES), 3, 17, 0, 9]:
        motion, row = ahead.frame(index)
        np.testing.assert_array_equal(motion.expression[row], source.motion.expression[index])
    ahead.close()
    assert all(name.startswith("sacha-motion") for name in source.threads)


def test_a_jump_costs_one_group():
    source = Counted()
    ahead = GroupsAhead(source)
    for index, made in ((9, [2]), (9, [2]), (0, [2, 0]), (17, [2, 0, 4]), (16, [2, 0, 4])):
        ahead.frame(index)
        settled(ahead)
        assert source.made == made
    ahead.close()


def test_playing_makes_the_next_group_before_it_is_wanted_and_none_twice():
    source = Counted()
    ahead = GroupsAhead(source)
    for index in range(N_FRAMES):
        assert index // GROUP in source.made or index == 0
        ahead.frame(index)
        settled(ahead)
    assert source.made == [0, 1, 2, 3, 4, 0], "after the last, the first: playing again begins at once"
    ahead.frame(0)
    assert source.made == [0, 1, 2, 3, 4, 0]
    ahead.close()


def test_no_more_groups_are_kept_than_there_is_room_for():
    ahead = GroupsAhead(Counted(), room=2)
    for index in [*range(N_FRAMES), 0, 8, 12, 5, 6]:
        ahead.frame(index)
        assert len(ahead._groups) <= 2
    ahead.close()


def test_a_damaged_group_is_reported_when_its_frames_are_wanted_and_not_before():
    ahead = GroupsAhead(Counted(damaged=1))
    for index in range(GROUP):
        ahead.frame(index)
    for _ in range(2):
        with pytest.raises(FormatError, match="motion group 1: spoiled") as caught:
            ahead.frame(GROUP)
        assert caught.value.offset == 123
    ahead.frame(2 * GROUP)
    ahead.close()


@pytest.mark.parametrize("index", [-1, N_FRAMES])
def test_frames_that_do_not_exist(index):
    ahead = GroupsAhead(Counted())
    with pytest.raises(OptionError, match=f"frame {index} does not exist; the motion has frames 0 to {N_FRAMES - 1}"):
        ahead.frame(index)
    ahead.close()


def test_closing_ends_the_thread_and_says_so_afterwards():
    ahead = GroupsAhead(Counted())
    ahead.frame(0)
    ahead.frame(1)
    ahead.close()
    ahead.close()
    assert not [thread for thread in threading.enumerate() if thread.name.startswith("sacha-motion")]
    with pytest.raises(OptionError, match="closed"):
        ahead.frame(0)


def test_a_motion_in_memory_is_one_group():
    motion = random_motion(5)
    source = InMemory(motion)
    assert (len(source), source.group_frames, source.frame_rate) == (5, 5, motion.frame_rate)
    assert source.group(0) is motion
    assert len(source.still()) == 0
    empty = InMemory(motion.frames(slice(0)))
    assert (len(empty), empty.group_frames) == (0, 1)
