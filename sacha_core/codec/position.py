r"""Section `Position`: means in the frames of their triangles, or in world axes, from where their place lies on the unposed head.

Where places are triangles they lie at the centroid, where places are vertices, at the vertex. An encoder takes the domain that is likely
to need fewer bytes.

Source: own.
"""

from __future__ import annotations

import numpy as np
from jaxtyping import Float, Int

from sacha_core.codec.choice import PLAIN, Worth
from sacha_core.codec.order import Layout
from sacha_core.codec.predicted import decode_predicted, encode_predicted, rough_bits
from sacha_core.codec.reading import ByteReader
from sacha_core.codec.steps import MAX_EXPONENT, PER_OCTAVE, STEPS, Classes, StepRule, dequantise

__all__ = ["TRIANGLE", "WORLD", "decode_position", "encode_position"]

TRIANGLE, WORLD = 0, 1  # domains
UNIT = 2.0**-16  # of a triangle's scale
PER_CELL = 16  # units of the world in a cell of the template's grid


def position_steps(layout: Layout, classes: Classes, rule: StepRule, domain: int) -> Int[np.ndarray, "n 1"]:
    """Steps that are alike in metres."""
    exponent = rule.base + rule.shift(classes)
    if domain == TRIANGLE:
        exponent = exponent - layout.triangle_size
    return np.asarray(STEPS[np.clip(exponent, 0, MAX_EXPONENT)])[:, None]


def encode_position(
    layout: Layout, position: Float[np.ndarray, "n 3"], classes: Classes, rule: StepRule, worth: Worth = PLAIN
) -> tuple[bytes, Float[np.ndarray, "n 3"]]:
    """Code positions by a rule for triangle units; give the section and what the decoder will have."""
    domain, rule, values, steps = choose_domain(layout, position, classes, rule)
    coded, decoded = encode_predicted(layout, values, steps, worth)
    return bytes([domain]) + rule.pack() + coded, in_triangles(layout, decoded, domain)


def choose_domain(
    layout: Layout, position: Float[np.ndarray, "n 3"], classes: Classes, rule: StepRule
) -> tuple[int, StepRule, Int[np.ndarray, "n 3"], Int[np.ndarray, "n 1"]]:
    """Give the domain that is likely to need fewer bytes, and rule, integers and steps in it."""
    values = np.rint(position.astype(np.float64) / UNIT).astype(np.int64)
    steps = position_steps(layout, classes, rule, TRIANGLE)
    if layout.template.known:
        world_rule, world_values = rule_for_world(layout, rule), to_world(layout, position)
        world_steps = position_steps(layout, classes, world_rule, WORLD)
        if rough_bits(layout, world_values, world_steps) < rough_bits(layout, values, steps):
            return WORLD, world_rule, world_values, world_steps
    return TRIANGLE, rule, values, steps


def in_triangles(layout: Layout, values: Int[np.ndarray, "n 3"], domain: int) -> Float[np.ndarray, "n 3"]:
    """Give positions in triangle units, float32."""
    return from_world(layout, values) if domain == WORLD else dequantise(values, UNIT)


def rule_for_world(layout: Layout, rule: StepRule) -> StepRule:
    """Give the rule that makes the same steps in units of the world, as far as one can."""
    if not len(layout):
        return rule
    octaves = (
        np.log2(layout.template.frames(layout.binding).scale * (PER_CELL * UNIT)) - layout.triangle_size / PER_OCTAVE
    )
    return rule.moved(round(PER_OCTAVE * float(np.median(octaves))))


def place_offset(layout: Layout, sums: Int[np.ndarray, "n 3"]) -> Float[np.ndarray, "n 3"]:
    """Give where each Gaussian's place lies from the centroid of its triangle, grid cells."""
    if layout.anchors is None:
        return np.zeros((len(layout), 3))
    return np.asarray((layout.anchors * 3 - sums * 2) / 6.0)


def to_world(layout: Layout, position: Float[np.ndarray, "n 3"]) -> Int[np.ndarray, "n 3"]:
    """Give offsets from the places, in units of the world."""
    frames = layout.template.frames(layout.binding)
    offset = np.einsum("ijn,nj->ni", frames.axes, position.astype(np.float64)) * frames.scale[:, None]
    return np.asarray(np.rint((offset - place_offset(layout, frames.sums)) * PER_CELL).astype(np.int64))


def from_world(layout: Layout, values: Int[np.ndarray, "n 3"]) -> Float[np.ndarray, "n 3"]:
    """Give positions in the frames of the triangles, float32."""
    frames = layout.template.frames(layout.binding)
    x, y, z = (values / float(PER_CELL) + place_offset(layout, frames.sums)).T
    columns = [((a * x + b * y) + c * z) / frames.scale for a, b, c in frames.axes.swapaxes(0, 1)]
    return np.stack(columns, axis=1).astype(np.float32)


def decode_position(reader: ByteReader, layout: Layout, classes: Classes) -> Float[np.ndarray, "n 3"]:
    """Read positions.

    Raises:
        FormatError: an unknown domain, or bytes that no encoder writes.
    """
    (domain,) = reader.unpack("B")
    if domain not in (TRIANGLE, WORLD) or (domain == WORLD and not layout.template.known):
        raise reader.error(f"domain {domain}, expected {TRIANGLE} (triangles) or, with the head, {WORLD} (world)")
    rule = StepRule.unpack(reader)
    return in_triangles(
        layout, decode_predicted(reader, layout, position_steps(layout, classes, rule, domain), 3), domain
    )
