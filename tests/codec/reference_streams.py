"""Strings of bytes into integers, in plain Python, written from FORMAT.md alone: container, adaptive integers, residuals, tokens."""

from __future__ import annotations

import struct
import zlib
from collections.abc import Iterable, Sequence

import numpy as np
from reference_coder import StackDecoder, cumulative

# "Residuals", the table: probabilities of a 0 of the first model of a class, and of its others
FIRST = (
    64330, 63836, 63146, 62182, 60846, 59008, 56514, 53191, 48887, 43539, 37278, 30518, 23892, 18012, 13217, 9536, 17875, 13199,
)  # fmt: skip
MORE = (
    64927, 64675, 64319, 63815, 63104, 62101, 60692, 58722, 56000, 52319, 47524, 41644, 35018, 28258, 21997, 16649, 22364, 16802,
)  # fmt: skip


class Fields:
    """Walks over the fields of a section."""

    def __init__(self, data: bytes) -> None:
        self.data, self.at = data, 0

    def read(self, layout: str) -> tuple:
        """Give the next values of a little-endian layout."""
        values = struct.unpack_from("<" + layout, self.data, self.at)
        self.at += struct.calcsize("<" + layout)
        return values

    def take(self, n_bytes: int | None = None) -> bytes:
        """Give the next bytes, or all that are left."""
        end = len(self.data) if n_bytes is None else self.at + n_bytes
        part, self.at = self.data[self.at : end], end
        assert end <= len(self.data)
        return part

    def text(self) -> str:
        """Give a text."""
        return self.take(*self.read("B")).decode()


def sections_of(data: bytes) -> dict[str, bytes]:
    """Split the container."""
    fields = Fields(data)
    _, major, _, n_sections, n_bytes, checksum = fields.read("8sHHIQI")
    table = fields.take(16 * n_sections)
    assert (major, n_bytes, checksum) == (2, len(data), zlib.crc32(data[:24] + bytes(4) + table))
    return {name.rstrip(b"\0").decode(): fields.take(n) for name, n, _ in struct.iter_unpack("<8sII", table)}


class AdaptiveIntegers:
    """Section "Adaptive integers"."""

    def __init__(self, data: bytes, n_contexts: int) -> None:
        self.data, self.at, self.code, self.range = data, 0, 0, (1 << 32) - 1
        self.models = [[32768, 32768, 0] for _ in range(n_contexts * 6 * 56)]
        for _ in range(4):
            self.code = self.code << 8 | self.next_byte()

    def next_byte(self) -> int:
        """Give the next byte, 0 past the end."""
        self.at += 1
        return self.data[self.at - 1] if self.at <= len(self.data) else 0

    def bin(self, number: int | None = None) -> int:
        """Read a bin with a model, or an even one."""
        if number is None:
            self.range >>= 1
            bound = self.range
        else:
            fast, slow, seen = model = self.models[number]
            bound = (self.range >> 16) * min(max((fast + slow) >> 1, 64), 65472)
        bit = int(self.code >= bound)
        self.code -= bound * bit
        if number is not None:
            self.range = self.range - bound if bit else bound
            for i, most in enumerate((4, 7)):
                shift = min(most, seen.bit_length() + 1)
                model[i] += -(model[i] >> shift) if bit else (65536 - model[i]) >> shift
            model[2] = min(seen + 1, 127)
        while self.range < 1 << 24:
            self.range = self.range << 8 & 0xFFFFFFFF
            self.code = self.code << 8 & 0xFFFFFFFF | self.next_byte()
        return bit

    def run(self, contexts: Iterable[int]) -> list[int]:
        """Read one integer under each context."""
        values = [0, 0]
        for context in contexts:
            activity = min((abs(values[-1]) + abs(values[-2])).bit_length(), 5)
            values.append(self.integer((context * 6 + activity) * 56))
        return values[2:]

    def integer(self, base: int) -> int:
        """Read one integer with the models from `base` on."""
        if not self.bin(base):
            return 0
        sign = -1 if self.bin(base + 1) else 1
        for magnitude in range(1, 15):
            if not self.bin(base + 1 + magnitude):
                return sign * magnitude
        length = 0
        while self.bin(base + 16 + min(length, 19)):
            length += 1
        u = 1
        for i in range(length):
            u = u << 1 | self.bin(base + 36 + min(length, 19) if i == 0 else None)
        return sign * (14 + u)

    def end(self) -> None:
        """Check that no byte was left unread."""
        assert self.at >= len(self.data)


