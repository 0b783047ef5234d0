"""The archive profile: every number of an avatar bit for bit, Gaussians in their order.

Rows are coded sorted by triangle, where neighbours are alike; the decoder knows the bindings by then and puts them back.

Source: own.
"""

from __future__ import annotations

import struct
from dataclasses import fields

import numpy as np
from jaxtyping import Float, Int

from sacha_core.avatar.gaussians import Gaussians
from sacha_core.avatar.motion import Motion
from sacha_core.codec.adaptive import AdaptiveDecoder, AdaptiveEncoder
from sacha_core.codec.container import Section
from sacha_core.codec.header import Header
from sacha_core.codec.lossless import decode_exactly, encode_exactly
from sacha_core.codec.reading import ByteReader
from sacha_core.codec.sections import need
from sacha_core.codec.whole_motion import read_frame_rate
from sacha_core.errors import FormatError

__all__ = ["decode_archive", "decode_archive_motion", "encode_archive_motion", "encode_archive_sections", "exact"]

AS_THEY_ARE, BY_TRIANGLE = 0, 1  # order of rows
DYNAMIC = ("expression", "rotation", "neck", "jaw", "eyes", "translation")
GROUPS = {"Position": 3, "Scale": 3, "Rotation": 4, "Opacity": 1, "Colour": 3, "Sensitiv": 1}
ATTRIBUTES = {
    "Position": "position", "Scale": "log_scale", "Rotation": "quaternion", "Opacity": "opacity_logit", "Colour": "sh_dc",
    "Sensitiv": "sensitivity_logit",
}  # fmt: skip
WIDTHS = {"Position": 3, "Scale": 3, "Rotation": 4, "Opacity": 1, "Colour": 3, "Sensitiv": 1}
DEGREES = ((0, 3), (3, 8), (8, 15))  # coefficients of each
COLOURS = 3


def exact(name: str, values: Float[np.ndarray, "..."]) -> Float[np.ndarray, "..."]:
    """Give numbers as float32.

    Raises:
        FormatError: that would change one.
    """
    with np.errstate(over="ignore"):
        narrow = np.ascontiguousarray(values, np.float32)
    if not np.array_equal(narrow, values):
        raise FormatError(f"{name} is not of float32 numbers, which is what an archive keeps")
    return narrow


def row_order(binding: Int[np.ndarray, " n"], order: int) -> Int[np.ndarray, " n"]:
    """Rows in the order of coding."""
    return np.argsort(binding, kind="stable") if order == BY_TRIANGLE else np.arange(len(binding))


def encode_binding(binding: Int[np.ndarray, " n"], order: int) -> bytes:
    """Code the triangle of every Gaussian, as its difference to the one before."""
    coder = AdaptiveEncoder(1, expected=len(binding))
    coder.write(np.diff(binding.astype(np.int64), prepend=0), np.zeros(len(binding), np.int64))
    return bytes([order]) + coder.finish()


def decode_binding(reader: ByteReader, n: int, n_faces: int) -> tuple[Int[np.ndarray, " n"], Int[np.ndarray, " n"]]:
    """Read the triangles, and the rows in the order of coding.

    Raises:
        FormatError: a triangle is none of the head's.
    """
    (order,) = reader.unpack("B")
    if order > BY_TRIANGLE:
        raise reader.error(f"rows in order {order}, expected 0 or 1")
    offset = reader.offset
    coder = AdaptiveDecoder(reader.take(reader.left), 1, expected=n, offset=offset)
    binding = np.cumsum(coder.read(np.zeros(n, np.int64)))
    coder.check_end()
    if n and not (binding.min() >= 0 and binding.max() < n_faces):
        raise reader.error(f"a triangle outside 0 to {n_faces - 1}")
    return binding.astype(np.int32), row_order(binding, order)


def sized(parts: list[bytes]) -> bytes:
    """Join parts, each behind its number of bytes."""
    return b"".join(struct.pack("<I", len(part)) + part for part in parts)


