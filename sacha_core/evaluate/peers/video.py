"""Grey pictures of 12 bits through HEVC, coded by libx265 at a fixed quantisation, by the package PyAV."""

from __future__ import annotations

import importlib.util
from collections.abc import Sequence
from fractions import Fraction
from typing import Any

import numpy as np
from jaxtyping import Int

from sacha_core.evaluate.peers.peer import PeerError

__all__ = ["DEPTH", "decode_video", "encode_video", "lacking"]

DEPTH = 12  # bits a sample
FORMAT = "gray12le"
COMMON = "log-level=none:info=0:pools=1:frame-threads=1:wpp=0:aud=0:repeat-headers=1:annexb=1:psy-rd=0:psy-rdoq=0:aq-mode=0:cutree=0:sao=0:strong-intra-smoothing=0:scenecut=0:bframes=0:open-gop=0:rd=6:tu-intra-depth=4:max-tu-size=32:min-cu-size=8:rdoq-level=2:hash=0"  # fmt: skip  # noqa: E501


def lacking() -> str | None:
    """Say whether PyAV, or libx265 in it, is missing."""
    if importlib.util.find_spec("av") is None:
        return "needs the package av: pip install 'sacha[shell]'"
    import av  # noqa: PLC0415 - a package that is not everybody's

    try:
        formats = av.codec.Codec("libx265", "w").video_formats or []
    except ValueError:
        return "needs a package av with libx265; this one has none"
    if FORMAT not in {one.name for one in formats}:
        return f"needs a libx265 of {DEPTH} bits; the one in the package av has less"
    return None


def encode_video(pictures: Sequence[Int[np.ndarray, "h w"]], qp: int | None, inter: bool = False) -> bytes:
    """Code pictures of one size, a multiple of 8 each way.

    Args:
        pictures: samples of 12 bits.
        qp: quantisation: the step is 2 ** ((qp + 20) / 6) of a sample's, 0 to 51; None for lossless coding.
        inter: whether a picture may be predicted from the one before it.

    Returns:
        The bytes of the stream (Annex B).

    Raises:
        PeerError: libx265 refuses.
    """
    import av  # noqa: PLC0415

    height, width = pictures[0].shape
    context: Any = av.codec.CodecContext.create("libx265", "w")
    context.width, context.height, context.pix_fmt = width, height, FORMAT
    context.time_base, context.framerate = Fraction(1, 25), Fraction(25)
    keys = "keyint=-1" if inter else "keyint=1"
    rate = "lossless=1" if qp is None else f"qp={qp}:ipratio=1"
    context.options = {"preset": "slower", "x265-params": f"{COMMON}:{rate}:{keys}"}
    packets = []
    try:
        for number, picture in enumerate(pictures):
            frame = av.VideoFrame.from_ndarray(np.ascontiguousarray(picture, "<u2"), format=FORMAT)
            frame.pts = number
            packets += context.encode(frame)
        packets += context.encode(None)
    except av.FFmpegError as error:
        raise PeerError(
            f"libx265 takes no {width} x {height} pictures at quantisation {qp}: {error.strerror}"
        ) from error
    return b"".join(bytes(packet) for packet in packets)


def decode_video(data: bytes) -> list[Int[np.ndarray, "h w"]]:
    """Decode what `encode_video` gave.

    Raises:
        PeerError: it does not decode.
    """
    import av  # noqa: PLC0415

    context: Any = av.codec.CodecContext.create("hevc", "r")
    context.thread_count = 1
    found = []
    for packet in [*context.parse(data), *context.parse(None), None]:
        found += [frame.to_ndarray().astype(np.int64) for frame in context.decode(packet)]
    if not found:
        raise PeerError("a video decoded to nothing")
    return found
