"""Triangle frames, bound Gaussians, and the gradients of both. Serial, so every sum over a triangle has one order."""

from __future__ import annotations

import numpy as np
from numba import njit

FAST = {"contract", "nsz", "arcp", "reassoc"}


@njit(cache=True, nogil=True, inline="always")
def cross(ax, ay, az, bx, by, bz):
    """Cross product."""
    return ay * bz - az * by, az * bx - ax * bz, ax * by - ay * bx


@njit(cache=True, nogil=True, fastmath=FAST)
def quaternions(rotation, out):
    """Write the unit quaternion of each rotation matrix (f, 3, 3) to `out` (f, 4), its largest component positive (Shepperd)."""
    for f in range(rotation.shape[0]):
        r = rotation[f]
        d0 = 1 + r[0, 0] + r[1, 1] + r[2, 2]
        d1 = 1 + r[0, 0] - r[1, 1] - r[2, 2]
        d2 = 1 - r[0, 0] + r[1, 1] - r[2, 2]
        d3 = 1 - r[0, 0] - r[1, 1] + r[2, 2]
        wx, wy, wz = r[2, 1] - r[1, 2], r[0, 2] - r[2, 0], r[1, 0] - r[0, 1]
        xy, xz, yz = r[0, 1] + r[1, 0], r[0, 2] + r[2, 0], r[1, 2] + r[2, 1]
        if d0 >= d1 and d0 >= d2 and d0 >= d3:
            w, x, y, z = d0, wx, wy, wz
        elif d1 >= d2 and d1 >= d3:
            w, x, y, z = wx, d1, xy, xz
        elif d2 >= d3:
            w, x, y, z = wy, xy, d2, yz
        else:
            w, x, y, z = wz, xz, yz, d3
        norm = np.sqrt(w * w + x * x + y * y + z * z)
        out[f, 0], out[f, 1], out[f, 2], out[f, 3] = w / norm, x / norm, y / norm, z / norm


@njit(cache=True, nogil=True, fastmath=FAST)
def frames_backward(vertices, faces, rotation, quaternion, g_rotation, g_scale, g_origin, g_quaternion, out):
    """Add to `out` (v, 3) the gradient of the frames of all triangles.

    A turn w of a frame changes its quaternion by (0, w) q / 2 and each column of its matrix by w x column; so the quaternion's gradient
    joins the matrix's as half the turn's gradient crossed with each column.
    """
    for f in range(faces.shape[0]):
        i0, i1, i2 = faces[f, 0], faces[f, 1], faces[f, 2]
        ex, ey, ez = (
            vertices[i1, 0] - vertices[i0, 0],
            vertices[i1, 1] - vertices[i0, 1],
            vertices[i1, 2] - vertices[i0, 2],
        )
        hx, hy, hz = (
            vertices[i2, 0] - vertices[i0, 0],
            vertices[i2, 1] - vertices[i0, 1],
            vertices[i2, 2] - vertices[i0, 2],
        )
        r = rotation[f]
        ax, ay, az = r[0, 0], r[1, 0], r[2, 0]
        nx, ny, nz = r[0, 1], r[1, 1], r[2, 1]
        edge = np.sqrt(ex * ex + ey * ey + ez * ez)
        cx, cy, cz = cross(ex, ey, ez, hx, hy, hz)
        area = np.sqrt(cx * cx + cy * cy + cz * cz)

        qw, qx, qy, qz = quaternion[f, 0], quaternion[f, 1], quaternion[f, 2], quaternion[f, 3]
        gw, gx, gy, gz = g_quaternion[f, 0], g_quaternion[f, 1], g_quaternion[f, 2], g_quaternion[f, 3]
        tx = (-gw * qx + gx * qw - gy * qz + gz * qy) / 4
        ty = (-gw * qy + gx * qz + gy * qw - gz * qx) / 4
        tz = (-gw * qz - gx * qy + gy * qx + gz * qw) / 4
        g = g_rotation[f]
        bx, by, bz = r[0, 2], r[1, 2], r[2, 2]
        ux, uy, uz = cross(tx, ty, tz, bx, by, bz)
        ux, uy, uz = ux + g[0, 2], uy + g[1, 2], uz + g[2, 2]

        gax, gay, gaz = cross(tx, ty, tz, ax, ay, az)
        px, py, pz = cross(nx, ny, nz, ux, uy, uz)
        gax, gay, gaz = gax + g[0, 0] + px, gay + g[1, 0] + py, gaz + g[2, 0] + pz
        gnx, gny, gnz = cross(tx, ty, tz, nx, ny, nz)
        px, py, pz = cross(ux, uy, uz, ax, ay, az)
        gnx, gny, gnz = gnx + g[0, 1] + px, gny + g[1, 1] + py, gnz + g[2, 1] + pz

        along = gnx * nx + gny * ny + gnz * nz
        by_area = g_scale[f] / (2 * edge)
        gcx = (gnx - along * nx) / area + by_area * nx
        gcy = (gny - along * ny) / area + by_area * ny
        gcz = (gnz - along * nz) / area + by_area * nz
        along = gax * ax + gay * ay + gaz * az
        by_edge = g_scale[f] * (1 - area / (edge * edge)) / 2
        gex, gey, gez = cross(hx, hy, hz, gcx, gcy, gcz)
        gex += (gax - along * ax) / edge + by_edge * ax
        gey += (gay - along * ay) / edge + by_edge * ay
        gez += (gaz - along * az) / edge + by_edge * az
        ghx, ghy, ghz = cross(gcx, gcy, gcz, ex, ey, ez)

        ox, oy, oz = g_origin[f, 0] / 3, g_origin[f, 1] / 3, g_origin[f, 2] / 3
        out[i0, 0] += ox - gex - ghx
        out[i0, 1] += oy - gey - ghy
        out[i0, 2] += oz - gez - ghz
        out[i1, 0] += ox + gex
        out[i1, 1] += oy + gey
        out[i1, 2] += oz + gez
        out[i2, 0] += ox + ghx
        out[i2, 1] += oy + ghy
        out[i2, 2] += oz + ghz


