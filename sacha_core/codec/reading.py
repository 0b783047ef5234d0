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
        log: takes what each thing read has cost, for `spending`: bits, an array for every call that reads many. None keeps no account.
    """

    def __init__(self, data: bytes, name: str, offset: int = 0, log: list[Any] | None = None) -> None:
        self.log = log
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
        return ByteReader(self.take(n_bytes), self._name, offset, self.log)

    def unpack(self, layout: str) -> tuple[Any, ...]:
        """Give the next values of a little-endian `struct` layout."""
        return struct.unpack("<" + layout, self.take(struct.calcsize("<" + layout)))

    def text(self) -> str:
        """Give a string: a byte for its length in bytes, then UTF-8 without control characters."""
        (n_bytes,) = self.unpack("B")
        raw = self.take(n_bytes)
        try:
            text = raw.decode("utf-8")
        except UnicodeDecodeError as fault:
            raise self.error(f"a name is not UTF-8: {fault.reason}") from fault
        if has_control(text):
            raise self.error(f"a name has control characters: {text!a}")
        return text

    def check_end(self) -> None:
        """Check that nothing is left.

        Raises:
            FormatError: something is.
        """
        if self.left:
            raise self.error(f"{self.left} bytes are left over")


def has_control(text: str) -> bool:
    """Tell whether a name would steer the terminal that shows it: U+0000 to 1F, 7F to 9F, the same in every version of Unicode."""
    return any(character < " " or "\x7f" <= character <= "\x9f" for character in text)


def pack_text(text: str) -> bytes:
    """Write a string as `ByteReader.text` reads it, cut to 255 bytes at a character.

    Raises:
        FormatError: it has characters that a reader refuses.
    """
    if has_control(text) or any("\ud800" <= character <= "\udfff" for character in text):
        raise FormatError(
            f"the name {text!a} has control characters or unpaired surrogates, which the format does not hold"
        )
    raw = text.encode("utf-8")[:255].decode("utf-8", "ignore").encode("utf-8")
    return bytes([len(raw)]) + raw
