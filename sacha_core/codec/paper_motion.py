"""The paper profile's motion: every parameter against the frame before, as it was reconstructed, by binary arithmetic coding.

Source: the SACHA paper; steps and contexts own, it states none.
"""

from __future__ import annotations

import struct

import numpy as np
from jaxtyping import Int

from sacha_core.avatar.motion import Motion
from sacha_core.codec.adaptive import AdaptiveDecoder, AdaptiveEncoder
from sacha_core.codec.container import Section
from sacha_core.codec.header import Header
from sacha_core.codec.sections import need
from sacha_core.codec.static import MAX_LEVEL, read_step, to_levels, to_values
from sacha_core.codec.whole_motion import read_frame_rate
from sacha_core.errors import FormatError

__all__ = ["decode_paper_motion", "encode_paper_motion"]

WIDTHS = {
    "expression": 0,
    "rotation": 3,
    "neck": 3,
    "jaw": 3,
    "eyes": 6,
    "translation": 3,
}  # of an expression the header tells
EXPRESSION_STEP, ANGLE_STEP_RAD, TRANSLATION_STEP = 5e-3, 2.5e-4, 2e-5
SHAPE_STEP, OFFSET_STEP = 5e-3, 2e-5
STEP_OF = (0, 1, 1, 1, 1, 2)  # expression, angle, translation
STATIC_CONTEXTS, AXES = 4, 3


def kinds_of(n_expression: int) -> Int[np.ndarray, " p"]:
    """Give the parameter that each number of a frame belongs to: its context."""
    return np.repeat(np.arange(len(WIDTHS)), [n_expression, *list(WIDTHS.values())[1:]])


def encode_paper_motion(motion: Motion) -> list[Section]:
    """Code static and dynamic parameters.

    Raises:
        FormatError: a value is more steps than the format holds.
    """
    steps = (EXPRESSION_STEP, ANGLE_STEP_RAD, TRANSLATION_STEP)
    try:
        shape, offsets = to_levels(motion.shape, SHAPE_STEP), to_levels(motion.static_offset, OFFSET_STEP)
        parts = [to_levels(getattr(motion, name), steps[s]) for name, s in zip(WIDTHS, STEP_OF, strict=True)]
    except OverflowError as fault:
        raise FormatError(f"motion: {fault}") from fault
    coder = AdaptiveEncoder(STATIC_CONTEXTS, expected=shape.size + offsets.size)
    coder.write(shape, np.zeros(len(shape), np.int64))
    coder.write(np.diff(offsets, axis=0, prepend=0).reshape(-1), np.tile(np.arange(1, STATIC_CONTEXTS), len(offsets)))
    static = struct.pack("<dd", SHAPE_STEP, OFFSET_STEP) + coder.finish()
    levels = np.concatenate(parts, axis=1)
    kinds = kinds_of(motion.expression.shape[1])
    coder = AdaptiveEncoder(len(WIDTHS), expected=levels.size)
    for difference in np.diff(levels, axis=0, prepend=0):
        coder.write(difference, kinds)
    dynamic = struct.pack("<4d", motion.frame_rate, *steps) + coder.finish()
    return [Section("Static", static), Section("Motion", dynamic)]


def decode_paper_motion(sections: dict[str, Section], header: Header) -> Motion:
    """Read the motion.

    Raises:
        FormatError: a section is missing or not what an encoder writes.
    """
    reader = need(sections, "Static").reader()
    shape_step, offset_step, offset = read_step(reader), read_step(reader), reader.offset
    n_offsets = header.n_offsets
    n_static = header.n_shape + AXES * n_offsets
    coder = AdaptiveDecoder(reader.take(reader.left), STATIC_CONTEXTS, expected=n_static, offset=offset)
    shape = coder.read(np.zeros(header.n_shape, np.int64))
    differences = coder.read(np.tile(np.arange(1, STATIC_CONTEXTS), n_offsets)).reshape(n_offsets, AXES)
    coder.check_end()
    offsets = np.cumsum(differences, axis=0)
    if max(np.abs(shape).max(initial=0), np.abs(offsets).max(initial=0)) > MAX_LEVEL:
        raise reader.error(f"a value of more than {MAX_LEVEL} steps")
    reader = need(sections, "Motion").reader()
    rate, steps, offset = read_frame_rate(reader), [read_step(reader) for _ in range(3)], reader.offset
    kinds = kinds_of(header.n_expression)
    differences = np.zeros((header.n_frames, len(kinds)), np.int64)
    coder = AdaptiveDecoder(reader.take(reader.left), len(WIDTHS), expected=differences.size, offset=offset)
    for row in differences:
        row[:] = coder.read(kinds)
    coder.check_end()
    levels = np.cumsum(differences, axis=0)
    if np.abs(levels).max(initial=0) > MAX_LEVEL:
        raise reader.error(f"a value of more than {MAX_LEVEL} steps")
    parts = {name: to_values(levels[:, kinds == kind], steps[STEP_OF[kind]]) for kind, name in enumerate(WIDTHS)}
    motion = Motion(to_values(shape, shape_step), to_values(offsets, offset_step), **parts, frame_rate=rate)
    motion.validate()
    return motion
