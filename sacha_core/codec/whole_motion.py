"""A motion that was decoded at once, in the shape of one that is decoded group by group."""

from __future__ import annotations

import math

from sacha_core.avatar.motion import Motion
from sacha_core.codec.reading import ByteReader

__all__ = ["WholeMotion", "read_frame_rate"]

MAX_FRAME_RATE = 1000


def read_frame_rate(reader: ByteReader) -> float:
    """Read the frame rate.

    Raises:
        FormatError: it is none.
    """
    (rate,) = reader.unpack("d")
    if not (math.isfinite(rate) and 0 < rate <= MAX_FRAME_RATE):
        raise reader.error(f"a frame rate of {rate}")
    return float(rate)


class WholeMotion:
    """All frames as one group, as `MotionReader` gives several.

    Args:
        motion: all frames.
    """

    def __init__(self, motion: Motion) -> None:
        self._motion = motion

    def __len__(self) -> int:
        """Give the number of frames."""
        return len(self._motion)

    @property
    def frame_rate(self) -> float:
        """Frames a second."""
        return self._motion.frame_rate

    @property
    def group_frames(self) -> int:
        """Frames in every group but the last."""
        return max(len(self._motion), 1)

    def still(self) -> Motion:
        """Give the motion without its frames: what the file says once about the person."""
        return self._motion.frames(slice(0))

    def group(self, number: int) -> Motion:
        """Give the frames of one group.

        Raises:
            IndexError: there is no such group.
        """
        if number != 0 or not len(self._motion):
            raise IndexError(f"motion group {number} does not exist; there are {min(len(self._motion), 1)}")
        return self._motion

    def all(self) -> Motion:
        """Give all frames."""
        return self._motion
