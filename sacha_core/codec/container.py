"""The container: magic, version, a table of sections with lengths and checksums, then the sections.

Section names follow PNG's rule: a name with a capital first letter must be understood to decode the file, one with a small letter may be
skipped. FORMAT.md, "Container", is the specification.

Source: own.
"""

from __future__ import annotations

import struct
import zlib
from dataclasses import dataclass, field
from typing import Any

from sacha_core.codec.reading import ByteReader
from sacha_core.errors import FormatError, VersionError

__all__ = ["MAGIC", "MAJOR", "MINOR", "Section", "pack_sections", "parse_sections"]

MAGIC = b"SACHA\r\n\x1a"  # as PNG: the line end and the end-of-file byte catch transfers as text
MAJOR = 2  # 1.x was never released
MINOR = 0
PREFIX = (
    "8sHHIQI"  # magic, major, minor, number of sections, bytes of the file, CRC-32 of all this (as 0) and the table
)
ENTRY = "8sII"  # name padded with zeros, bytes, CRC-32
PREFIX_BYTES = struct.calcsize("<" + PREFIX)
ENTRY_BYTES = struct.calcsize("<" + ENTRY)
MAX_SECTIONS = 256


@dataclass(frozen=True)
class Section:
    """One named run of bytes.

    Args:
        name: 1 to 8 ASCII letters; with a capital first letter, a decoder that does not know it must refuse the file.
        data: its bytes.
        offset: of `data` in the file.
        log: takes what its parts cost while they are read; see `ByteReader`.
    """

    name: str
    data: bytes
    offset: int = 0
    log: list[Any] | None = field(default=None, compare=False)

    def reader(self) -> ByteReader:
        """Give a reader over the bytes."""
        return ByteReader(self.data, self.name, self.offset, self.log)


def pack_sections(sections: list[Section]) -> bytes:
    """Write a whole file of `sections`, in that order."""
    table = b"".join(
        struct.pack("<" + ENTRY, section.name.encode("ascii"), len(section.data), zlib.crc32(section.data))
        for section in sections
    )
    n_bytes = PREFIX_BYTES + len(table) + sum(len(section.data) for section in sections)
    unsealed = struct.pack("<" + PREFIX, MAGIC, MAJOR, MINOR, len(sections), n_bytes, 0)
    prefix = unsealed[:-4] + struct.pack("<I", zlib.crc32(unsealed + table))
    return b"".join([prefix, table, *(section.data for section in sections)])


def parse_sections(data: bytes) -> tuple[tuple[int, int], dict[str, Section]]:
    """Split a file into its sections, checking every length and checksum.

    Returns:
        Version (major, minor) and the sections by name, in file order.

    Raises:
        FormatError: not such a file, of a newer major version, cut, or damaged; with the offset.
    """
    reader = ByteReader(data, "container")
    if not data.startswith(MAGIC):
        raise FormatError("not a .sacha file: it does not begin with the signature 'SACHA'", 0)
    if len(data) < PREFIX_BYTES:
        raise FormatError(f"the file ends after {len(data)} bytes, inside its {PREFIX_BYTES}-byte prefix", len(data))
    _, major, minor, n_sections, n_bytes, checksum = reader.unpack(PREFIX)
    if major != MAJOR:
        age = "newer" if major > MAJOR else "older"
        raise VersionError(f"the file is of version {major}.{minor}, {age} than this decoder, which reads {MAJOR}.x", 8)
    if n_bytes != len(data):
        raise FormatError(f"the file has {len(data)} bytes, its prefix says {n_bytes}", 16)
    if n_sections > MAX_SECTIONS:
        raise FormatError(f"the file claims {n_sections} sections, at most {MAX_SECTIONS} are allowed", 12)
    table = reader.take(n_sections * ENTRY_BYTES)
    if zlib.crc32(data[: PREFIX_BYTES - 4] + bytes(4) + table) != checksum:
        raise FormatError("the checksum of the section table is wrong: the file is damaged", PREFIX_BYTES - 4)
    return (major, minor), cut_sections(data, table)


def cut_sections(data: bytes, table: bytes) -> dict[str, Section]:
    """Cut the sections that `table` lists out of `data` and check each."""
    sections: dict[str, Section] = {}
    start = PREFIX_BYTES + len(table)
    for row, (raw, n_bytes, checksum) in enumerate(struct.iter_unpack("<" + ENTRY, table)):
        at = PREFIX_BYTES + row * ENTRY_BYTES
        stripped = raw.rstrip(b"\0")
        if not (stripped.isalpha() and stripped.isascii()):
            raise FormatError(f"section {row} has the name {raw!r}, expected ASCII letters padded with zeros", at)
        name = stripped.decode("ascii")
        if name in sections:
            raise FormatError(f"section {name!r} occurs twice", at)
        if n_bytes > len(data) - start:
            raise FormatError(f"section {name!r} claims {n_bytes} bytes, {len(data) - start} are left", at + 8)
        body = data[start : start + n_bytes]
        if zlib.crc32(body) != checksum:
            raise FormatError(f"the checksum of section {name!r} is wrong: the file is damaged", start)
        sections[name] = Section(name, body, start)
        start += n_bytes
    if start != len(data):
        raise FormatError(f"{len(data) - start} bytes follow the last section", start)
    return sections
