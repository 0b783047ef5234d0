"""An avatar sent once, and its frames in packets, group by group, recorded or as they come.

Source: own.
"""

from __future__ import annotations

import zlib
from collections.abc import Iterator
from dataclasses import replace

import numpy as np

from sacha_core.avatar.avatar import Avatar
from sacha_core.avatar.motion import Motion
from sacha_core.codec.container import Section, pack_sections
from sacha_core.codec.decoder import Source, read_header, read_source
from sacha_core.codec.displacement import displacement_products
from sacha_core.codec.encoder import encode, pad
from sacha_core.codec.frame_fit import levels_of
from sacha_core.codec.frame_model import PARAMETERS, FrameModel
from sacha_core.codec.frame_search import search_frames
from sacha_core.codec.header import LOSSY
from sacha_core.codec.importance import GaussianImportance
from sacha_core.codec.levels import Level, level_named
from sacha_core.codec.motion import MotionReader
from sacha_core.codec.motion_writer import encode_groups, frame_task, pack_motion
from sacha_core.codec.packet import AVATAR, GROUP, Packet
from sacha_core.codec.sections import need, sections_of
from sacha_core.errors import FormatError, OptionError
from sacha_core.flame.model import HeadModel

__all__ = ["Encoder", "packets_of"]

GROUP_FRAMES = 25  # 1 s at 25 frames a second: what a lost packet costs, and how long a live one waits
MOST_NUMBERS = 1 << 15  # of a group, whatever its bytes


class Encoder:
    """Makes packets: first the avatar with all that groups need, then one for each group of frames.

    A recorded motion is the avatar's own: `packets`. Frames that are still to come are given to `push` as they do, then `finish` is called;
    the avatar's own motion then only shows what to expect, and may be short or have no frames.

    Args:
        avatar: with a motion, whose static parameters are sent once.
        level: as of `encode`.
        head: likewise; with it, steps of the frames follow the vertex error that the level aims at.
        group_frames: frames in a packet.
        live: whether frames other than the avatar's own are to come.
        embed_head, drop_invisible, importance: as of `encode`.

    Raises:
        FormatError, HeadError: as `encode` does.
        OptionError: an option is out of range, the avatar has no motion, or a packet would hold more than 32,768 numbers.
    """

    def __init__(
        self,
        avatar: Avatar,
        level: int | Level = 2,
        *,
        head: HeadModel | None = None,
        group_frames: int = GROUP_FRAMES,
        live: bool = False,
        embed_head: bool = False,
        drop_invisible: bool = True,
        importance: GaussianImportance | None = None,
    ) -> None:
        motion = avatar.motion
        if motion is None:
            raise OptionError(
                "an avatar to be sent needs a motion, if only one of no frames, that tells its parameters"
            )
        check_group(group_frames, motion.expression.shape[1] + 18)
        motion.validate()
        still = replace(avatar, motion=motion.frames(slice(0)))
        coded = encode(
            still,
            level,
            head=head,
            embed_head=embed_head,
            drop_invisible=drop_invisible,
            group_frames=group_frames,
            importance=importance,
        )
        chosen = level if isinstance(level, Level) else level_named(level)
        products = None if head is None else displacement_products(head, motion)
        self._task = frame_task(motion, chosen, group_frames, products, live=live)
        try:
            self._model = search_frames(self._task)
        except OverflowError as fault:
            raise FormatError(f"motion: {fault}") from fault
        section = pack_motion(self._model, [], motion.frame_rate, group_frames)
        self.first = avatar_packet(with_motion(coded, section), group_frames)
        self._motion, self._live, self._group_frames = motion, live, group_frames
        self._waiting = motion.frames(slice(0))
        self._number, self._finished = 0, False

    @property
    def model(self) -> FrameModel:
        """How frames are expected, for all groups."""
        return self._model

    def packets(self) -> Iterator[bytes]:
        """Give all packets of the avatar's own motion, the avatar first.

        Raises:
            OptionError: frames were pushed before, or the encoder was made for others.
        """
        if self._live or self._number or len(self._waiting):
            raise OptionError("packets() sends the avatar's own motion; push() was used, or the encoder is a live one")
        yield self.first
        yield from self.push(self._motion)
        yield from self.finish()

    def push(self, frames: Motion) -> list[bytes]:
        """Take frames as they come; give the packets of the groups that they complete, which may be none.

        Args:
            frames: whose static parameters are ignored.

        Raises:
            FormatError: they are not finite, or of other parameters than the avatar's motion, or beyond what the format holds.
            OptionError: the stream is finished.
        """
        if self._finished:
            raise OptionError("the stream is finished; expected no more frames")
        frames.validate()
        width, known = frames.expression.shape[1], self._motion.expression.shape[1]
        if width != known:
            raise FormatError(f"frames of {width} expression weights were pushed into a stream of {known}")
        both = {name: np.concatenate([getattr(self._waiting, name), getattr(frames, name)]) for name in PARAMETERS}
        waiting = Motion(self._motion.shape, self._motion.static_offset, **both, frame_rate=self._motion.frame_rate)
        whole = len(waiting) // self._group_frames * self._group_frames
        packets = self._coded(waiting.frames(slice(0, whole)))
        self._waiting = waiting.frames(slice(whole, None))
        return packets

    def finish(self) -> list[bytes]:
        """Give the packet of the frames that no group was full with, if there are any; nothing can be pushed afterwards."""
        packets = [] if self._finished else self._coded(self._waiting)
        self._waiting, self._finished = self._motion.frames(slice(0)), True
        return packets

    def _coded(self, motion: Motion) -> list[bytes]:
        """Give a packet for each group."""
        task = self._task.over(motion)
        try:
            levels_of(task.values, self._model.steps)
        except OverflowError as fault:
            raise FormatError(f"motion: {fault}") from fault
        stream = Packet.parse(self.first).stream
        packets = []
        for row, group in enumerate(encode_groups(task, self._model)):
            n_frames = min(self._group_frames, len(motion) - row * self._group_frames)
            self._number += 1
            packets.append(Packet(GROUP, stream, self._number, n_frames, group).pack())
        return packets


