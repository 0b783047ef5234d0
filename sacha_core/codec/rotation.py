r"""Section `Rotation`: orientations, as turns from what neighbours let expect (`turning`).

In the axes of the triangles, or in those of the world, in which Gaussians on triangles of different frames can be compared: whichever
is likely to take fewer bytes.

Source: own.
"""

from __future__ import annotations

import numpy as np
from jaxtyping import Float, Int

from sacha_core.codec.choice import PLAIN, Worth
from sacha_core.codec.frames import quaternions_of
from sacha_core.codec.order import KINDS, MATES, Layout
from sacha_core.codec.predicted import decode_levels, encode_levels
from sacha_core.codec.reading import ByteReader
from sacha_core.codec.steps import Classes, StepRule
from sacha_core.codec.turning import Turning, TurnWeights, conjugate, multiply

__all__ = ["TRIANGLE", "WORLD", "decode_rotation", "encode_rotation", "sort_axes"]

TRIANGLE, WORLD = 0, 1  # domains
ROOT_HALF = np.sqrt(0.5)
# quaternions (right factors) that bring the axes into the order of a permutation; a sign of an axis never shows
PERMUTATIONS = {
    (0, 1, 2): (1.0, 0.0, 0.0, 0.0),
    (0, 2, 1): (ROOT_HALF, ROOT_HALF, 0.0, 0.0),
    (2, 1, 0): (ROOT_HALF, 0.0, ROOT_HALF, 0.0),
    (1, 0, 2): (ROOT_HALF, 0.0, 0.0, ROOT_HALF),
    (1, 2, 0): (0.5, 0.5, 0.5, 0.5),
    (2, 0, 1): (0.5, -0.5, -0.5, -0.5),
}
TRIALS = ((1, 0), (1, 2), (0, 1), (0, 0))  # trust in neighbours and in mates that an encoder tries
Rules = tuple[StepRule, ...]


def sort_axes(
    log_scale: Float[np.ndarray, "n 3"], quaternion: Float[np.ndarray, "n 4"]
) -> tuple[Float[np.ndarray, "n 3"], Float[np.ndarray, "n 4"]]:
    """Sort the axes of each Gaussian by falling scale and turn its quaternion to match: the same Gaussian.

    Returns:
        Sorted log-scales, and unit quaternions in float64. A quaternion of length zero counts as no rotation.
    """
    order = np.argsort(-log_scale, axis=1, kind="stable")
    length = np.linalg.norm(quaternion.astype(np.float64), axis=1, keepdims=True)
    unit = np.where(length > 0, quaternion / np.where(length > 0, length, 1), np.array([1.0, 0, 0, 0]))
    factor = np.zeros((len(unit), 4))
    for permutation, turn in PERMUTATIONS.items():
        factor[(order == permutation).all(axis=1)] = turn
    return np.take_along_axis(log_scale, order, axis=1), multiply(unit.T, factor.T).T


def steps_of(rules: Rules, classes: Classes) -> Int[np.ndarray, "n 3"]:
    """Steps of the turns about each axis of a Gaussian, longest first."""
    return np.stack([rule.steps(classes) for rule in rules], axis=1)


def encode_rotation(
    layout: Layout, quaternion: Float[np.ndarray, "n 4"], classes: Classes, rules: Rules, worth: Worth = PLAIN
) -> tuple[bytes, Float[np.ndarray, "n 4"]]:
    """Code unit quaternions that match sorted axes; give the section and what the decoder will have."""
    steps = steps_of(rules, classes)
    targets, domain = quaternion.T.astype(np.float64), TRIANGLE
    weights, bits = choose_weights(layout, targets, steps)
    if layout.template.known:
        turned = multiply(frame_quaternions(layout), targets)
        world_weights, world_bits = choose_weights(layout, turned, steps)
        if world_bits < bits:
            targets, domain, weights = turned, WORLD, world_weights
    coded, known = encode_levels(layout, lambda: Turning(weights, targets), steps, worth)
    head = bytes([domain]) + b"".join(rule.pack() for rule in rules) + weights.pack()
    return head + coded, in_triangle(layout, known.quaternions, domain)


def choose_weights(
    layout: Layout, targets: Float[np.ndarray, "4 n"], steps: Int[np.ndarray, "n 3"]
) -> tuple[TurnWeights, float]:
    """Choose the trust for each kind of pass, by the bits that what is left would roughly take; give it and them."""
    trials = [TurnWeights(np.tile(pair, (KINDS, 1))) for pair in TRIALS]
    bits = np.zeros((len(trials), KINDS))
    for number, trial in enumerate(trials):
        known = Turning(trial, targets)
        known.quaternions = targets
        for step in layout.passes:
            if step.kind != MATES and trial.weights[0, 1]:  # without mates the trial is another's twin
                bits[number, step.kind] = np.inf
                continue
            known.enter(step)
            bits[number, step.kind] += np.log2(1 + np.abs(known.turns()) / steps[step.rows]).sum()
    best = bits.argmin(axis=0)
    chosen = TurnWeights(np.stack([trials[best[kind]].weights[kind] for kind in range(KINDS)]))
    return chosen, float(bits.min(axis=0).sum())


def frame_quaternions(layout: Layout) -> Float[np.ndarray, "4 n"]:
    """Orientation of each Gaussian's triangle in the world."""
    triangles, row = np.unique(layout.binding, return_inverse=True)
    return np.asarray(quaternions_of(layout.template.frames(triangles).axes)[:, row])


def in_triangle(layout: Layout, quaternions: Float[np.ndarray, "4 n"], domain: int) -> Float[np.ndarray, "n 4"]:
    """Give unit quaternions in the frames of the triangles, float32."""
    if domain == WORLD:
        quaternions = multiply(conjugate(frame_quaternions(layout)), quaternions)
    return quaternions.T.astype(np.float32)


def decode_rotation(reader: ByteReader, layout: Layout, classes: Classes) -> Float[np.ndarray, "n 4"]:
    """Read unit quaternions.

    Raises:
        FormatError: the bytes are not what an encoder writes.
    """
    (domain,) = reader.unpack("B")
    if domain not in (TRIANGLE, WORLD) or (domain == WORLD and not layout.template.known):
        raise reader.error(f"domain {domain}, expected {TRIANGLE} (triangles) or, with the head, {WORLD} (world)")
    rules = tuple(StepRule.unpack(reader) for _ in range(3))
    known = Turning(TurnWeights.unpack(reader), np.zeros((4, len(layout))))
    decode_levels(reader, layout, known, steps_of(rules, classes))
    return in_triangle(layout, known.quaternions, domain)