class Residuals(AdaptiveIntegers):
    """Section "Residuals": the same range decoder, other models."""

    def __init__(self, data: bytes) -> None:
        super().__init__(data, 0)
        rows = [k if k < 18 else 16 + k % 2 for k in range(41)]
        self.classes = [[[FIRST[r], 8], *([MORE[r], 8] for _ in range(14))] for r in rows]
        self.shared = [[32768, 8] for _ in range(33)]

    def modelled(self, model: list[int]) -> int:
        """Read a bin with a model of a residual."""
        p, count = model
        bound = (self.range >> 16) * min(max(p, 64), 65472)
        bit = int(self.code >= bound)
        self.code -= bound * bit
        self.range = self.range - bound if bit else bound
        model[0] += -(2 * p // (2 * count + 3)) if bit else 2 * (65536 - p) // (2 * count + 3)
        model[1] = min(count + 1, 100)
        while self.range < 1 << 24:
            self.range = self.range << 8 & 0xFFFFFFFF
            self.code = self.code << 8 & 0xFFFFFFFF | self.next_byte()
        return bit

    def residual(self, k: int) -> int:
        """Read one integer of a class."""
        b = 0 if k < 16 else (k - 16) // 2 + 1
        high = 0
        while high < 15 and self.modelled(self.classes[k][high]):
            high += 1
        if high == 15:
            length = 0
            while self.modelled(self.shared[length]):
                length += 1
            u = 1
            for _ in range(length):
                u = u << 1 | self.bin()
            high = 14 + u
        for _ in range(b):
            high = high << 1 | self.bin()
        return -high if high and self.bin() else high


class Tokens:
    """Section "Tokens"."""

    def __init__(self, data: bytes, n_contexts: int) -> None:
        fields = Fields(data)
        n_tables, table_bytes, raw_bytes = fields.read("BII")
        coded = AdaptiveIntegers(fields.take(table_bytes), 3)
        self.table_of = np.cumsum(coded.run([2] * n_contexts)).tolist()
        self.tables = []
        for _ in range(n_tables):
            first, n_tokens = coded.run([0, 0])
            self.tables.append((first, cumulative(np.cumsum(coded.run([1] * n_tokens)).tolist())))
        coded.end()
        self.raw = "".join(f"{byte:08b}" for byte in fields.take(raw_bytes))
        self.stack = StackDecoder([word for (word,) in struct.iter_unpack("<I", fields.take())])

    def batch(self, contexts: Sequence[int]) -> list[int]:
        """Read one integer under each context."""
        tables = [self.table_of[context] for context in contexts]
        tokens = [0] * len(contexts)
        for table in sorted(set(tables)):
            first, ends = self.tables[table]
            for i in (i for i, mine in enumerate(tables) if mine == table):
                tokens[i] = first + self.stack.decode(ends)
        return [self.integer(token) for token in tokens]

    def integer(self, token: int) -> int:
        """Complete a token by its raw bits."""
        j = abs(token) - 16
        if j < 0:
            return token
        length = j // 4 + 2
        magnitude = ((4 + j % 4) << length) + int(self.raw[:length], 2)
        self.raw = self.raw[length:]
        return -magnitude if token < 0 else magnitude

    def end(self) -> None:
        """Check that nothing is left."""
        assert not self.stack.words
        assert self.stack.state == 0
        assert self.raw in "0000000"