def encode_archive_sections(gaussians: Gaussians) -> list[Section]:
    """Code all attributes, in whichever order of rows makes the colours shorter."""
    n = len(gaussians)
    colour = exact("sh_dc", gaussians.sh_dc)
    tried = {
        order: len(encode_exactly(colour[row_order(gaussians.binding, order)], COLOURS))
        for order in (BY_TRIANGLE, AS_THEY_ARE)
    }
    order = min(tried, key=lambda one: tried[one])
    rows = row_order(gaussians.binding, order)
    sections = [Section("Binding", encode_binding(gaussians.binding, order))]
    for name, attribute in ATTRIBUTES.items():
        values = getattr(gaussians, attribute)
        if values is not None:
            columns = exact(attribute, values).reshape(n, WIDTHS[name])[rows]
            sections.append(Section(name, encode_exactly(columns, GROUPS[name])))
    if gaussians.sh_degree:
        rest = exact("sh_rest", gaussians.sh_rest)[rows]
        parts = [
            encode_exactly(np.ascontiguousarray(rest[:, a:b]).reshape(n, COLOURS * (b - a)), COLOURS)
            for a, b in DEGREES[: gaussians.sh_degree]
        ]
        sections.append(Section("Harmonic", sized(parts)))
    return sections


def decode_archive(sections: dict[str, Section], header: Header) -> Gaussians:
    """Read all attributes and put the rows back into their order.

    Raises:
        FormatError: a section is missing or not what an encoder writes.
    """
    n = header.n_gaussians
    binding, rows = decode_binding(need(sections, "Binding").reader(), n, header.head.n_faces)
    back = np.empty(n, np.int64)
    back[rows] = np.arange(n)
    found: dict[str, np.ndarray] = {}
    for name, attribute in ATTRIBUTES.items():
        if name != "Sensitiv" or header.has_sensitivity:
            values = decode_exactly(need(sections, name).reader(), n, WIDTHS[name])[back]
            found[attribute] = values[:, 0] if WIDTHS[name] == 1 else values
    parts = [np.zeros((n, 0, COLOURS), np.float32)]
    if header.sh_degree:
        reader = need(sections, "Harmonic").reader()
        for a, b in DEGREES[: header.sh_degree]:
            coded = reader.part(*reader.unpack("I"))
            parts.append(decode_exactly(coded, n, COLOURS * (b - a)).reshape(n, b - a, COLOURS)[back])
        reader.check_end()
    return Gaussians(**found, sh_rest=np.concatenate(parts, axis=1), binding=binding)


def encode_archive_motion(motion: Motion) -> list[Section]:
    """Code static and dynamic parameters; a row is expected between frames before and after it."""
    static = [exact("shape", motion.shape)[:, None], exact("static_offset", motion.static_offset)]
    dynamic = [exact(name, getattr(motion, name)) for name in DYNAMIC]
    rate = struct.pack("<d", motion.frame_rate)
    return [
        Section("Static", sized([encode_exactly(part, part.shape[1]) for part in static])),
        Section("Motion", rate + sized([encode_exactly(part, motion_groups(part.shape[1])) for part in dynamic])),
    ]


def motion_groups(width: int) -> int:
    """How many groups of columns a parameter of so many numbers has."""
    return width if 1 <= width <= COLOURS else 1


def decode_archive_motion(sections: dict[str, Section], header: Header) -> Motion:
    """Read the motion.

    Raises:
        FormatError: a section is missing or not what an encoder writes.
    """
    t = header.n_frames
    reader = need(sections, "Static").reader()
    shape = decode_exactly(reader.part(*reader.unpack("I")), header.n_shape, 1)[:, 0]
    offsets = decode_exactly(reader.part(*reader.unpack("I")), header.n_offsets, 3)
    reader.check_end()
    reader = need(sections, "Motion").reader()
    rate = read_frame_rate(reader)
    widths = {f.name: 3 for f in fields(Motion)} | {"expression": header.n_expression, "eyes": 6}
    frames = {name: decode_exactly(reader.part(*reader.unpack("I")), t, widths[name]) for name in DYNAMIC}
    reader.check_end()
    motion = Motion(shape, offsets, **frames, frame_rate=rate)
    motion.validate()
    return motion
