r"""Section `Motion`: the parameters of every frame, in groups that can each be decoded alone.

Every parameter is a multiple of a sixteenth of its step. Within a group it is expected from the two frames before, damped and pulled
towards a base, and from the parameters before it in the same frame; what it is off by is sent in whole steps. What all groups need is sent
once, in front (`frame_model`).

Source: own; prediction from reconstructed frames and binary arithmetic coding as the SACHA paper describes them.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from jaxtyping import Float, Int

from sacha_core.avatar.motion import Motion
from sacha_core.codec.frame_coder import decode_frames
from sacha_core.codec.frame_model import PARAMETERS, FrameModel
from sacha_core.codec.reading import ByteReader
from sacha_core.errors import FormatError

__all__ = ["MotionHead", "MotionReader", "read_motion_head"]


@dataclass(frozen=True)
class MotionHead:
    """What precedes the groups.

    Args:
        frame_rate: frames a second.
        group_frames: frames in every group but the last.
        model: how frames are expected.
        groups: first byte (in what follows) and bytes of each group.
    """

    frame_rate: float
    group_frames: int
    model: FrameModel
    groups: tuple[tuple[int, int], ...]


def read_length(reader: ByteReader) -> int:
    """Read a length.

    Raises:
        FormatError: it takes more than five bytes.
    """
    length = 0
    for shift in range(0, 35, 7):
        byte = int(reader.unpack("B")[0])
        length |= (byte & 0x7F) << shift
        if byte < 0x80:
            return length
    raise reader.error("a length of more than five bytes")


def read_motion_head(reader: ByteReader, n_frames: int, n_expression: int) -> MotionHead:
    """Read everything up to the groups.

    Raises:
        FormatError: a field is out of range, or the groups do not fill the section.
    """
    frame_rate, group_frames = reader.unpack("dH")
    if not (math.isfinite(frame_rate) and 0 < frame_rate <= 1000):
        raise reader.error(f"a frame rate of {frame_rate}")
    if group_frames == 0:
        raise reader.error("groups of no frames")
    model = FrameModel.read(reader, n_expression)
    lengths = [read_length(reader) for _ in range(-(-n_frames // group_frames))]
    ends = np.cumsum([0, *lengths])
    if ends[-1] != reader.left:
        raise reader.error(f"groups take {ends[-1]} bytes, {reader.left} are left")
    groups = tuple((int(start), n_bytes) for start, n_bytes in zip(ends, lengths, strict=False))
    return MotionHead(frame_rate, group_frames, model, groups)


class MotionReader:
    """The motion of a file, of which any group can be decoded alone.

    Args:
        reader: over the section.
        n_frames: of the motion.
        n_expression: expression coefficients a frame.
        shape: identity coefficients, which the file says once.
        static_offset: personal vertex offsets, likewise.

    Raises:
        FormatError: what precedes the groups is not what an encoder writes.
    """

    def __init__(
        self,
        reader: ByteReader,
        n_frames: int,
        n_expression: int,
        shape: Float[np.ndarray, " s"],
        static_offset: Float[np.ndarray, "v 3"],
    ) -> None:
        self._head = read_motion_head(reader, n_frames, n_expression)
        self._n_frames, self._static = n_frames, (shape, static_offset)
        self._offset, self._data = reader.offset, reader.take(reader.left)

    def __len__(self) -> int:
        """Give the number of frames."""
        return self._n_frames

    @property
    def frame_rate(self) -> float:
        """Frames a second."""
        return self._head.frame_rate

    @property
    def group_frames(self) -> int:
        """Frames in every group but the last."""
        return self._head.group_frames

    @property
    def model(self) -> FrameModel:
        """How frames are expected, for all groups."""
        return self._head.model

    @property
    def n_parameters(self) -> int:
        """Numbers of a frame."""
        return len(self._head.model.kinds)

    @property
    def n_groups(self) -> int:
        """Groups in the file."""
        return len(self._head.groups)

    def still(self) -> Motion:
        """Give the motion without its frames: what the file says once about the person."""
        return self._motion(np.zeros((0, len(self._head.model.size)), np.int64))

    def group(self, number: int) -> Motion:
        """Decode the frames `number` * `group_frames` and on, of one group.

        Raises:
            IndexError: there is no such group.
            FormatError: its bytes are not what an encoder writes; the message names it.
        """
        return self._checked(number, self._units(number))

    def all(self) -> Motion:
        """Decode all frames.

        Raises:
            FormatError: as for `group`.
        """
        n_integers = self._n_frames * len(self._head.model.size)
        parts = [self._units(number, n_integers) for number in range(self.n_groups)]
        for number, units in enumerate(parts):
            self._checked(number, units)
        return self._motion(np.concatenate([np.zeros((0, len(self._head.model.size)), np.int64), *parts]))

    def coded(self, number: int) -> bytes:
        """Give the bytes of a group as they are."""
        start, n_bytes = self._head.groups[number]
        return self._data[start : start + n_bytes]

    def decode_coded(self, data: bytes, n_frames: int, name: str = "motion group") -> Motion:
        """Decode a group that came by another way.

        Args:
            data: as `coded` gives it.
            n_frames: in the group.
            name: for messages.

        Raises:
            FormatError: its bytes are not what an encoder writes.
        """
        try:
            motion = self._motion(decode_frames(data, n_frames, self._head.model))
            motion.validate()
        except FormatError as error:
            raise FormatError(f"{name}: {error.reason}", error.offset) from error
        return motion

    def _units(self, number: int, expected: int = 0) -> Int[np.ndarray, "t q"]:
        if not 0 <= number < self.n_groups:
            raise IndexError(f"motion group {number} does not exist; there are {self.n_groups}")
        n_frames = min(self.group_frames, self._n_frames - number * self.group_frames)
        start = self._offset + self._head.groups[number][0]
        try:
            return decode_frames(self.coded(number), n_frames, self._head.model, start, expected)
        except FormatError as error:
            raise self._named(number, error) from error

    def _checked(self, number: int, units: Int[np.ndarray, "t q"]) -> Motion:
        """Give the motion of a group, each value of a size that a head can have."""
        motion = self._motion(units)
        try:
            motion.validate()
        except FormatError as error:
            raise self._named(number, error) from error
        return motion

    def _named(self, number: int, error: FormatError) -> FormatError:
        start = self._offset + self._head.groups[number][0]
        return FormatError(f"motion group {number}: {error.reason}", start if error.offset is None else error.offset)

    def _motion(self, units: Int[np.ndarray, "t q"]) -> Motion:
        values, kinds = self._head.model.values(units), self._head.model.kinds
        columns = {name: values[:, kinds == kind] for kind, name in enumerate(PARAMETERS)}
        return Motion(*self._static, **columns, frame_rate=self.frame_rate)
