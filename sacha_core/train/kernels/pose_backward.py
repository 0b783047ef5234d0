"""The way back from the corners of triangles to the parameters of a pose.

A block of vertices belongs to one thread and leaves its own sums, which are added in the blocks' order.
"""

from __future__ import annotations

import numpy as np

from sacha_core.animation.kernels.posing import BLOCK
from sacha_core.geometry.rotation import ANGLE_OFFSET_RAD, SMALLEST_ANGLE_RAD
from sacha_core.parallel.kernels.kernel import kernel

FAST = {"contract", "nsz", "arcp", "reassoc"}


@kernel(error_model="numpy", fastmath=FAST, forceinline=True)
def skin_backward(
    start, stop, corners, first_corner, g_corners, unposed, weights, transforms, g_unposed, g_transforms, g_translation
):
    """Give the gradients of skinning for the vertices `start` to `stop`.

    Args:
        start: first vertex.
        stop: end of the range.
        corners: corners of triangles in the order of their vertices: 3 f + place.
        first_corner: (v + 1,) first of each vertex.
        g_corners: (3 f, 3) by the place of each corner.
        unposed: (v, 3) vertices before skinning.
        weights: (v, j).
        transforms: (j, 3, 4) joints' maps.
        g_unposed: flat out, of these vertices.
        g_transforms: (j, 3, 4) float64 out.
        g_translation: (3,) float64 out.
    """
    zero = g_corners.dtype.type(0)
    g_transforms[:] = 0
    g_translation[:] = 0
    for v in range(start, stop):
        gx, gy, gz = zero, zero, zero
        for at in range(first_corner[v], first_corner[v + 1]):
            corner = corners[at]
            gx, gy, gz = gx + g_corners[corner, 0], gy + g_corners[corner, 1], gz + g_corners[corner, 2]
        ux, uy, uz = unposed[v, 0], unposed[v, 1], unposed[v, 2]
        px, py, pz = zero, zero, zero
        for j in range(weights.shape[1]):
            weight = weights[v, j]
            if weight != 0:
                wx, wy, wz = weight * gx, weight * gy, weight * gz
                px += transforms[j, 0, 0] * wx + transforms[j, 1, 0] * wy + transforms[j, 2, 0] * wz
                py += transforms[j, 0, 1] * wx + transforms[j, 1, 1] * wy + transforms[j, 2, 1] * wz
                pz += transforms[j, 0, 2] * wx + transforms[j, 1, 2] * wy + transforms[j, 2, 2] * wz
                for i, g in enumerate((wx, wy, wz)):
                    g_transforms[j, i, 0] += g * ux
                    g_transforms[j, i, 1] += g * uy
                    g_transforms[j, i, 2] += g * uz
                    g_transforms[j, i, 3] += g
        at = 3 * (v - start)
        g_unposed[at], g_unposed[at + 1], g_unposed[at + 2] = px, py, pz
        g_translation[0] += gx
        g_translation[1] += gy
        g_translation[2] += gz


@kernel(error_model="numpy", fastmath=FAST, forceinline=True)
def project(first, directions, moves, rows, gradient, out):
    """Write the products of directions (k, 3 v), from the coordinate `first` on, with a block's gradient; four at a time.

    Only of those that move anything there, as `moves` (k,) tells; `rows` (k,) is space.
    """
    zero = gradient.dtype.type(0)
    size, count = len(gradient), 0
    for k in range(len(directions)):
        out[k] = 0
        if moves[k]:
            rows[count] = k
            count += 1
    for at in range(0, count, 4):
        k, k1 = rows[at], rows[min(at + 1, count - 1)]  # at the end some twice
        k2, k3 = rows[min(at + 2, count - 1)], rows[min(at + 3, count - 1)]
        a, b = directions[k, first : first + size], directions[k1, first : first + size]
        c, d = directions[k2, first : first + size], directions[k3, first : first + size]
        sum_a, sum_b, sum_c, sum_d = zero, zero, zero, zero
        for x in range(size):
            slope = gradient[x]
            sum_a += a[x] * slope
            sum_b += b[x] * slope
            sum_c += c[x] * slope
            sum_d += d[x] * slope
        out[k], out[k1], out[k2], out[k3] = sum_a, sum_b, sum_c, sum_d


@kernel(forceinline=True)  # what it calls may round otherwise in other surroundings
def vertices_backward(
    start, stop, corners, first_corner, g_corners, unposed, weights, transforms, directions, moves,
    g_unposed, g_transforms, g_translations, g_coefficients,
):  # fmt: skip
    """Sum the blocks `start` to `stop` of vertices; arguments as of `skin_backward`, of which the sums have a row for each block.

    Further
        directions: (k, 3 v) that coefficients move the unposed vertices along.
        moves: (blocks, k) whether one moves any vertex of a block.
        g_unposed: (3 BLOCK,) space.
        g_coefficients: (blocks, k) float64 out.
    """
    rows = np.empty(len(directions), np.int64)
    for block in range(start, stop):
        first, last = block * BLOCK, min((block + 1) * BLOCK, len(unposed))
        part = g_unposed[: 3 * (last - first)]
        skin_backward(
            first, last, corners, first_corner, g_corners, unposed, weights, transforms, part, g_transforms[block], g_translations[block]
        )  # fmt: skip
        project(3 * first, directions, moves[block], rows, part, g_coefficients[block])


@kernel
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


@kernel
def rodrigues_backward(vectors, rotation_gradient, out):
    r"""Write the gradient of `rotation_vectors_to_matrices` to `out` (j, 3).

    With R = I + a K + b K^2, K^2 = v v^T - |v|^2 I, both coefficients functions of the angle f: a' = (cos f - a) / f, b' = (a - 2 b) / f.
    """
    for j in range(vectors.shape[0]):
        v = vectors[j].astype(np.float64)
        g = rotation_gradient[j]
        shifted = v + ANGLE_OFFSET_RAD
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


@kernel
def pose_backward(
    g_transforms, g_translations, g_coefficients, vectors, rotations, joints, parents, transforms, joint_directions, has_correctives,
    g_expression, g_vectors, g_translation,
):  # fmt: skip
    """Add the blocks' sums up and go back from them to expression (e,), axis-angle vectors (5, 3) and translation (3,), all float64.

    Vectors of joints that the head lacks get no gradient.
    """
    n_joints, n_expression = len(joints), len(g_expression)
    by_transform, by_coefficient = np.zeros((n_joints, 3, 4)), np.zeros(g_coefficients.shape[1])
    g_translation[:] = 0
    for block in range(len(g_transforms)):
        by_transform += g_transforms[block]
        by_coefficient += g_coefficients[block]
        g_translation += g_translations[block]
    by_rotation, by_joint = np.zeros((n_joints, 3, 3)), np.zeros((n_joints, 3))
    if has_correctives:
        by_rotation[1:] = by_coefficient[n_expression:].reshape((n_joints - 1, 3, 3))
    joints_backward(rotations, joints, parents, transforms, by_transform, by_rotation, by_joint)
    g_vectors[:] = 0
    rodrigues_backward(vectors, by_rotation, g_vectors)
    for e in range(n_expression):
        slope = by_coefficient[e]
        for j in range(n_joints):
            for c in range(3):
                slope += joint_directions[j, c, e] * by_joint[j, c]
        g_expression[e] = slope
