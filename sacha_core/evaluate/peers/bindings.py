"""Which triangle carries each Gaussian, for codecs that have no place for it: the cheapest of a few plain codings.

Candidates: counts for each triangle, where the codec keeps an order and the Gaussians came sorted by triangle; and, in whatever order the
codec leaves, indices into the list of occupied triangles along the head, packed to as few bits as that list needs, split into their high
and low bytes, or those of the differences from one to the next. All go through xz (LZMA2), and the smallest is taken.

Source: own; the dictionary is the paper's.
"""

from __future__ import annotations

import lzma
import struct

import numpy as np
from jaxtyping import Int

from sacha_core.evaluate.peers.peer import Ground

__all__ = ["decode_bindings", "encode_bindings", "how_coded", "pack", "unpack"]

FILTERS = [{"id": lzma.FILTER_LZMA2, "preset": 9 | lzma.PRESET_EXTREME, "lc": 4, "lp": 0, "pb": 0}]
COUNTS, PACKED, SPLIT, DIFFERENCES = range(4)
NAMES = (
    "counts a triangle, xz", "packed dictionary indices, xz", "dictionary indices in two bytes, xz",
    "differences of dictionary indices, xz",
)  # fmt: skip
NUMBER = struct.Struct("<I")  # of Gaussians, where there are no bindings
HEAD = struct.Struct("<BII")  # method, Gaussians, bytes of the list of occupied triangles


def pack(data: bytes) -> bytes:
    """Compress bytes by LZMA2 without a container."""
    return lzma.compress(data, lzma.FORMAT_RAW, filters=FILTERS)


def unpack(data: bytes) -> bytes:
    """Undo `pack`."""
    return lzma.decompress(data, lzma.FORMAT_RAW, filters=FILTERS)


def encode_bindings(binding: Int[np.ndarray, " n"], ground: Ground) -> bytes:
    """Code the triangle of each Gaussian in the order that the decoder will have them in.

    Args:
        binding: (n,) triangles.
        ground: the head that both sides know; without one, how many Gaussians there are is all there is to say.
    """
    if not ground.bound:
        return NUMBER.pack(len(binding))
    place = ground.place[binding]
    counts = np.bincount(place, minlength=len(ground.order))
    coded = {}
    if (np.diff(place) >= 0).all():
        coded[COUNTS] = (b"", _columns(counts))
    taken = counts > 0
    index = (np.cumsum(taken) - 1)[place]
    m = max(int(taken.sum()), 1)
    occupied = np.packbits(taken).tobytes()
    n_bits = max((m - 1).bit_length(), 1)
    bits = (index[:, None] >> np.arange(n_bits)[::-1]) & 1
    coded[PACKED] = (occupied, np.packbits(bits.astype(bool)).tobytes())
    coded[SPLIT] = (occupied, _columns(index))
    coded[DIFFERENCES] = (occupied, _columns(_folded(index, m)))
    packed = {method: (pack(first), pack(second)) for method, (first, second) in coded.items()}
    method = min(packed, key=lambda one: sum(map(len, packed[one])))
    first, second = packed[method]
    return HEAD.pack(method, len(binding), len(first)) + first + second


def decode_bindings(data: bytes, ground: Ground) -> Int[np.ndarray, " n"]:
    """Undo `encode_bindings`; without a head all are bound to triangle 0."""
    if not ground.bound:
        return np.zeros(NUMBER.unpack(data)[0], np.int32)
    method, n, n_first = HEAD.unpack_from(data)
    first = unpack(data[HEAD.size : HEAD.size + n_first])
    second = unpack(data[HEAD.size + n_first :])
    n_faces = len(ground.order)
    if method == COUNTS:
        return np.repeat(ground.order, _uncolumns(second, n_faces)).astype(np.int32)
    occupied = np.flatnonzero(np.unpackbits(np.frombuffer(first, np.uint8), count=n_faces))
    if method == PACKED:
        n_bits = max((max(len(occupied), 1) - 1).bit_length(), 1)
        bits = np.unpackbits(np.frombuffer(second, np.uint8), count=n * n_bits).reshape(n, n_bits).astype(np.int64)
        index = bits @ (1 << np.arange(n_bits)[::-1])
    else:
        index = _uncolumns(second, n)
        if method == DIFFERENCES:
            signed = (index >> 1) ^ -(index & 1)
            index = np.cumsum(signed) % max(len(occupied), 1)
    return ground.order[occupied[index]].astype(np.int32)


def how_coded(data: bytes) -> str:
    """Say which of the codings was the smallest."""
    return NAMES[data[0]]


def _folded(index: Int[np.ndarray, " n"], m: int) -> Int[np.ndarray, " n"]:
    """Give differences to the one before, the short way round, as numbers from 0: 0, -1, 1, -2, 2, ..."""
    signed = (np.diff(index, prepend=0) + m // 2) % m - m // 2
    return (signed << 1) ^ (signed >> 63)


def _columns(values: Int[np.ndarray, " n"]) -> bytes:
    """Split numbers into bytes, all low ones first, after one byte that says how many each has."""
    n_bytes = max((int(values.max(initial=0)).bit_length() + 7) // 8, 1)
    table = values.astype("<u4").view(np.uint8).reshape(len(values), 4)[:, :n_bytes]
    return bytes([n_bytes]) + table.T.tobytes()


def _uncolumns(data: bytes, n: int) -> Int[np.ndarray, " n"]:
    table = np.frombuffer(data, np.uint8, offset=1).reshape(data[0], n).astype(np.int64)
    return np.asarray((table << (8 * np.arange(data[0]))[:, None]).sum(axis=0))
