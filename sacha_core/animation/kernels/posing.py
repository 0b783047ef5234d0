"""Posing a head: joints, blend shapes and skinning, in the dtype of the arrays.

A range of vertices is worked off in blocks that begin at multiples of `BLOCK`, so a vertex has the same bits whichever thread poses it.
"""

from __future__ import annotations

import math

from sacha_core.geometry.rotation import ANGLE_OFFSET_RAD, SMALLEST_ANGLE_RAD
from sacha_core.parallel.kernels.kernel import kernel

FAST = {"contract", "nsz", "arcp", "reassoc"}
BLOCK = 512  # vertices; their coordinates stay in the first-level cache while the directions stream by


@kernel(error_model="numpy")
def rotate(vectors, rotations):
    """Write the matrix (j, 3, 3) of each rotation vector (j, 3), in float64: `rotation_vectors_to_matrices` says how."""
    for j in range(rotations.shape[0]):
        x, y, z = float(vectors[j, 0]), float(vectors[j, 1]), float(vectors[j, 2])
        square = (x + ANGLE_OFFSET_RAD) ** 2 + (y + ANGLE_OFFSET_RAD) ** 2 + (z + ANGLE_OFFSET_RAD) ** 2
        angle = max(math.sqrt(square), SMALLEST_ANGLE_RAD)
        a = math.sin(angle) / angle
        b = 2 * (math.sin(angle / 2) / angle) ** 2
        r = rotations[j]
        r[0, 0], r[0, 1], r[0, 2] = 1 - b * (y * y + z * z), b * x * y - a * z, b * x * z + a * y
        r[1, 0], r[1, 1], r[1, 2] = b * x * y + a * z, 1 - b * (x * x + z * z), b * y * z - a * x
        r[2, 0], r[2, 1], r[2, 2] = b * x * z - a * y, b * y * z + a * x, 1 - b * (x * x + y * y)


@kernel(error_model="numpy")
def place_joints(template_joints, directions, expression, joints):
    """Write where the joints (j, 3) lie unposed, with directions (j, 3, e)."""
    for j in range(joints.shape[0]):
        for c in range(3):
            place = float(template_joints[j, c])
            for e in range(expression.shape[0]):
                place += directions[j, c, e] * expression[e]
            joints[j, c] = place


@kernel(error_model="numpy")
def chain_joints(rotations, joints, parents, transforms):
    """Write each joint's map (j, 3, 4) from the unposed to the posed head: `joint_transforms` says how."""
    for j in range(joints.shape[0]):
        parent = parents[j]
        for i in range(3):
            place = float(joints[j, i])
            if parent >= 0:
                a = transforms[parent, i]
                place = a[0] * joints[j, 0] + a[1] * joints[j, 1] + a[2] * joints[j, 2] + a[3]
            for c in range(3):
                turned = float(rotations[j, i, c])
                if parent >= 0:
                    a = transforms[parent, i]
                    turned = a[0] * rotations[j, 0, c] + a[1] * rotations[j, 1, c] + a[2] * rotations[j, 2, c]
                transforms[j, i, c] = turned
                place -= turned * joints[j, c]
            transforms[j, i, 3] = place


@kernel(error_model="numpy")
def gather_active(expression, rotations, has_correctives, rows, coefficients):
    """List which directions a pose uses at all (k,), with their coefficients: expression, then each joint's R - I but the root's.

    Returns:
        How many there are.
    """
    count = 0
    for e in range(expression.shape[0]):
        if expression[e] != 0:
            rows[count], coefficients[count] = e, expression[e]
            count += 1
    if has_correctives:
        first = rows.shape[0] - 9 * (rotations.shape[0] - 1)  # behind all expressions, of which a pose may give fewer
        for j in range(1, rotations.shape[0]):
            for i in range(3):
                for c in range(3):
                    bend = rotations[j, i, c] - (1 if i == c else 0)
                    if bend != 0:
                        rows[count] = first + 9 * (j - 1) + 3 * i + c
                        coefficients[count] = bend
                        count += 1
    return count


