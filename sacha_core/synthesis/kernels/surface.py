"""Loops over vertices: normals, points between the vertices of a mesh, projection."""

from __future__ import annotations

import numpy as np

from sacha_core.parallel.kernels.kernel import kernel

FAST = {"contract", "nsz", "arcp", "reassoc"}
SUBPIXEL_BITS = (
    8  # screen positions are whole numbers of 1/256 pixel, so that edges shared by two triangles leave no gap
)
FARTHEST_PIXEL = 1 << 20  # beyond it a vertex is not drawn: edge functions would overflow


@kernel(fastmath=FAST)
def vertex_normals(vertices, faces, normals):
    """Fill `normals` (v, 3) with unit normals, each the mean over its triangles weighted by area."""
    normals[:] = 0
    for f in range(len(faces)):
        a, b, c = faces[f, 0], faces[f, 1], faces[f, 2]
        ux, uy, uz = vertices[b, 0] - vertices[a, 0], vertices[b, 1] - vertices[a, 1], vertices[b, 2] - vertices[a, 2]
        wx, wy, wz = vertices[c, 0] - vertices[a, 0], vertices[c, 1] - vertices[a, 1], vertices[c, 2] - vertices[a, 2]
        nx, ny, nz = uy * wz - uz * wy, uz * wx - ux * wz, ux * wy - uy * wx
        for k in (a, b, c):
            normals[k, 0] += nx
            normals[k, 1] += ny
            normals[k, 2] += nz
    for v in range(len(normals)):
        length = np.sqrt(normals[v, 0] ** 2 + normals[v, 1] ** 2 + normals[v, 2] ** 2)
        if length > 0:
            normals[v] /= length


@kernel(fastmath=FAST)
def curved_midpoints(vertices, normals, edges, roundness, midpoints):
    """Fill `midpoints` (e, 3) with points between the ends of edges, pulled towards the tangent planes of both ends."""
    for e in range(len(edges)):
        a, b = edges[e, 0], edges[e, 1]
        along_a = along_b = facing = np.float32(0)
        for k in range(3):
            half = (vertices[b, k] - vertices[a, k]) * np.float32(0.5)
            along_a += half * normals[a, k]
            along_b -= half * normals[b, k]
            facing += normals[a, k] * normals[b, k]
        pull = roundness * np.float32(0.5) if facing > 0 else np.float32(0)  # a sharp fold stays as it is
        for k in range(3):
            middle = (vertices[a, k] + vertices[b, k]) * np.float32(0.5)
            midpoints[e, k] = middle - pull * (along_a * normals[a, k] + along_b * normals[b, k])


@kernel
def project(points, rotation, translation, fx, fy, cx, cy, near, screen, inverse_depth):
    """Project points (n, 3) to `screen` (n, 2), in 1/256 pixel, and `inverse_depth` (n,), which is 0 where not to be drawn."""
    unit = 1 << SUBPIXEL_BITS
    for i in range(len(points)):
        x, y, z = points[i, 0], points[i, 1], points[i, 2]
        depth = rotation[2, 0] * x + rotation[2, 1] * y + rotation[2, 2] * z + translation[2]
        inverse_depth[i] = 0
        if depth < near:
            continue
        u = fx * (rotation[0, 0] * x + rotation[0, 1] * y + rotation[0, 2] * z + translation[0]) / depth + cx
        v = fy * (rotation[1, 0] * x + rotation[1, 1] * y + rotation[1, 2] * z + translation[1]) / depth + cy
        if abs(u) > FARTHEST_PIXEL or abs(v) > FARTHEST_PIXEL:
            continue
        screen[i, 0] = np.int32(np.floor(u * unit + 0.5))
        screen[i, 1] = np.int32(np.floor(v * unit + 0.5))
        inverse_depth[i] = 1 / depth


@kernel
def widen_strands(points, radii, n_points, rotation, translation, fx, fy, cx, cy, near, screen, inverse_depth):
    """Project strands as ribbons that face the camera: two vertices for each of their points.

    `points` (s * n_points, 3) and `radii` (s * n_points,) metres; fills `screen` (2 s n_points, 2) and `inverse_depth`.
    """
    unit = 1 << SUBPIXEL_BITS
    u = np.empty(n_points)
    v = np.empty(n_points)
    d = np.empty(n_points)
    for s in range(len(points) // n_points):
        first = s * n_points
        drawn = True
        for k in range(n_points):
            x, y, z = points[first + k, 0], points[first + k, 1], points[first + k, 2]
            d[k] = rotation[2, 0] * x + rotation[2, 1] * y + rotation[2, 2] * z + translation[2]
            if d[k] < near:
                drawn = False
                break
            u[k] = fx * (rotation[0, 0] * x + rotation[0, 1] * y + rotation[0, 2] * z + translation[0]) / d[k] + cx
            v[k] = fy * (rotation[1, 0] * x + rotation[1, 1] * y + rotation[1, 2] * z + translation[1]) / d[k] + cy
            if abs(u[k]) > FARTHEST_PIXEL or abs(v[k]) > FARTHEST_PIXEL:
                drawn = False
                break
        for k in range(n_points):
            i = 2 * (first + k)
            if not drawn:
                inverse_depth[i] = inverse_depth[i + 1] = 0
                continue
            before, after = max(k - 1, 0), min(k + 1, n_points - 1)
            du, dv = u[after] - u[before], v[after] - v[before]
            length = np.sqrt(du * du + dv * dv)
            half = radii[first + k] * fx / d[k] / length if length > 1e-9 else 0.0
            screen[i, 0] = np.int32(np.floor((u[k] - dv * half) * unit + 0.5))
            screen[i, 1] = np.int32(np.floor((v[k] + du * half) * unit + 0.5))
            screen[i + 1, 0] = np.int32(np.floor((u[k] + dv * half) * unit + 0.5))
            screen[i + 1, 1] = np.int32(np.floor((v[k] - du * half) * unit + 0.5))
            inverse_depth[i] = inverse_depth[i + 1] = 1 / d[k]
