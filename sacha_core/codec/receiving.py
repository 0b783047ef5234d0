"""Packets into an avatar and its frames, as they come and whatever becomes of some of them.

Source: own.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

from sacha_core.avatar.avatar import Avatar
from sacha_core.avatar.motion import Motion
from sacha_core.codec.decoder import open_stream
from sacha_core.codec.motion import MotionReader
from sacha_core.codec.packet import AVATAR, Packet
from sacha_core.codec.whole_motion import WholeMotion
from sacha_core.errors import FormatError
from sacha_core.flame.model import HeadModel

__all__ = ["Decoder", "Received"]

MOST_NUMBERS, NUMBERS_PER_BYTE = 1 << 15, 32  # of a group
MOST_MISSING = 4096  # groups whose late arrival is still noticed as such
EARLY_PACKETS, EARLY_BYTES = 64, 1 << 20  # that are kept until the avatar comes


@dataclass(frozen=True)
class Received:
    """What became of a packet.

    Args:
        kind: `avatar`: the avatar is there; `frames`: a group was decoded; `early`: a group is kept until the avatar comes; `repeated`: it
            was there before; `foreign`: it belongs to another stream; `damaged`: it, or what it holds, makes no sense.
        number: of the packet, 0 for the avatar; -1 where that is not known.
        first_frame: number of the first of `frames` in the stream.
        frames: of a group.
        problem: what is wrong, in a line.
    """

    kind: Literal["avatar", "frames", "early", "repeated", "foreign", "damaged"]
    number: int
    first_frame: int = 0
    frames: Motion | None = None
    problem: str = ""


class Decoder:
    """Takes packets in any order and gives frames; can join a stream at any group, once it has the avatar.

    A packet that is lost, repeated, late or damaged costs at most its own group. Another avatar begins another stream.

    Args:
        head: the head model that the avatar is bound to, as of `decode`.
    """

    def __init__(self, head: HeadModel | None = None) -> None:
        self._head = head
        self._motion: MotionReader | None = None
        self._stream: int | None = None
        self._early: list[Packet] = []
        self.avatar: Avatar | None = None  # as soon as it is there; its motion has no frames
        self._forget()

    @property
    def frame_rate(self) -> float | None:
        """Frames a second, as soon as the avatar is there."""
        return None if self._motion is None else self._motion.frame_rate

    @property
    def lost(self) -> int:
        """How many groups did not come (yet) between the first one and the last one that did."""
        return self._last - self._first + 1 - self._came if self._came else 0

    @property
    def missing(self) -> tuple[int, ...]:
        """Numbers of the packets that did not come (yet), in order; of very many only the latest."""
        return tuple(sorted(self._missing))

    def feed(self, packet: bytes) -> list[Received]:
        """Take a packet.

        Args:
            packet: one, whole, as the transport gave it.

        Returns:
            What became of it; after an avatar, also of groups that came before.

        Raises:
            HeadError: the avatar needs a head that is not to be found, or another one was given.
        """
        try:
            parsed = Packet.parse(packet)
        except FormatError as error:
            return [Received("damaged", -1, problem=str(error))]
        if parsed.kind == AVATAR:
            return self._take_avatar(parsed)
        if self._motion is None:
            return [self._keep(parsed)]
        if parsed.stream != self._stream:
            problem = f"a group of stream {parsed.stream:#010x}, this one is {self._stream:#010x}"
            return [Received("foreign", parsed.number, problem=problem)]
        return [self._take_group(parsed, self._motion)]

    def _forget(self) -> None:
        """Begin a stream."""
        self._first = self._last = self._came = 0
        self._missing: set[int] = set()

    def _take_avatar(self, packet: Packet) -> list[Received]:
        if self._motion is not None and packet.stream == self._stream:
            return [Received("repeated", 0)]
        try:
            opened = open_stream(packet.payload, head=self._head)
            motion = motion_to_come(opened.motion, packet.n_frames)
        except FormatError as error:
            return [Received("damaged", 0, problem=str(error))]
        self.avatar = Avatar(opened.gaussians, opened.head, motion.still(), opened.scheme)
        self._motion, self._stream = motion, packet.stream
        self._forget()
        early, self._early = self._early, []
        mine = [self._take_group(one, motion) for one in early if one.stream == packet.stream]
        return [Received("avatar", 0), *mine]

    def _keep(self, packet: Packet) -> Received:
        """Keep a group until the avatar comes; the oldest make room."""
        if len(packet.payload) > EARLY_BYTES:
            return Received(
                "damaged", packet.number, problem=f"a group of {len(packet.payload)} bytes before any avatar"
            )
        self._early.append(packet)
        while len(self._early) > EARLY_PACKETS or sum(len(one.payload) for one in self._early) > EARLY_BYTES:
            self._early.pop(0)
        return Received("early", packet.number)

    def _take_group(self, packet: Packet, motion: MotionReader) -> Received:
        number = packet.number
        if self._came and self._first <= number <= self._last and number not in self._missing:
            return Received("repeated", number)
        try:
            frames = frames_of(packet, motion)
        except FormatError as error:
            return Received("damaged", number, problem=str(error))
        self._note(number)
        return Received("frames", number, (number - 1) * motion.group_frames, frames)

    def _note(self, number: int) -> None:
        """Remember which groups came and which did not."""
        if not self._came:
            self._first = self._last = number
        gap = range(self._last + 1, number) if number > self._last else range(number + 1, self._first)
        self._missing |= set(gap[-MOST_MISSING:])
        self._missing.discard(number)
        if len(self._missing) > MOST_MISSING:
            self._missing = set(sorted(self._missing)[-MOST_MISSING:])
        self._first, self._last = min(self._first, number), max(self._last, number)
        self._came += 1


def motion_to_come(motion: MotionReader | WholeMotion | None, group_frames: int) -> MotionReader:
    """Give the motion of an avatar, whose frames are to come.

    Raises:
        FormatError: it is not what the avatar of a stream has.
    """
    if not isinstance(motion, MotionReader):
        raise FormatError("the avatar of a stream says nothing about its frames")
    if len(motion) or motion.group_frames != group_frames:
        raise FormatError("the avatar of a stream has frames itself, or groups of another length than its packet")
    return motion


def frames_of(packet: Packet, motion: MotionReader) -> Motion:
    """Decode a group.

    Raises:
        FormatError: it claims more frames than it may hold, or its bytes are not what an encoder writes.
    """
    most = MOST_NUMBERS + NUMBERS_PER_BYTE * len(packet.payload)
    if packet.n_frames > motion.group_frames or packet.n_frames * motion.n_parameters > most:
        raise FormatError(f"group {packet.number} claims {packet.n_frames} frames, more than it may hold")
    return motion.decode_coded(packet.payload, packet.n_frames, f"group {packet.number}")