@njit(cache=True, nogil=True, fastmath=FAST)
def to_world(position, scale, quaternion, binding, f_rotation, f_scale, f_origin, f_quaternion, means, scales, turned):
    """Write the world means (n, 3), standard deviations (n, 3) and unit quaternions (n, 4) of bound Gaussians; `scale` is local."""
    for i in range(binding.shape[0]):
        f = binding[i]
        k = f_scale[f]
        px, py, pz = position[i, 0], position[i, 1], position[i, 2]
        for c in range(3):
            r = f_rotation[f, c]
            means[i, c] = k * (r[0] * px + r[1] * py + r[2] * pz) + f_origin[f, c]
            scales[i, c] = k * scale[i, c]
        w, x, y, z = quaternion[i, 0], quaternion[i, 1], quaternion[i, 2], quaternion[i, 3]
        norm = max(np.sqrt(w * w + x * x + y * y + z * z), 1e-12)
        w, x, y, z = w / norm, x / norm, y / norm, z / norm
        aw, ax, ay, az = f_quaternion[f, 0], f_quaternion[f, 1], f_quaternion[f, 2], f_quaternion[f, 3]
        turned[i, 0] = aw * w - ax * x - ay * y - az * z
        turned[i, 1] = aw * x + ax * w + ay * z - az * y
        turned[i, 2] = aw * y - ax * z + ay * w + az * x
        turned[i, 3] = aw * z + ax * y - ay * x + az * w


@njit(cache=True, nogil=True, fastmath=FAST)
def to_world_backward(
    position, scale, quaternion, binding, f_rotation, f_scale, f_quaternion,
    g_means, g_scales, g_turned, with_frames,
    g_position, g_log_scale, g_quaternion, g_f_rotation, g_f_scale, g_f_origin, g_f_quaternion,
):  # fmt: skip
    """Write the gradients of the Gaussians' own parameters, and, if wanted, add those of the frames."""
    for i in range(binding.shape[0]):
        f = binding[i]
        k = f_scale[f]
        r = f_rotation[f]
        gx, gy, gz = g_means[i, 0], g_means[i, 1], g_means[i, 2]
        lx = r[0, 0] * gx + r[1, 0] * gy + r[2, 0] * gz
        ly = r[0, 1] * gx + r[1, 1] * gy + r[2, 1] * gz
        lz = r[0, 2] * gx + r[1, 2] * gy + r[2, 2] * gz
        g_position[i, 0], g_position[i, 1], g_position[i, 2] = k * lx, k * ly, k * lz
        by_scale = lx * position[i, 0] + ly * position[i, 1] + lz * position[i, 2]
        for c in range(3):
            local = g_scales[i, c] * scale[i, c]
            g_log_scale[i, c] = k * local
            by_scale += local

        w, x, y, z = quaternion[i, 0], quaternion[i, 1], quaternion[i, 2], quaternion[i, 3]
        norm = max(np.sqrt(w * w + x * x + y * y + z * z), 1e-12)
        w, x, y, z = w / norm, x / norm, y / norm, z / norm
        aw, ax, ay, az = f_quaternion[f, 0], f_quaternion[f, 1], f_quaternion[f, 2], f_quaternion[f, 3]
        hw, hx, hy, hz = g_turned[i, 0], g_turned[i, 1], g_turned[i, 2], g_turned[i, 3]
        ow = aw * hw + ax * hx + ay * hy + az * hz  # conjugate of the triangle's quaternion times the gradient
        ox = aw * hx - ax * hw - ay * hz + az * hy
        oy = aw * hy + ax * hz - ay * hw - az * hx
        oz = aw * hz - ax * hy + ay * hx - az * hw
        along = ow * w + ox * x + oy * y + oz * z
        g_quaternion[i, 0] = (ow - along * w) / norm
        g_quaternion[i, 1] = (ox - along * x) / norm
        g_quaternion[i, 2] = (oy - along * y) / norm
        g_quaternion[i, 3] = (oz - along * z) / norm
        if with_frames:
            g_f_scale[f] += by_scale
            for c in range(3):
                g = g_means[i, c]
                g_f_origin[f, c] += g
                for m in range(3):
                    g_f_rotation[f, c, m] += k * g * position[i, m]
            # The gradient times the conjugate of the Gaussian's own
            g_f_quaternion[f, 0] += hw * w + hx * x + hy * y + hz * z
            g_f_quaternion[f, 1] += -hw * x + hx * w - hy * z + hz * y
            g_f_quaternion[f, 2] += -hw * y + hx * z + hy * w - hz * x
            g_f_quaternion[f, 3] += -hw * z - hx * y + hy * x + hz * w
