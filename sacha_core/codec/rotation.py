r"""Section `Rotation`: three components of a unit quaternion.

A Gaussian looks the same after a half turn about any of its axes, so of the eight quaternions that describe it the one with the largest $w$
is taken: $w \ge 1/2$, and $(x, y, z)$ says it all.

Source: own.
"""

from __future__ import annotations

import numpy as np
from jaxtyping import Float, Int

from sacha_core.codec.choice import PLAIN, Worth
from sacha_core.codec.order import Layout
from sacha_core.codec.predicted import decode_predicted, encode_predicted
from sacha_core.codec.reading import ByteReader
from sacha_core.codec.steps import Classes, StepRule

__all__ = ["decode_rotation", "encode_rotation", "rotation_vector", "sort_axes", "turn_slopes"]

UNIT = 2.0**-14
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


def multiply(a: Float[np.ndarray, "n 4"], b: Float[np.ndarray, "n 4"]) -> Float[np.ndarray, "n 4"]:
    """Hamilton product, wxyz."""
    w, x, y, z = a.T
    s, i, j, k = b.T
    return np.stack(
        [
            w * s - x * i - y * j - z * k,
            w * i + x * s + y * k - z * j,
            w * j - x * k + y * s + z * i,
            w * k + x * j - y * i + z * s,
        ],
        axis=1,
    )


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
    return np.take_along_axis(log_scale, order, axis=1), multiply(unit, factor)


def rotation_vector(quaternion: Float[np.ndarray, "n 4"]) -> Float[np.ndarray, "n 3"]:
    """Give (x, y, z) of the equivalent unit quaternion with the largest w, which is positive."""
    w, x, y, z = quaternion.T
    turned = np.stack(
        [quaternion, np.stack([-x, w, z, -y], 1), np.stack([-y, -z, w, x], 1), np.stack([-z, y, -x, w], 1)]
    )
    best = np.argmax(np.abs(turned[:, :, 0]), axis=0)
    chosen = turned[best, np.arange(len(best))]
    return chosen[:, 1:] * np.where(chosen[:, :1] < 0, -1.0, 1.0)  # type: ignore[no-any-return]


def turn_slopes(quaternion: Float[np.ndarray, "n 4"]) -> Float[np.ndarray, "n 3 3"]:
    """How far a Gaussian turns about each of its own axes when each component of `rotation_vector` changes, radians.

    A turn by v changes a unit quaternion q by q (0, v / 2), so v is twice the vector part of q* dq, where dw = -(x dx + y dy + z dz) / w.
    """
    x, y, z = rotation_vector(quaternion).T
    w = np.sqrt(np.maximum(1 - x * x - y * y - z * z, 0.25))
    columns = []
    for component in range(3):
        change = np.zeros((len(x), 4))
        change[:, 0] = -(x, y, z)[component] / w
        change[:, component + 1] = 1
        columns.append(2 * multiply(np.stack([w, -x, -y, -z], axis=1), change)[:, 1:])
    return np.stack(columns, axis=2)


def encode_rotation(
    layout: Layout, quaternion: Float[np.ndarray, "n 4"], classes: Classes, rule: StepRule, worth: Worth = PLAIN
) -> tuple[bytes, Int[np.ndarray, "n 3"]]:
    """Code unit quaternions that match sorted axes; give the section and the decoder's integers."""
    values = np.rint(rotation_vector(quaternion) / UNIT).astype(np.int64)
    coded, decoded = encode_predicted(layout, values, rule.steps(classes)[:, None], worth)
    return rule.pack() + coded, decoded


def decode_rotation(reader: ByteReader, layout: Layout, classes: Classes) -> Float[np.ndarray, "n 4"]:
    """Read unit quaternions.

    Raises:
        FormatError: the bytes are not what an encoder writes.
    """
    rule = StepRule.unpack(reader)
    values = decode_predicted(reader, layout, rule.steps(classes)[:, None], 3)
    x, y, z = (values.astype(np.float64) * UNIT).T
    squared = x * x + y * y + z * z
    w = np.sqrt(np.maximum(1.0 - squared, 0.0))
    length = np.sqrt(w * w + squared)
    return np.stack([w / length, x / length, y / length, z / length], axis=1).astype(np.float32)
