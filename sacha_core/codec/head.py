"""Section `head`: the head model itself, for receivers that do not have it; skipped by those that do.

Arrays lie one after the other, each as its name, kind, shape and bytes; bytes of floats are grouped by significance, so that
zlib finds more.

Source: own.
"""

from __future__ import annotations

import math
import struct
import zlib
from typing import Any

import numpy as np
from jaxtyping import Num

from sacha_core.codec.reading import ByteReader, pack_text
from sacha_core.errors import HeadError
from sacha_core.flame.model import HeadModel

__all__ = ["decode_head", "encode_head"]

ARRAYS = (
    "v_template",
    "faces",
    "shapedirs",
    "exprdirs",
    "J_regressor",
    "weights",
    "parents",
    "posedirs",
    "uv",
    "uv_faces",
)
NEEDED = ARRAYS[:7]
MASK = "mask:"
KINDS = {0: np.dtype("<f4"), 1: np.dtype("<i4")}
FREE_BYTES, RATIO = 1 << 22, 64  # how much may unpack from little: zlib could make a gigabyte of a megabyte


def pack_array(name: str, array: Num[np.ndarray, "..."]) -> bytes:
    """Write one array: name, kind, dimensions, shape, then its bytes, least significant first."""
    kind = int(np.issubdtype(array.dtype, np.integer))
    planes = np.ascontiguousarray(array, KINDS[kind]).reshape(-1).view(np.uint8).reshape(-1, 4).T
    shape = struct.pack(f"<BB{array.ndim}I", kind, array.ndim, *array.shape)
    return pack_text(name) + shape + planes.tobytes()


def encode_head(head: HeadModel) -> bytes:
    """Write a head model."""
    present = {name: getattr(head, name) for name in ARRAYS if getattr(head, name) is not None}
    arrays = present | {MASK + name: mask for name, mask in head.masks.items()}
    names = struct.pack("<H", len(head.expression_names)) + b"".join(pack_text(name) for name in head.expression_names)
    body = names + b"".join(pack_array(name, array) for name, array in arrays.items())
    front = pack_text(head.name) + struct.pack("<IHI", head.n_teeth_faces, len(arrays), len(body))
    packed = zlib.compress(body, 9)
    if len(body) > most_unpacked(len(packed)):
        packed = zlib.compress(body, 0)
    return front + packed


def most_unpacked(n_bytes: int) -> int:
    """How many bytes may unpack from `n_bytes`."""
    return FREE_BYTES + RATIO * n_bytes


def unpack_array(reader: ByteReader) -> tuple[str, Num[np.ndarray, "..."]]:
    """Read one array.

    Raises:
        FormatError: its kind or its shape is impossible.
    """
    name = reader.text()
    kind, n_dimensions = reader.unpack("BB")
    if kind not in KINDS or not 1 <= n_dimensions <= 3:
        raise reader.error(f"array {name!r} of kind {kind} with {n_dimensions} dimensions")
    shape = reader.unpack(f"{n_dimensions}I")
    n_values = math.prod(shape)
    planes = np.frombuffer(reader.take(4 * n_values), np.uint8).reshape(4, n_values)
    array = np.ascontiguousarray(planes.T).reshape(-1).view(KINDS[kind]).reshape(shape)
    return name, array.astype(KINDS[kind].newbyteorder("="))


def decode_head(reader: ByteReader) -> HeadModel:
    """Read a head model.

    Raises:
        FormatError: the bytes are not a head model whose arrays fit each other.
    """
    name = reader.text()
    n_teeth_faces, n_arrays, n_bytes = reader.unpack("IHI")
    packed = reader.take(reader.left)
    if n_bytes > most_unpacked(len(packed)):
        raise reader.error(f"{len(packed)} bytes claim to unpack to {n_bytes}")
    unpacker = zlib.decompressobj()
    try:
        body = unpacker.decompress(packed, n_bytes + 1)
    except zlib.error as fault:
        raise reader.error(f"not zlib data: {fault}") from fault
    if len(body) != n_bytes or not unpacker.eof or unpacker.unused_data:
        raise reader.error(f"the head unpacks to {len(body)} bytes or more, expected {n_bytes}")
    inner = ByteReader(body, "head, unpacked")
    (n_names,) = inner.unpack("H")
    expression_names = tuple(inner.text() for _ in range(n_names))
    arrays = dict(unpack_array(inner) for _ in range(n_arrays))
    inner.check_end()
    masks = {key.removeprefix(MASK): arrays.pop(key) for key in list(arrays) if key.startswith(MASK)}
    missing, unknown = set(NEEDED) - set(arrays), set(arrays) - set(ARRAYS)
    if missing or unknown:
        raise reader.error(f"the head lacks arrays {sorted(missing)} or has unknown ones, {sorted(unknown)}")
    fields: dict[str, Any] = {**arrays, "masks": masks, "expression_names": expression_names}
    head = HeadModel(name=name, n_teeth_faces=n_teeth_faces, **fields)
    try:
        head.validate()
    except HeadError as fault:
        raise reader.error(str(fault)) from fault
    return head
