r"""What errors of harmonics are worth to pictures, and what the mean colour takes over of them: the encoder's business.

With M the metric of a Gaussian's coefficients of one colour, that of degree 0 first, an error e of all of them changes pictures by
$e^T M e$. Degree 0 is coded last, so it can take over what an error of the others does on average: with m the first row of M without its
first element w, by $m \cdot e / w$. What is left is $e^T S e$ with $S = M - m m^T / w$ over the other coefficients.

Source: own; S is a Schur complement.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float

from sacha_core.avatar.gaussians import Gaussians
from sacha_core.codec.importance import GaussianImportance
from sacha_core.codec.steps import Classes, StepRule
from sacha_core.flame.model import HeadModel

__all__ = ["Metric", "metric_of", "ring_metric", "weigh"]

RING_AZIMUTHS = np.radians(np.linspace(-75, 75, 7))
RING_ELEVATIONS = np.radians([-10.0, 3.0, 16.0])
AMBIENT = 0.05  # of what faces a camera: Gaussians are seen past their edge as well
EVERYWHERE = 0.2  # weight of directions all around: from behind or above 1 to 3 dB less error, for 1 % of bytes
RING_SHARE = 1.5  # of a measured weight is spread as the ring says: a few noisy views must not tell what the others see
UNMEASURED = 0.01  # of what was measured stays with what the ring says
N_SPHERE = 64
AT_ONCE = 1024  # Gaussians whose metrics stay in a processor's cache


@dataclass(frozen=True)
class Metric:
    """What errors are worth.

    Args:
        weight: (n,) squared change of the picture by a squared error of degree 0.
        fold: (n, k) what degree 0 takes over of an error of each coefficient.
        left: (n, k, k) what is left of the squared change.
    """

    weight: Float[np.ndarray, " n"]
    fold: Float[np.ndarray, "n k"]
    left: Float[np.ndarray, "n k k"]

    def folded(self, sh_dc: Float[np.ndarray, "n 3"], error: Float[np.ndarray, "n k 3"]) -> Float[np.ndarray, "n 3"]:
        """Give coefficients of degree 0 that take over what they can of what the others lost."""
        return np.asarray(sh_dc + np.einsum("nk,nka->na", self.fold, error))


def metric_of(
    gaussians: Gaussians,
    head: HeadModel | None,
    importance: GaussianImportance | None,
    rule: StepRule,
    classes: Classes,
) -> Metric:
    """Give what errors of Gaussians are worth, from what is known: rendering, the head, or neither.

    Args:
        gaussians: in the order of `classes`.
        head: tells where they face.
        importance: of the same Gaussians; its `colour_metric` is what counts here.
        rule: of the steps.
        classes: what they depend on.
    """
    normals = None
    if head is not None:
        corners = head.v_template[head.faces[gaussians.binding]].astype(np.float64)
        across = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
        normals = across / np.maximum(np.linalg.norm(across, axis=1, keepdims=True), 1e-30)
    measured = None if importance is None else importance.colour_metric
    return weigh(measured, normals, gaussians.sh_rest.shape[1] + 1, rule, classes)


def weigh(
    measured: Float[np.ndarray, "n k1 k1"] | None,
    normals: Float[np.ndarray, "n 3"] | None,
    n_coefficients: int,
    rule: StepRule,
    classes: Classes,
) -> Metric:
    """Give what errors are worth.

    Args:
        measured: metric by rendering; None takes the steps' rule for it, which stands for opacity and area.
        normals: as of `ring_metric`.
        n_coefficients: likewise.
        rule: of the steps.
        classes: what they depend on.
    """
    by_rule = np.exp2(-rule.shift(classes) / 4.0)
    ringed = by_rule
    if measured is not None:
        seen = measured[:, 0, 0].astype(np.float64) / (1 + RING_SHARE)
        share = UNMEASURED * seen.sum() / max(by_rule.sum(), 1e-30)
        ringed = share * by_rule + RING_SHARE * seen
    n, k = len(by_rule), n_coefficients - 1
    weight, fold, left = np.empty(n), np.empty((n, k), np.float32), np.empty((n, k, k), np.float32)
    for start in range(0, n, AT_ONCE):
        rows = slice(start, start + AT_ONCE)
        ring = ring_metric(None if normals is None else normals[rows], n_coefficients)
        whole = (ring / np.maximum(ring[:, :1, :1], 1e-30)).astype(np.float32)
        whole = whole * ringed[rows, None, None].astype(np.float32)
        if measured is not None:
            whole += measured[rows] * np.float32(1 / (1 + RING_SHARE))
        weight[rows] = np.maximum(whole[:, 0, 0], 1e-30)
        fold[rows] = whole[:, 0, 1:] / weight[rows, None].astype(np.float32)
        left[rows] = whole[:, 1:, 1:] - whole[:, 0, 1:, None] * fold[rows, None]
    return Metric(weight, fold, left)


def ring_metric(normals: Float[np.ndarray, "n 3"] | None, n_coefficients: int) -> Float[np.ndarray, "m k1 k1"]:
    """Metric of Gaussians of known normals under cameras around the front of a head; without normals one for all.

    Args:
        normals: (n, 3) unit, of their triangles at rest, world axes.
        n_coefficients: with degree 0: 4, 9 or 16.
    """
    directions = ring_directions()
    seen = np.ones((1, len(directions))) if normals is None else np.maximum(normals @ -directions.T, 0) + AMBIENT
    basis = harmonics(directions)[:, :n_coefficients]
    sphere = harmonics(sphere_directions())[:, :n_coefficients]
    everywhere = sphere.T @ sphere / N_SPHERE
    outer = (basis[:, :, None] * basis[:, None]).reshape(len(directions), -1).astype(np.float32)
    shares = (seen / seen.sum(axis=1, keepdims=True)).astype(np.float32)
    total = shares @ outer + np.float32(EVERYWHERE) * everywhere.reshape(1, -1).astype(np.float32)
    return np.asarray(total.reshape(len(seen), n_coefficients, n_coefficients))


def ring_directions() -> Float[np.ndarray, "v 3"]:
    """Directions of view of the ring's cameras, from the camera on."""
    azimuth, elevation = (grid.ravel() for grid in np.meshgrid(RING_AZIMUTHS, RING_ELEVATIONS))
    places = np.stack(
        [np.sin(azimuth) * np.cos(elevation), np.sin(elevation), np.cos(azimuth) * np.cos(elevation)], axis=1
    )
    return -places