@kernel(error_model="numpy", fastmath=FAST, forceinline=True)
def blend_shapes(start, stop, template, directions, moves, rows, coefficients, count, unposed):
    """Write the unposed coordinates `start` to `stop` (all arrays flat): the template and the active rows of the directions.

    Eight directions at a time, so that a coordinate is loaded and stored once for eight products. On slices, since a loop that begins at 0
    needs no care for negative indices, which would keep it from being vectorised. Eight that move nothing here are passed over,
    which changes no bit; `moves` (k,) tells what does.
    """
    out, template = unposed[start:stop], template[start:stop]
    for i in range(out.size):
        out[i] = template[i]
    for k in range(0, count - 7, 8):
        moving = False
        for j in range(k, k + 8):
            moving |= moves[rows[j]]
        if not moving:
            continue
        d0, d1 = directions[rows[k]][start:stop], directions[rows[k + 1]][start:stop]
        d2, d3 = directions[rows[k + 2]][start:stop], directions[rows[k + 3]][start:stop]
        d4, d5 = directions[rows[k + 4]][start:stop], directions[rows[k + 5]][start:stop]
        d6, d7 = directions[rows[k + 6]][start:stop], directions[rows[k + 7]][start:stop]
        c0, c1, c2, c3 = coefficients[k], coefficients[k + 1], coefficients[k + 2], coefficients[k + 3]
        c4, c5, c6, c7 = coefficients[k + 4], coefficients[k + 5], coefficients[k + 6], coefficients[k + 7]
        for i in range(out.size):
            first = c0 * d0[i] + c1 * d1[i] + c2 * d2[i] + c3 * d3[i]
            second = c4 * d4[i] + c5 * d5[i] + c6 * d6[i] + c7 * d7[i]
            out[i] += first + second
    for k in range(count - count % 8, count):
        if not moves[rows[k]]:
            continue
        d0, c0 = directions[rows[k]][start:stop], coefficients[k]
        for i in range(out.size):
            out[i] += c0 * d0[i]


@kernel(error_model="numpy", fastmath=FAST, forceinline=True)
def skin(unposed, weights, transforms, translation, vertices):
    """Write posed vertices (v, 3): each joint's map under its weight, and then the translation. `unposed` is flat."""
    for v in range(vertices.shape[0]):
        x, y, z = unposed[3 * v], unposed[3 * v + 1], unposed[3 * v + 2]
        px, py, pz = translation[0], translation[1], translation[2]
        for j in range(weights.shape[1]):
            weight = weights[v, j]
            if weight != 0:
                t = transforms
                px += weight * (t[j, 0, 0] * x + t[j, 0, 1] * y + t[j, 0, 2] * z + t[j, 0, 3])
                py += weight * (t[j, 1, 0] * x + t[j, 1, 1] * y + t[j, 1, 2] * z + t[j, 1, 3])
                pz += weight * (t[j, 2, 0] * x + t[j, 2, 1] * y + t[j, 2, 2] * z + t[j, 2, 3])
        vertices[v, 0], vertices[v, 1], vertices[v, 2] = px, py, pz


@kernel(error_model="numpy")
def pose_joints(
    expression, vectors, template_joints, joint_directions, parents, has_correctives,
    joints, rotations, transforms, rows, coefficients,
):  # fmt: skip
    """Do all that comes before the vertices; gives how many directions are active."""
    rotate(vectors, rotations)
    place_joints(template_joints, joint_directions, expression, joints)
    chain_joints(rotations, joints, parents, transforms)
    return gather_active(expression, rotations, has_correctives, rows, coefficients)


@kernel(error_model="numpy", forceinline=True)  # what it calls may round otherwise in other surroundings
def pose_vertices(
    start, stop, template, directions, moves, rows, coefficients, count, weights, transforms, translation, unposed, vertices,
):  # fmt: skip
    """Write the vertices `start` (a multiple of BLOCK) to `stop`, unposed (flat) and posed (v, 3); `moves` has a row for each block."""
    for block in range(start, stop, BLOCK):
        end = min(block + BLOCK, stop)
        blend_shapes(
            3 * block, 3 * end, template, directions, moves[block // BLOCK], rows, coefficients, count, unposed
        )
        skin(unposed[3 * block : 3 * end], weights[block:end], transforms, translation, vertices[block:end])
