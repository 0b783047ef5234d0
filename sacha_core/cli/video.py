"""Writing a video file."""

from __future__ import annotations

from collections.abc import Iterable
from fractions import Fraction
from pathlib import Path
from typing import Final

import numpy as np
from jaxtyping import UInt8

from sacha_core.errors import OptionError
from sacha_core.files import write_aside

__all__ = ["write_video"]

QUALITY = "18"  # x264's constant rate factor: visually lossless
CODEC: Final = "libx264"


def write_video(path: Path, images: Iterable[UInt8[np.ndarray, "h w 3"]], frame_rate: float) -> None:
    """Write images as an H.264 video, whole or not at all.

    Args:
        path: the file, whose suffix names the container (.mp4, .mkv, .mov).
        images: (h, w, 3) RGB, all of one size; a row or column is repeated where a side is odd, which H.264 does not allow.
        frame_rate: images a second.

    Raises:
        OptionError: the suffix names no container of video.
        OSError: the file cannot be written.
    """
    import av

    if path.suffix.lower() not in {".mp4", ".mkv", ".mov"}:
        raise OptionError(f"{path}: expected a video's name to end in .mp4, .mkv or .mov")
    with write_aside(path) as aside, av.open(str(aside), "w") as container:
        stream = container.add_stream(CODEC, rate=Fraction(frame_rate).limit_denominator(1000))
        stream.pix_fmt = "yuv420p"
        stream.options = {"crf": QUALITY}
        for count, image in enumerate(images):
            even = np.pad(image, ((0, image.shape[0] % 2), (0, image.shape[1] % 2), (0, 0)), mode="edge")
            if count == 0:
                stream.height, stream.width = even.shape[:2]
            container.mux(stream.encode(av.VideoFrame.from_ndarray(np.ascontiguousarray(even), format="rgb24")))
        container.mux(stream.encode(None))
