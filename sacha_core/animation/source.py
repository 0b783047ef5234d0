"""Where the frames of a motion come from, some at a time."""

from __future__ import annotations

from concurrent.futures import Future, ThreadPoolExecutor
from typing import Protocol

from sacha_core.avatar.motion import Motion
from sacha_core.errors import OptionError

__all__ = ["GroupsAhead", "InMemory", "MotionSource"]


class MotionSource(Protocol):
    """A motion in groups of frames that can each be had alone; `sacha_core.codec.motion.MotionReader` is one."""

    def __len__(self) -> int:
        """Give the number of frames."""

    @property
    def frame_rate(self) -> float:
        """Frames a second."""

    @property
    def group_frames(self) -> int:
        """Frames in every group but the last."""

    def still(self) -> Motion:
        """Give the motion without its frames: what is said once about the person."""

    def group(self, number: int) -> Motion:
        """Give the frames `number` * `group_frames` and on, of one group.

        Raises:
            FormatError: it is damaged.
        """


class InMemory:
    """A motion that is there already, as one group.

    Args:
        motion: all frames.
    """

    def __init__(self, motion: Motion) -> None:
        self._motion = motion
        self.frame_rate = motion.frame_rate
        self.group_frames = max(len(motion), 1)

    def __len__(self) -> int:
        """Give the number of frames."""
        return len(self._motion)

    def still(self) -> Motion:
        """Give the motion without its frames."""
        return self._motion.frames(slice(0))

    def group(self, number: int) -> Motion:  # noqa: ARG002  (there is but one)
        """Give all frames."""
        return self._motion


class GroupsAhead:
    """Keeps the group of a motion that is being played, and has the next one made on a thread of its own while it plays.

    A jump costs the group that it lands in and no other: the next one is asked for when the frame after the landing is.

    Args:
        source: of the groups.
        room: groups that are kept.
    """

    def __init__(self, source: MotionSource, room: int = 3) -> None:
        self._source, self._room = source, room
        self._groups: dict[int, Future[Motion]] = {}  # least recently wanted first
        self._last, self._closed = -2, False
        self._worker = ThreadPoolExecutor(1, "sacha-motion")

    def frame(self, index: int) -> tuple[Motion, int]:
        """Give the group that holds a frame, and the frame's row in it; waits if it is not there yet.

        Raises:
            OptionError: there is no such frame, or nothing can be asked for any more.
            FormatError: the group is damaged.
        """
        if self._closed:
            raise OptionError("the motion is closed; expected no more frames to be asked for")
        if not 0 <= index < len(self._source):
            there = f"frames 0 to {len(self._source) - 1}" if len(self._source) else "no frames"
            raise OptionError(f"frame {index} does not exist; the motion has {there}")
        number, row = divmod(index, self._source.group_frames)
        going_on, self._last = index == self._last + 1, index
        wanted = self._ask(number)
        if going_on:
            n_groups = -(-len(self._source) // self._source.group_frames)
            self._ask((number + 1) % n_groups)  # after the last the first, as who plays it again would want
        return wanted.result(), row

    def close(self) -> None:
        """Finish the group that is being made, if one is, and end the thread."""
        self._closed = True
        self._worker.shutdown(cancel_futures=True)

    def _ask(self, number: int) -> Future[Motion]:
        """Give the promise of a group; forget the one that was not wanted for longest where there is no more room."""
        future = self._groups.pop(number, None)
        if future is None:
            future = self._worker.submit(self._source.group, number)
        self._groups[number] = future
        if len(self._groups) > self._room:
            self._groups.pop(next(iter(self._groups))).cancel()
        return future
