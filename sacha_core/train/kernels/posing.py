"""Posing a head and the gradients of it. Serial and in fixed order; sums over the mesh in float64."""

from __future__ import annotations

import numpy as np
from numba import njit

from sacha_core.geometry.rotation import SMALLEST_ANGLE_RAD

FAST = {"contract", "nsz", "arcp", "reassoc"}


@njit(cache=True, nogil=True, fastmath=FAST)
def skin(unposed, weights, transforms, translation, out):
    """Write to `out` (v, 3) the vertices that joints' maps (j, 3, 4) move by their weights (v, j), and then the translation."""
    for v in range(unposed.shape[0]):
        x, y, z = unposed[v, 0], unposed[v, 1], unposed[v, 2]
        for i in range(3):
            out[v, i] = translation[i]
        for j in range(weights.shape[1]):
            weight = weights[v, j]
            if weight != 0:
                for i in range(3):
                    a = transforms[j, i]
                    out[v, i] += weight * (a[0] * x + a[1] * y + a[2] * z + a[3])


@njit(cache=True, nogil=True, fastmath=FAST)
def skin_backward(gradient, unposed, weights, transforms, unposed_gradient, transform_gradient, translation_gradient):
    """Give the gradients of `skin`: of the unposed vertices (written), the joints' maps and the translation (float64, added to)."""
    outer = np.zeros((3, 4))
    for v in range(unposed.shape[0]):
        for i in range(3):
            g = gradient[v, i]
            translation_gradient[i] += g
            for c in range(3):
                outer[i, c] = g * unposed[v, c]
            outer[i, 3] = g
            unposed_gradient[v, i] = 0
        for j in range(weights.shape[1]):
            weight = weights[v, j]
            if weight != 0:
                for i in range(3):
                    for c in range(3):
                        unposed_gradient[v, c] += weight * transforms[j, i, c] * gradient[v, i]
                    for c in range(4):
                        transform_gradient[j, i, c] += weight * outer[i, c]


@njit(cache=True, nogil=True)
def joints_backward(rotations, joints, parents, transforms, transform_gradient, rotation_gradient, joint_gradient):
    """Add the gradients of `joint_transforms` to those of the joints' rotations (j, 3, 3) and places (j, 3).

    A joint's map is world rotation G and translation P - G J with P its place in the world; both come from the parent's:
    G = G_parent R, P = P_parent + G_parent (J - J_parent). Children come after their parents, so they are undone first.
    """
    n = joints.shape[0]
    world = np.empty((n, 3, 3))  # gradient of G
    place = np.empty((n, 3))  # gradient of P
    for j in range(n):
        for i in range(3):
            moved = transform_gradient[j, i, 3]
            place[j, i] = moved
            for c in range(3):
                world[j, i, c] = transform_gradient[j, i, c] - moved * joints[j, c]
                joint_gradient[j, c] -= transforms[j, i, c] * moved
    for j in range(n - 1, -1, -1):
        parent = parents[j]
        if parent < 0:
            rotation_gradient[j] += world[j]
            joint_gradient[j] += place[j]
            continue
        for i in range(3):
            place[parent, i] += place[j, i]
            for c in range(3):
                bone = joints[j, c] - joints[parent, c]
                world[parent, i, c] += place[j, i] * bone
                turned = transforms[parent, i, c] * place[j, i]
                joint_gradient[j, c] += turned
                joint_gradient[parent, c] -= turned
                for m in range(3):
                    world[parent, i, m] += world[j, i, c] * rotations[j, m, c]
                    rotation_gradient[j, c, m] += transforms[parent, i, c] * world[j, i, m]


@njit(cache=True, nogil=True)
def rodrigues_backward(vectors, rotation_gradient, angle_offset, out):
    r"""Write the gradient of `rotation_vectors_to_matrices` to `out` (j, 3).

    With R = I + a K + b K^2, K^2 = v v^T - |v|^2 I, both coefficients functions of the angle f: a' = (cos f - a) / f, b' = (a - 2 b) / f.
    """
    for j in range(vectors.shape[0]):
        v = vectors[j].astype(np.float64)
        g = rotation_gradient[j]
        shifted = v + angle_offset
        angle = max(np.sqrt(np.sum(shifted * shifted)), SMALLEST_ANGLE_RAD)
        a = np.sin(angle) / angle
        b = 2 * (np.sin(angle / 2) / angle) ** 2
        skew = np.array([g[2, 1] - g[1, 2], g[0, 2] - g[2, 0], g[1, 0] - g[0, 1]])
        trace = g[0, 0] + g[1, 1] + g[2, 2]
        square = 0.0
        for i in range(3):
            for c in range(3):
                square += g[i, c] * v[i] * v[c]
        squared_length = np.sum(v * v)
        square -= trace * squared_length
        by_angle = np.sum(skew * v) * (np.cos(angle) - a) / angle + square * (a - 2 * b) / angle
        for i in range(3):
            symmetric = -2 * trace * v[i]
            for c in range(3):
                symmetric += (g[i, c] + g[c, i]) * v[c]
            out[j, i] = a * skew[i] + b * symmetric + by_angle * shifted[i] / angle
