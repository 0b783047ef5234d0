r"""Section `Motion`: the parameters of every frame, in groups that can each be decoded alone.

Every parameter is a multiple $x_t$ of its step. Within a group it is predicted from the two frames before,
$x_{t-1} + d (x_{t-1} - x_{t-2})$, with a damping $d$ in eighths for each kind of parameter (0: from the frame before alone); the first
frame of a group is coded against a base frame that is sent once. An index gives the length and the checksum of each group.

Source: damping and contexts own; prediction from reconstructed frames and binary arithmetic coding as the SACHA paper describes them.
"""

from __future__ import annotations

import math
import struct
import zlib
from dataclasses import dataclass

import numpy as np
from jaxtyping import Float, Int

from sacha_core.avatar.motion import Motion
from sacha_core.codec.adaptive import AdaptiveDecoder, AdaptiveEncoder
from sacha_core.codec.levels import Level
from sacha_core.codec.reading import ByteReader
from sacha_core.codec.static import MAX_LEVEL, read_step, to_levels
from sacha_core.errors import FormatError

__all__ = ["MotionHead", "MotionReader", "decode_group", "encode_motion", "read_motion_head"]

PARAMETERS = ("expression", "rotation", "neck", "jaw", "eyes", "translation")
WIDTHS = (0, 3, 3, 3, 6, 3)  # of an expression the header tells
STEP_OF = (0, 1, 1, 1, 1, 2)  # expression, angle, translation
LAYOUT = (
    "dH6BI"  # frame rate, frames in a group, damping of each parameter, bytes of the base frame; before it three steps
)
INDEX = "II"  # bytes of a group, CRC-32
EIGHTHS = 8
HISTORY = 4  # classes of the difference one frame before
N_CONTEXTS = len(PARAMETERS) * (HISTORY + 1)


@dataclass(frozen=True)
class MotionHead:
    """What precedes the groups.

    Args:
        frame_rate: frames a second.
        steps: (p,) quantiser step of each parameter of a frame.
        kinds: (p,) index into PARAMETERS.
        group_frames: frames in every group but the last.
        damping: (p,) in eighths.
        base: (p,) levels that first frames are coded against.
        groups: first byte (in the section), bytes and checksum of each group.
    """

    frame_rate: float
    steps: Float[np.ndarray, " p"]
    kinds: Int[np.ndarray, " p"]
    group_frames: int
    damping: Int[np.ndarray, " p"]
    base: Int[np.ndarray, " p"]
    groups: tuple[tuple[int, int, int], ...]


def kinds_of(n_expression: int) -> Int[np.ndarray, " p"]:
    """Give the parameter that each number of a frame belongs to."""
    return np.repeat(np.arange(len(PARAMETERS)), [n_expression, *WIDTHS[1:]])


