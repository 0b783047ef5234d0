"""The paper profile: points on a grid and their attributes by a coder of point clouds, bindings in an order that both sides know.

The coder is this project's own, at the quantiser steps and with the dead zone of MPEG's rate points, or an external one (`paper_tool`).

Source: the SACHA paper, section on compression; the coder own.
"""

from __future__ import annotations

import struct

import numpy as np
from jaxtyping import Float, Int

from sacha_core.avatar.gaussians import Gaussians
from sacha_core.codec.adaptive import AdaptiveDecoder, AdaptiveEncoder
from sacha_core.codec.container import Section
from sacha_core.codec.header import Header
from sacha_core.codec.paper_map import (
    ATTRIBUTE_MAX,
    MAX_QP,
    columns_of,
    dead_zone_level,
    from_integers,
    reconstructed,
    row_order,
)  # fmt: skip
from sacha_core.codec.paper_tool import decode_with_tool
from sacha_core.codec.paper_tree import decode_points, encode_points
from sacha_core.codec.reading import ByteReader
from sacha_core.codec.sections import need
from sacha_core.codec.symbols import SymbolReader, SymbolWriter

__all__ = [
    "OWN",
    "WITH_TOOL",
    "coded_rows",
    "coder_of",
    "decode_paper",
    "encode_binding",
    "encode_rows",
    "geometry_head",
    "read_geometry_head",
]

OWN, WITH_TOOL = 0, 1  # coders
GEOMETRY = "3fB"  # least positions, coder
COLUMN = "BH"  # quantisation parameter, centre
ACTIVITIES = 4
INDEX_HIGH = 5  # an index into the dictionary is told as its high and its low bits


def activity_of(levels: Int[np.ndarray, "n c"], column: int) -> Int[np.ndarray, " n"]:
    """Class of the magnitudes of the two columns before."""
    total = np.abs(levels[:, max(column - 2, 0) : column]).sum(axis=1)
    return np.asarray(np.minimum(np.frexp(total.astype(np.float64))[1], ACTIVITIES - 1).astype(np.int64))


