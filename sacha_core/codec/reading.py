"""Reading bytes that may be hostile: every field is checked against what is left, every error names its offset."""

from __future__ import annotations

import struct
from typing import Any

from sacha_core.errors import FormatError

__all__ = ["ByteReader"]


class ByteReader:
    """Walks over `data`, which starts at byte `offset` of its file.

    Args:
        data: the bytes of one section.
        name: of the section, for messages.
        offset: of the section in its file.
    """

    def __init__(self, data: bytes, name: str, offset: int = 0) -> None:
        self._data = data
        self._at = 0
        self._name = name
        self._base = offset

    @property
    def offset(self) -> int:
        """Where the next byte lies in the file."""
        return self._base + self._at

    @property
    def left(self) -> int:
        """How many bytes are left in the section."""
        return len(self._data) - self._at

    def error(self, message: str) -> FormatError:
        """Give (not raise) the error that `message` describes, at the current offset."""
        return FormatError(f"section {self._name!r}: {message}", self.offset)

    def take(self, n_bytes: int) -> bytes:
        """Give the next `n_bytes` bytes.

        Raises:
            FormatError: fewer are left.
        """
        if n_bytes > self.left:
            raise self.error(f"{n_bytes} bytes expected, {self.left} left")
        self._at += n_bytes
        return self._data[self._at - n_bytes : self._at]

    def part(self, n_bytes: int) -> ByteReader:
        """Give a reader over the next `n_bytes` bytes alone."""
        offset = self.offset
        return ByteReader(self.take(n_bytes), self._name, offset)

    def unpack(self, layout: str) -> tuple[Any, ...]:
        """Give the next values of a little-endian `struct` layout."""
        return struct.unpack("<" + layout, self.take(struct.calcsize("<" + layout)))

    def text(self) -> str:
        """Give a string: a byte for its length in bytes, then printable UTF-8."""
        (n_bytes,) = self.unpack("B")
        raw = self.take(n_bytes)
        try:
            text = raw.decode("utf-8")
        except UnicodeDecodeError as fault:
            raise self.error(f"a name is not UTF-8: {fault.reason}") from fault
        if not text.isprintable():  # it will be shown in a terminal
            raise self.error(f"a name has unprintable characters: {text!r}")
        return text

    def check_end(self) -> None:
        """Check that nothing is left.

        Raises:
            FormatError: something is.
        """
        if self.left:
            raise self.error(f"{self.left} bytes are left over")


def pack_text(text: str) -> bytes:
    """Write a string as `ByteReader.text` reads it, cut to 255 bytes at a character."""
    raw = text.encode("utf-8")[:255].decode("utf-8", "ignore").encode("utf-8")
    return bytes([len(raw)]) + raw