def predict(
    last: Int[np.ndarray, " p"], before: Int[np.ndarray, " p"], damping: Int[np.ndarray, " p"]
) -> Int[np.ndarray, " p"]:
    """Expected levels of a frame from the two before."""
    return np.asarray(last + (((last - before) * damping + EIGHTHS // 2) >> 3))


def contexts_of(kinds: Int[np.ndarray, " p"], difference: Int[np.ndarray, " p"] | None) -> Int[np.ndarray, " p"]:
    """Context of each parameter: its kind, and how far the prediction was off one frame before (None: a first frame)."""
    history = HISTORY if difference is None else np.minimum(np.abs(difference), HISTORY - 1)
    return kinds * (HISTORY + 1) + history


def differences_of(
    levels: Int[np.ndarray, "t p"], base: Int[np.ndarray, " p"], damping: Int[np.ndarray, " p"]
) -> Int[np.ndarray, "t p"]:
    """Differences that a group is coded as."""
    before = np.concatenate([levels[:1], levels[:-2]])[: len(levels) - 1]
    expected = predict(levels[:-1], before, damping)
    return np.asarray(levels - np.concatenate([base[None], expected]))


def fit_damping(levels: Int[np.ndarray, "t p"], kinds: Int[np.ndarray, " p"]) -> Int[np.ndarray, " k"]:
    """Damping for each kind of parameter that leaves the smallest differences."""
    cost = np.zeros((EIGHTHS + 1, len(PARAMETERS)))
    for eighths in range(EIGHTHS + 1):
        off = np.abs(differences_of(levels, levels[0], np.full(len(kinds), eighths)))
        cost[eighths] = np.bincount(kinds, np.log2(1.0 + off).sum(axis=0), minlength=len(PARAMETERS))
    return np.asarray(np.argmin(cost, axis=0))


def encode_group(
    levels: Int[np.ndarray, "t p"],
    base: Int[np.ndarray, " p"],
    damping: Int[np.ndarray, " p"],
    kinds: Int[np.ndarray, " p"],
    expected: int,
) -> bytes:
    """Code the frames of one group; `expected` integers are coded in all groups together."""
    coder = AdaptiveEncoder(N_CONTEXTS, expected)
    last = None
    for difference in differences_of(levels, base, damping):
        coder.write(difference, contexts_of(kinds, last))
        last = difference
    return coder.finish()


def encode_motion(motion: Motion, level: Level, group_frames: int) -> bytes:
    """Code all frames."""
    steps = (level.expression_step, level.angle_step_rad, level.translation_step)
    parts = [getattr(motion, name) for name in PARAMETERS]
    levels = np.concatenate([to_levels(part, steps[s]) for part, s in zip(parts, STEP_OF, strict=True)], axis=1)
    kinds = kinds_of(motion.expression.shape[1])
    t = len(levels)
    base = np.median(levels, axis=0).astype(np.int64) if t else np.zeros(len(kinds), np.int64)
    kind_damping = fit_damping(levels, kinds) if t else np.zeros(len(PARAMETERS), np.int64)
    base_coder = AdaptiveEncoder(len(PARAMETERS))
    base_coder.write(base, kinds)
    coded_base = base_coder.finish()
    starts = range(0, t, group_frames)
    damping = kind_damping[kinds]
    groups = [encode_group(levels[at : at + group_frames], base, damping, kinds, levels.size) for at in starts]
    index = b"".join(struct.pack("<" + INDEX, len(group), zlib.crc32(group)) for group in groups)
    head = struct.pack("<3d" + LAYOUT, *steps, motion.frame_rate, group_frames, *kind_damping, len(coded_base))
    return b"".join([head, coded_base, index, *groups])


def read_motion_head(reader: ByteReader, n_frames: int, n_expression: int) -> MotionHead:
    """Read everything up to the groups.

    Raises:
        FormatError: a field is out of range, or the groups do not fill the section.
    """
    steps = np.array([read_step(reader) for _ in range(3)])
    frame_rate, group_frames, *rest = reader.unpack(LAYOUT)
    damping, base_bytes = np.array(rest[:-1], np.int64), rest[-1]
    if not (math.isfinite(frame_rate) and 0 < frame_rate <= 1000):
        raise reader.error(f"a frame rate of {frame_rate}")
    if damping.max() > EIGHTHS or group_frames == 0:
        raise reader.error(f"groups of {group_frames} frames, damping of up to {damping.max()} eighths")
    kinds = kinds_of(n_expression)
    offset = reader.offset
    coder = AdaptiveDecoder(reader.take(base_bytes), len(PARAMETERS), offset=offset)
    base = coder.read(kinds)
    coder.check_end()
    if np.abs(base).max(initial=0) > MAX_LEVEL:
        raise reader.error(f"a base level beyond {MAX_LEVEL}")
    index = [reader.unpack(INDEX) for _ in range(-(-n_frames // group_frames))]
    ends = np.cumsum([0, *(n_bytes for n_bytes, _ in index)])
    if ends[-1] != reader.left:
        raise reader.error(f"groups take {ends[-1]} bytes, {reader.left} are left")
    groups = tuple((int(start), n_bytes, checksum) for start, (n_bytes, checksum) in zip(ends, index, strict=False))
    by_kind = steps[np.array(STEP_OF)]
    return MotionHead(frame_rate, by_kind[kinds], kinds, group_frames, damping[kinds], base, groups)


def decode_group(
    data: bytes, n_frames: int, head: MotionHead, offset: int | None = None, expected: int = 0
) -> Int[np.ndarray, "t p"]:
    """Read the levels of one group; nothing but the head is needed.

    Args:
        data: of the group.
        n_frames: in it.
        head: what precedes the groups.
        offset: where `data` lies in its file, for messages.
        expected: roughly how many integers the caller will read, this group's included.

    Raises:
        FormatError: the bytes are not what an encoder writes.
    """
    coder = AdaptiveDecoder(data, N_CONTEXTS, max(expected, n_frames * len(head.kinds)), offset=offset)
    levels = np.zeros((n_frames, len(head.kinds)), np.int64)
    difference = None
    for t in range(n_frames):
        expected_levels = predict(levels[t - 1], levels[max(t - 2, 0)], head.damping) if t else head.base
        difference = coder.read(contexts_of(head.kinds, difference))
        levels[t] = expected_levels + difference
        if np.abs(levels[t]).max(initial=0) > MAX_LEVEL:
            raise coder.error(f"frame {t} of a group has a level beyond {MAX_LEVEL}")
    coder.check_end()
    return levels


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

    def still(self) -> Motion:
        """Give the motion without its frames: what the file says once about the person."""
        return self._motion(np.zeros((0, len(self._head.kinds)), np.int64))

    def group(self, number: int) -> Motion:
        """Decode the frames `number` * `group_frames` and on, of one group.

        Raises:
            IndexError: there is no such group.
            FormatError: it is damaged, or its bytes are not what an encoder writes; the message names it.
        """
        return self._checked(number, self._levels(number))

    def all(self) -> Motion:
        """Decode all frames.

        Raises:
            FormatError: as for `group`.
        """
        n_integers = self._n_frames * len(self._head.kinds)
        parts = [self._levels(number, n_integers) for number in range(len(self._head.groups))]
        for number, levels in enumerate(parts):
            self._checked(number, levels)
        return self._motion(np.concatenate([np.zeros((0, len(self._head.kinds)), np.int64), *parts]))

    def _levels(self, number: int, expected: int = 0) -> Int[np.ndarray, "t p"]:
        if not 0 <= number < len(self._head.groups):
            raise IndexError(f"motion group {number} does not exist; there are {len(self._head.groups)}")
        start, n_bytes, checksum = self._head.groups[number]
        data = self._data[start : start + n_bytes]
        if zlib.crc32(data) != checksum:
            raise FormatError(f"the checksum of motion group {number} is wrong", self._offset + start)
        n_frames = min(self.group_frames, self._n_frames - number * self.group_frames)
        try:
            return decode_group(data, n_frames, self._head, self._offset + start, expected)
        except FormatError as error:
            raise self._named(number, error) from error

    def _checked(self, number: int, levels: Int[np.ndarray, "t p"]) -> Motion:
        """Give the motion of a group's levels, each of a size that a head can have."""
        motion = self._motion(levels)
        try:
            motion.validate()
        except FormatError as error:
            raise self._named(number, error) from error
        return motion

    def _named(self, number: int, error: FormatError) -> FormatError:
        start = self._offset + self._head.groups[number][0]
        return FormatError(f"motion group {number}: {error.reason}", start if error.offset is None else error.offset)

    def _motion(self, levels: Int[np.ndarray, "t p"]) -> Motion:
        values = (levels.astype(np.float64) * self._head.steps).astype(np.float32)
        columns = {name: values[:, self._head.kinds == kind] for kind, name in enumerate(PARAMETERS)}
        return Motion(*self._static, **columns, frame_rate=self.frame_rate)