def sphere_directions() -> Float[np.ndarray, "v 3"]:
    """Directions all around, evenly: Fibonacci's spiral."""
    turn = np.pi * (3 - np.sqrt(5)) * np.arange(N_SPHERE)
    height = 1 - (2 * np.arange(N_SPHERE) + 1) / N_SPHERE
    radius = np.sqrt(1 - height**2)
    return np.stack([radius * np.cos(turn), height, radius * np.sin(turn)], axis=1)


def harmonics(direction: Float[np.ndarray, "v 3"]) -> Float[np.ndarray, "v 16"]:
    """Real harmonics with the Condon-Shortley phase, as rasterisers of Gaussians use them."""
    x, y, z = direction.T
    xx, yy, zz = x * x, y * y, z * z
    third = 4 * zz - xx - yy
    values = [
        np.full_like(x, 0.28209479177387814),
        -0.4886025119029199 * y, 0.4886025119029199 * z, -0.4886025119029199 * x,
        1.0925484305920792 * x * y, -1.0925484305920792 * y * z, 0.31539156525252005 * (2 * zz - xx - yy),
        -1.0925484305920792 * x * z, 0.5462742152960396 * (xx - yy),
        -0.5900435899266435 * y * (3 * xx - yy), 2.890611442640554 * x * y * z, -0.4570457994644658 * y * third,
        0.3731763325901154 * z * (2 * zz - 3 * xx - 3 * yy), -0.4570457994644658 * x * third,
        1.445305721320277 * z * (xx - yy), -0.5900435899266435 * x * (xx - 3 * yy),
    ]  # fmt: skip
    return np.stack(values, axis=1)
