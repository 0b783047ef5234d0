"""A packet: an avatar or a group of frames, with what tells them from damage and from each other. FORMAT.md, "Packets".

Source: own.
"""

from __future__ import annotations

import struct
import zlib
from dataclasses import dataclass

from sacha_core.errors import FormatError, VersionError

__all__ = ["AVATAR", "GROUP", "Packet"]

LAYOUT = "IBBIIHI"  # CRC-32 of what follows, version, kind, stream, number, frames, bytes
HEAD_BYTES = struct.calcsize("<" + LAYOUT)
VERSION = 2
AVATAR, GROUP = 0, 1  # kinds


@dataclass(frozen=True)
class Packet:
    """One packet.

    Args:
        kind: `AVATAR` or `GROUP`.
        stream: which stream it belongs to.
        number: 0 for the avatar, then 1, 2, ... for groups.
        n_frames: in the group; of an avatar: in every group but the last.
        payload: a `.sacha` file without frames, or the bytes of a group.
    """

    kind: int
    stream: int
    number: int
    n_frames: int
    payload: bytes

    def pack(self) -> bytes:
        """Write the packet."""
        fields = (VERSION, self.kind, self.stream, self.number, self.n_frames, len(self.payload))
        body = struct.pack("<" + LAYOUT[1:], *fields) + self.payload
        return struct.pack("<I", zlib.crc32(body)) + body

    @classmethod
    def parse(cls, data: bytes) -> Packet:
        """Read a packet.

        Raises:
            FormatError: it is damaged or cut, or not one.
        """
        if len(data) < HEAD_BYTES:
            raise FormatError(f"a packet of {len(data)} bytes, expected at least {HEAD_BYTES}", 0)
        checksum, version, kind, stream, number, n_frames, n_bytes = struct.unpack_from("<" + LAYOUT, data)
        if zlib.crc32(memoryview(data)[4:]) != checksum:
            raise FormatError("the checksum of a packet is wrong: it is damaged or cut", 0)
        if version != VERSION:
            raise VersionError(f"a packet of version {version}; this decoder reads {VERSION}", 4)
        if n_bytes != len(data) - HEAD_BYTES:
            raise FormatError(f"a packet claims {n_bytes} bytes, it has {len(data) - HEAD_BYTES}", HEAD_BYTES - 4)
        if kind not in (AVATAR, GROUP) or (kind == AVATAR) != (number == 0) or n_frames == 0:
            raise FormatError(f"a packet of kind {kind} with number {number} and {n_frames} frames", 5)
        return cls(kind, stream, number, n_frames, bytes(data[HEAD_BYTES:]))
