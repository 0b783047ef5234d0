"""Section `head`: the head model itself, for receivers that do not have it; skipped by those that do.

Arrays lie one after the other, each as its name, kind, shape and bytes; bytes of floats are grouped by significance, so that
zlib finds more.

Source: own.
"""

from __future__ import annotations

import math
import struct
import zlib

import numpy as np
from jaxtyping import Num

from sacha_core.codec.reading import ByteReader, pack_text
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
DIMENSIONS = {"v_template": 2, "shapedirs": 3, "exprdirs": 3, "J_regressor": 2, "weights": 2, "posedirs": 3, "uv": 2}
MASK = "mask:"
KINDS = {0: np.dtype("<f4"), 1: np.dtype("<i4")}
MAX_RATIO = 1032  # zlib cannot do better


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
    body = b"".join(pack_array(name, array) for name, array in arrays.items())
    head_bytes = pack_text(head.name) + struct.pack("<IHI", head.n_teeth_faces, len(arrays), len(body))
    return head_bytes + zlib.compress(body, 9)


def unpack_array(reader: ByteReader) -> tuple[str, Num[np.ndarray, "..."]]:
    """Read one array.

    Raises:
        FormatError: its kind or its shape is impossible.
    """
    name = reader.text()
    kind, n_dimensions = reader.unpack("BB")
    if kind not in KINDS or n_dimensions > 3:
        raise reader.error(f"array {name!r} of kind {kind} with {n_dimensions} dimensions")
    shape = reader.unpack(f"{n_dimensions}I")
    n_values = math.prod(shape)
    planes = np.frombuffer(reader.take(4 * n_values), np.uint8).reshape(4, n_values)
    array = np.ascontiguousarray(planes.T).reshape(-1).view(KINDS[kind]).reshape(shape)
    if kind == 0 and not np.isfinite(array).all():
        raise reader.error(f"array {name!r} is not finite")
    return name, array.astype(KINDS[kind].newbyteorder("="))


def decode_head(reader: ByteReader) -> HeadModel:
    """Read a head model.

    Raises:
        FormatError: the bytes are not a head model whose arrays fit each other.
    """
    name = reader.text()
    n_teeth_faces, n_arrays, n_bytes = reader.unpack("IHI")
    packed = reader.take(reader.left)
    if n_bytes > MAX_RATIO * len(packed):
        raise reader.error(f"{len(packed)} bytes claim to unpack to {n_bytes}")
    unpacker = zlib.decompressobj()
    try:
        body = unpacker.decompress(packed, n_bytes + 1)
    except zlib.error as fault:
        raise reader.error(f"not zlib data: {fault}") from fault
    if len(body) != n_bytes or not unpacker.eof or unpacker.unused_data:
        raise reader.error(f"the head unpacks to {len(body)} bytes or more, expected {n_bytes}")
    inner = ByteReader(body, "head (unpacked)")
    arrays = dict(unpack_array(inner) for _ in range(n_arrays))
    inner.check_end()
    masks = {key.removeprefix(MASK): arrays.pop(key) for key in list(arrays) if key.startswith(MASK)}
    missing = [key for key in ARRAYS[:7] if key not in arrays]
    if missing or set(arrays) - set(ARRAYS):
        raise reader.error(f"the head lacks {missing}" if missing else "the head has arrays of unknown names")
    head = HeadModel(name=name, **arrays, masks=masks, n_teeth_faces=n_teeth_faces)
    check_fit(reader, head)
    return head


def check_fit(reader: ByteReader, head: HeadModel) -> None:
    """Check that shapes agree and indices point inside.

    Raises:
        FormatError: naming the array.
    """
    for key in ARRAYS:
        array = getattr(head, key)
        if array is None:
            continue
        expected = {"faces": 2, "parents": 1, "uv_faces": 2}.get(key) or DIMENSIONS[key]
        integer = key in ("faces", "parents", "uv_faces")
        if array.ndim != expected or np.issubdtype(array.dtype, np.integer) != integer:
            raise reader.error(f"head array {key} has shape {array.shape} and type {array.dtype}")
    v, f, j = head.n_vertices, head.n_faces, len(head.parents)
    shapes = {
        "v_template": (v, 3),
        "faces": (f, 3),
        "shapedirs": (v, 3, head.shapedirs.shape[2]),
        "exprdirs": (v, 3, head.exprdirs.shape[2]),
        "J_regressor": (j, v),
        "weights": (v, j),
    }
    if head.posedirs is not None:
        shapes["posedirs"] = (v, 3, 9 * (j - 1))
    if head.uv is not None:
        shapes["uv"] = (len(head.uv), 2)
    if head.uv_faces is not None:
        shapes["uv_faces"] = (f, 3)
    for key, shape in shapes.items():
        if getattr(head, key).shape != shape:
            raise reader.error(f"head array {key} has shape {getattr(head, key).shape}, expected {shape}")
    limits = [("faces", head.faces, v), ("uv_faces", head.uv_faces, 0 if head.uv is None else len(head.uv))]
    limits += [(f"mask {key!r}", mask, v) for key, mask in head.masks.items()]
    for key, indices, limit in limits:
        if indices is not None and indices.size and (indices.min() < 0 or indices.max() >= limit):
            raise reader.error(f"head array {key} points outside 0 to {limit - 1}")
    if j == 0 or head.parents[0] != -1 or not all(0 <= head.parents[i] < i for i in range(1, j)) or n_bad_teeth(head):
        raise reader.error("head joints are not a tree in order, or it has more teeth than triangles")


def n_bad_teeth(head: HeadModel) -> bool:
    """Whether more triangles are teeth than there are."""
    return head.n_teeth_faces > head.n_faces
