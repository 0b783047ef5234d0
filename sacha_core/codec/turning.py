r"""Orientations predicted from orientations: what is coded is the turn from the expected one.

A Gaussian looks the same after a half turn about any of its axes, and a quaternion q is the rotation that -q is: of the eight that describe
a neighbour, the one closest to the others counts. Expected is the weighted sum of neighbours and mates, brought to length one; the turn
from there is a rotation in the Gaussian's own axes, mostly a small one.

Float64 operations of which each is rounded alone, in the order written, so that every machine has the same bits.

Source: own.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float, Int

from sacha_core.codec.loops import compiled_loops
from sacha_core.codec.order import KINDS, Pass, trusted
from sacha_core.codec.reading import ByteReader

__all__ = ["UNIT", "TurnWeights", "Turning", "conjugate", "multiply", "nearest_to", "rotation_vector", "turn_of"]

UNIT = 2.0**-14
Quaternions = Float[np.ndarray, "4 p"]  # wxyz


def multiply(a: Quaternions, b: Quaternions) -> Quaternions:
    """Hamilton product."""
    w, x, y, z = a
    s, i, j, k = b
    return np.stack(
        [
            ((w * s - x * i) - y * j) - z * k,
            ((w * i + x * s) + y * k) - z * j,
            ((w * j - x * k) + y * s) + z * i,
            ((w * k + x * j) - y * i) + z * s,
        ]
    )


def conjugate(q: Quaternions) -> Quaternions:
    """The turn back."""
    return np.stack([q[0], -q[1], -q[2], -q[3]])


def nearest_to(q: Quaternions, other: Quaternions) -> Quaternions:
    """Give, of the eight quaternions that describe each Gaussian, the one of the largest dot product with another."""
    w, x, y, z = q
    turned = ((w, x, y, z), (-x, w, z, -y), (-y, -z, w, x), (-z, y, -x, w))
    dots = [((a * other[0] + b * other[1]) + c * other[2]) + d * other[3] for a, b, c, d in turned]
    best, chosen = dots[0], q
    for dot, candidate in zip(dots[1:], turned[1:], strict=True):
        better = np.abs(dot) > np.abs(best)
        best, chosen = np.where(better, dot, best), np.where(better, np.stack(candidate), chosen)
    return np.where(best < 0, -chosen, chosen)


def rotation_vector(q: Quaternions) -> Float[np.ndarray, "3 p"]:
    """Give (x, y, z) of the equivalent quaternion with the largest w, which is positive: the nearest to no turn."""
    w, x, y, z = q
    largest = np.abs(q).argmax(axis=0)
    sign = np.where(np.choose(largest, (w, -x, -y, -z)) < 0, -1.0, 1.0)
    return np.stack([np.choose(largest, turned) for turned in ((x, w, -z, y), (y, z, w, -x), (z, -y, x, w))]) * sign


def turn_of(vector: Int[np.ndarray, "p 3"]) -> Quaternions:
    """Give the unit quaternion of (x, y, z) in `UNIT`."""
    x, y, z = (vector[:, axis].astype(np.float64) * UNIT for axis in range(3))
    squared = (x * x + y * y) + z * z
    w = np.sqrt(np.maximum(1.0 - squared, 0.0))
    length = np.sqrt(w * w + squared)
    return np.stack([w / length, x / length, y / length, z / length])


@dataclass(frozen=True)
class TurnWeights:
    """Trust in neighbours and mates.

    Args:
        weights: (KINDS, 2) of neighbours and of mates, 0 to 255; where both are 0 the axes of the domain are expected.
    """

    weights: Int[np.ndarray, "k 2"]

    def pack(self) -> bytes:
        """Write the weights."""
        return self.weights.astype(np.uint8).tobytes()

    @classmethod
    def unpack(cls, reader: ByteReader) -> TurnWeights:
        """Read the weights."""
        return cls(np.frombuffer(reader.take(2 * KINDS), np.uint8).reshape(KINDS, 2).astype(np.int64))

    def expect(self, step: Pass, known: Quaternions) -> Quaternions:
        """Give the expected orientations of a pass."""
        total = np.zeros((4, len(step.rows)))
        near, mates = self.weights[step.kind].tolist()
        compiled = compiled_loops("gathers", known.shape[1])
        for weight, rows, trust in ((mates, step.mates, step.mate_trust), (near, step.near, step.trust)):
            if not (weight and trusted(trust)):
                continue
            if compiled:
                compiled.add_orientations(known, rows, np.ascontiguousarray(trust), weight, total)
            else:
                for column in range(rows.shape[1]):
                    share = (weight * trust[:, column]).astype(np.float64)
                    total = total + nearest_to(known[:, rows[:, column]], total) * share
        w, x, y, z = total
        length = np.sqrt(((w * w + x * x) + y * y) + z * z)
        none = length == 0
        return np.where(none, np.array([[1.0], [0], [0], [0]]), total / np.where(none, 1.0, length))


class Turning:
    """Orientations, as a prediction.

    Args:
        weights: trust in neighbours and mates.
        targets: (4, n) what an encoder is to code, unit quaternions; a decoder gives zeros.
    """

    def __init__(self, weights: TurnWeights, targets: Quaternions) -> None:
        self._weights = weights
        self._targets = targets
        self.quaternions = np.zeros(targets.shape)

    def enter(self, step: Pass) -> None:
        """Begin a pass."""
        self._rows = step.rows
        self._expected = self._weights.expect(step, self.quaternions)
        self._turn = np.zeros((len(step.rows), 3), np.int64)

    def turns(self) -> Int[np.ndarray, "p 3"]:
        """Give the turns from the expected orientations to the targets, in `UNIT`."""
        turn = multiply(conjugate(self._expected), self._targets[:, self._rows])
        return np.rint(rotation_vector(turn) / UNIT).astype(np.int64).T

    def residual(self, component: int) -> Int[np.ndarray, " p"]:
        """Give one component of the turns."""
        if component == 0:
            self._wanted = self.turns()
        return np.asarray(self._wanted[:, component])

    def learn(self, component: int, difference: Int[np.ndarray, " p"]) -> None:
        """Take in a component; after the last turn what was expected."""
        self._turn[:, component] = difference
        if component == 2:
            self.quaternions[:, self._rows] = multiply(self._expected, turn_of(self._turn))