def packets_of(source: Source) -> Iterator[bytes]:
    """Give the packets of a file that is there already: the same bytes, cut at the groups.

    Args:
        source: the bytes of a `.sacha` file, or its path.

    Raises:
        FormatError: the file is damaged, or of a profile without groups.
        OptionError: it has no motion, or its groups are too long for packets.
        OSError: the file cannot be read.
    """
    data = read_source(source)
    _, sections = sections_of(data)
    header = read_header(data, sections)
    if header.profile != LOSSY:
        raise FormatError("only files of the lossy profile are in groups that packets could hold")
    if not header.has_motion:
        raise OptionError("a file without a motion makes no packets")
    nobody = np.zeros(0, np.float32), np.zeros((0, 3), np.float32)
    reader = MotionReader(need(sections, "Motion").reader(), header.n_frames, header.n_expression, *nobody)
    check_group(reader.group_frames, reader.n_parameters)
    section = pack_motion(reader.model, [], reader.frame_rate, reader.group_frames)
    first = avatar_packet(with_motion(data, section), reader.group_frames)
    yield first
    stream = Packet.parse(first).stream
    for number in range(reader.n_groups):
        n_frames = min(reader.group_frames, len(reader) - number * reader.group_frames)
        yield Packet(GROUP, stream, number + 1, n_frames, reader.coded(number)).pack()


def check_group(group_frames: int, n_parameters: int) -> None:
    """Check that a group fits into a packet."""
    most = MOST_NUMBERS // n_parameters
    if not isinstance(group_frames, (int, np.integer)):
        raise OptionError(f"group_frames is {group_frames!r}, expected a whole number from 1 to {most}")
    if not 1 <= group_frames <= most:
        raise OptionError(f"{group_frames} frames of {n_parameters} parameters in a packet, expected 1 to {most}")


def with_motion(coded: bytes, section: bytes) -> bytes:
    """Give a file with another motion section, which has no frames."""
    _, sections = sections_of(coded)
    header = replace(read_header(coded, sections), n_frames=0)
    changed = {"Header": header.pack(), "Motion": section}
    kept = [Section(s.name, changed.get(s.name, s.data)) for s in sections.values() if s.name != "padding"]
    return pack_sections(pad(kept, header))


def avatar_packet(coded: bytes, group_frames: int) -> bytes:
    """Give the packet of a file without frames; the stream is named by its checksum."""
    return Packet(AVATAR, zlib.crc32(coded), 0, group_frames, coded).pack()