def coded_rows(
    rows: Int[np.ndarray, "n c"], qps: dict[str, list[int]], n_harmonics: int
) -> tuple[Int[np.ndarray, "n c"], dict[str, tuple[Int[np.ndarray, " c"], Int[np.ndarray, "n c"]]]]:
    """Quantise attributes.

    Args:
        rows: integers of all Gaussians.
        qps: quantisation parameter of every column of each section.
        n_harmonics: coefficients of degree 1 and up.

    Returns:
        The rows as the decoder will have them; centres and levels of each section, in the given order of rows.
    """
    decoded = rows.copy()
    told = {}
    for name, columns in columns_of(n_harmonics).items():
        if name != "Geometry" and columns.stop > columns.start:
            values, qp = rows[:, columns], np.array(qps[name])
            centre = (values.sum(axis=0) + len(rows) // 2) // max(len(rows), 1)
            levels = dead_zone_level(values, centre, qp)
            decoded[:, columns] = reconstructed(levels, centre, qp)
            told[name] = (centre, levels)
    return decoded, told


def encode_attribute(centre: Int[np.ndarray, " c"], levels: Int[np.ndarray, "n c"], qps: list[int]) -> bytes:
    """Code the levels of a section, column by column."""
    writer = SymbolWriter(ACTIVITIES * len(qps))
    for column in range(len(qps)):
        writer.write(levels[:, column], ACTIVITIES * column + activity_of(levels, column))
    head = b"".join(struct.pack("<" + COLUMN, qp, middle) for qp, middle in zip(qps, centre.tolist(), strict=True))
    return head + writer.finish()


def decode_attribute(reader: ByteReader, n: int, width: int) -> Int[np.ndarray, "n c"]:
    """Read the integers of a section.

    Raises:
        FormatError: the bytes are not what an encoder writes.
    """
    qp, centre = np.array([reader.unpack(COLUMN) for _ in range(width)], np.int64).T
    if qp.max() > MAX_QP or centre.max() > ATTRIBUTE_MAX:
        raise reader.error(
            f"quantisation parameter {qp.max()} around {centre.max()}, at most {MAX_QP} and {ATTRIBUTE_MAX}"
        )
    symbols = SymbolReader(reader, ACTIVITIES * width)
    levels = np.zeros((n, width), np.int64)
    for column in range(width):
        levels[:, column] = symbols.read(ACTIVITIES * column + activity_of(levels, column))
    symbols.check_end()
    return reconstructed(levels, centre, qp)


def encode_binding(binding: Int[np.ndarray, " n"]) -> bytes:
    """Code triangles in the order of the rows: a dictionary of those that occur, then indices into it."""
    known, index = np.unique(binding, return_inverse=True)
    coder = AdaptiveEncoder(1, expected=len(known))
    coder.write(np.diff(known.astype(np.int64), prepend=-1) - 1, np.zeros(len(known), np.int64))
    dictionary = coder.finish()
    writer = SymbolWriter(2)
    writer.write(index >> INDEX_HIGH, np.zeros(len(index), np.int64))
    writer.write((index & ((1 << INDEX_HIGH) - 1)) - (1 << INDEX_HIGH - 1), np.ones(len(index), np.int64))
    return struct.pack("<II", len(known), len(dictionary)) + dictionary + writer.finish()


def decode_binding(reader: ByteReader, n: int, n_faces: int) -> Int[np.ndarray, " n"]:
    """Read the triangle of every row.

    Raises:
        FormatError: a triangle is none of the head's, or the bytes are not what an encoder writes.
    """
    n_known, n_bytes = reader.unpack("II")
    if n_known > min(n, n_faces):
        raise reader.error(f"{n_known} triangles for {n} Gaussians on a head of {n_faces}")
    offset = reader.offset
    coder = AdaptiveDecoder(reader.take(n_bytes), 1, expected=n_known, offset=offset)
    gaps = coder.read(np.zeros(n_known, np.int64))
    coder.check_end()
    known = np.cumsum(gaps + 1) - 1
    if gaps.min(initial=0) < 0 or known.max(initial=-1) >= n_faces:
        raise reader.error(f"a triangle outside 0 to {n_faces - 1}")
    symbols = SymbolReader(reader, 2)
    high, low = symbols.read(np.zeros(n, np.int64)), symbols.read(np.ones(n, np.int64))
    symbols.check_end()
    index = (high << INDEX_HIGH) + low + (1 << INDEX_HIGH - 1)
    if index.min(initial=0) < 0 or index.max(initial=-1) >= n_known:
        raise reader.error(f"an index outside the dictionary of {n_known} triangles")
    return np.asarray(known[index])


def geometry_head(low: Float[np.ndarray, "3"], coder: int) -> bytes:
    """Write what precedes the points."""
    return struct.pack("<" + GEOMETRY, *low.tolist(), coder)


def read_geometry_head(reader: ByteReader) -> tuple[Float[np.ndarray, "3"], int]:
    """Read the least positions and the coder.

    Raises:
        FormatError: a position is not finite, or the coder unknown.
    """
    *low, coder = reader.unpack(GEOMETRY)
    if not np.isfinite(low).all() or coder > WITH_TOOL:
        raise reader.error(f"least positions {low} with coder {coder}")
    return np.array(low, np.float32), coder


def coder_of(sections: dict[str, Section]) -> int:
    """Tell which coder the points and attributes were written by."""
    return read_geometry_head(need(sections, "Geometry").reader())[1]


def encode_rows(
    rows: Int[np.ndarray, "n c"],
    low: Float[np.ndarray, "3"],
    told: dict[str, tuple[Int[np.ndarray, " c"], Int[np.ndarray, "n c"]]],
    qps: dict[str, list[int]],
) -> list[Section]:
    """Code points and attributes, rows in order, by this project's own coder."""
    points = Section("Geometry", geometry_head(low, OWN) + encode_points(rows[:, :3]))
    return [points, *(Section(name, encode_attribute(*values, qps[name])) for name, values in told.items())]


def decode_paper(sections: dict[str, Section], header: Header) -> Gaussians:
    """Read all Gaussians, in the order of their integers.

    Raises:
        FormatError: a section is missing or not what an encoder writes.
        OptionError: an external coder is needed and not named.
    """
    n, k = header.n_gaussians, header.n_harmonics
    reader = need(sections, "Geometry").reader()
    low, coder = read_geometry_head(reader)
    columns = columns_of(k)
    if coder == WITH_TOOL:
        reader.check_end()
        rows = decode_with_tool(need(sections, "Tool").reader(), n, k)
    else:
        rows = np.zeros((n, columns["Rotation"].stop), np.int64)
        rows[:, columns["Geometry"]] = decode_points(reader, n)
        for name, place in columns.items():
            if name != "Geometry" and place.stop > place.start:
                rows[:, place] = decode_attribute(need(sections, name).reader(), n, place.stop - place.start)
    rows = rows[row_order(rows)]
    binding = decode_binding(need(sections, "Binding").reader(), n, header.head.n_faces)
    return from_integers(rows, low, binding, k)
