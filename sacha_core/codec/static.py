"""Section `Static`: what is said once about the person: identity coefficients and personal vertex offsets.

Source: own.
"""

from __future__ import annotations

import struct

import numpy as np
from jaxtyping import Float, Int

from sacha_core.codec.adaptive import AdaptiveDecoder, AdaptiveEncoder
from sacha_core.codec.anchors import middle_of
from sacha_core.codec.order import Layout, own_then_middles, passes_of_firsts
from sacha_core.codec.predicted import decode_predicted, encode_predicted
from sacha_core.codec.reading import ByteReader
from sacha_core.codec.template import Template

__all__ = ["MAX_LEVEL", "decode_static", "encode_static", "read_step", "to_levels", "to_values"]

LAYOUT = "dd"  # step of the shape, step of the offsets (metres)
SHAPE_CONTEXT = 0
OFFSET_CONTEXTS = np.array([1, 2, 3])
N_CONTEXTS = 4
ONE_BY_ONE, NEARBY = 0, 1  # ways to code offsets
MAX_LEVEL = 1 << 30
SMALLEST_STEP, LARGEST_STEP = 1e-9, 1e3


def read_step(reader: ByteReader) -> float:
    """Read a quantiser step.

    Raises:
        FormatError: it is not a positive number of a sane size.
    """
    (step,) = reader.unpack("d")
    if not SMALLEST_STEP <= step <= LARGEST_STEP:
        raise reader.error(f"a step of {step}, expected {SMALLEST_STEP} to {LARGEST_STEP}")
    return float(step)


def to_levels(values: Float[np.ndarray, "..."], step: float) -> Int[np.ndarray, "..."]:
    """Give the nearest multiple of `step` to each value.

    Raises:
        OverflowError: a value is beyond 2**30 steps.
    """
    levels = np.rint(values.astype(np.float64) / step)
    if np.abs(levels).max(initial=0) > MAX_LEVEL:
        raise OverflowError(f"{np.abs(values).max()} is more than 2**30 steps of {step}")
    return levels.astype(np.int64)


def to_values(levels: Int[np.ndarray, "..."], step: float) -> Float[np.ndarray, "..."]:
    """Give float32 values of multiples of `step`: one float64 product, rounded once."""
    return (levels.astype(np.float64) * step).astype(np.float32)


def layout_of_vertices(template: Template) -> Layout:
    """Lay out the head's own vertices, in coding order, as if each carried one Gaussian and middles of edges none."""
    places = template.vertices
    own = np.flatnonzero(~middle_of(template))
    rows = np.arange(len(own))
    passes = tuple(passes_of_firsts(places, own, rows, own_then_middles(np.zeros(len(own), bool))))
    nobody = np.zeros_like(rows)
    return Layout(template, nobody, nobody, rows, rows, nobody, passes, places.points[own])


def vertices_in_order(template: Template) -> Int[np.ndarray, " v"]:
    """Give the head's own vertices in coding order."""
    return np.asarray(template.vertices.order[~middle_of(template)])


def encode_static(
    shape: Float[np.ndarray, " s"],
    static_offset: Float[np.ndarray, "v 3"],
    shape_step: float,
    offset_step: float,
    template: Template | None = None,
) -> bytes:
    """Code identity and offsets: each as its difference to the vertex before, or to what those nearby let expect if that is shorter."""
    levels, offsets = to_levels(shape, shape_step), to_levels(static_offset, offset_step)
    ways = [one_by_one(levels, offsets)]
    if template is not None and template.known and offsets.any():
        ways.append(by_those_nearby(levels, offsets, template))
    return struct.pack("<" + LAYOUT, shape_step, offset_step) + min(ways, key=len)


def one_by_one(shape: Int[np.ndarray, " s"], offsets: Int[np.ndarray, "v 3"]) -> bytes:
    """Code each offset as its difference to the vertex before."""
    coder = AdaptiveEncoder(N_CONTEXTS, expected=shape.size + offsets.size)
    coder.write(shape, np.full(shape.size, SHAPE_CONTEXT))
    coder.write(np.diff(offsets, axis=0, prepend=0).reshape(-1), np.tile(OFFSET_CONTEXTS, len(offsets)))
    return bytes([ONE_BY_ONE]) + coder.finish()


def by_those_nearby(shape: Int[np.ndarray, " s"], offsets: Int[np.ndarray, "v 3"], template: Template) -> bytes:
    """Code each offset as its difference to what those of vertices nearby let expect."""
    coder = AdaptiveEncoder(N_CONTEXTS, expected=shape.size)
    coder.write(shape, np.full(shape.size, SHAPE_CONTEXT))
    coded_shape = coder.finish()
    ordered = offsets[vertices_in_order(template)]
    coded, _ = encode_predicted(layout_of_vertices(template), ordered, np.ones((len(ordered), 1), np.int64))
    return bytes([NEARBY]) + struct.pack("<I", len(coded_shape)) + coded_shape + coded


def decode_static(
    reader: ByteReader, n_shape: int, n_offsets: int, template: Template
) -> tuple[Float[np.ndarray, " s"], Float[np.ndarray, "v 3"]]:
    """Read identity and offsets.

    Raises:
        FormatError: a step or a value is out of range, or bytes are left over.
    """
    shape_step, offset_step = read_step(reader), read_step(reader)
    way = int(reader.unpack("B")[0])
    if way > NEARBY or (way == NEARBY and (not template.known or n_offsets != len(template.grid))):
        raise reader.error(f"offsets of {n_offsets} vertices coded in way {way}")
    n_bytes = reader.left if way == ONE_BY_ONE else reader.unpack("I")[0]
    offset = reader.offset
    expected = n_shape + 3 * n_offsets
    coder = AdaptiveDecoder(reader.take(n_bytes), N_CONTEXTS, expected=expected, offset=offset)
    shape = coder.read(np.full(n_shape, SHAPE_CONTEXT))
    if way == ONE_BY_ONE:
        differences = coder.read(np.tile(OFFSET_CONTEXTS, n_offsets)).reshape(n_offsets, 3)
        offsets = np.cumsum(differences, axis=0)
    coder.check_end()
    if way == NEARBY:
        ordered = decode_predicted(reader, layout_of_vertices(template), np.ones((n_offsets, 1), np.int64), 3)
        offsets = np.zeros_like(ordered)
        offsets[vertices_in_order(template)] = ordered
    if max(np.abs(shape).max(initial=0), np.abs(offsets).max(initial=0)) > MAX_LEVEL:
        raise reader.error(f"a value of more than {MAX_LEVEL} steps")
    return to_values(shape, shape_step), to_values(offsets, offset_step)
