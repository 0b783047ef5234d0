"""The way back from Gaussians in the world to their own parameters and their triangles' corners, one by one in plain Python.

The oracle of the kernels that do so sixteen at a time; itself held to finite differences in float64.
"""

from __future__ import annotations

SMALLEST_SQUARE = 1e-24  # of a quaternion, as `geometry.quaternion` has it


def carry_backward(
    start, stop, first_row, seen, quaternion, means, scales, turned, g_means, g_scales, g_turned,
    vertices, faces, f_rotation, f_scale, f_origin, with_mesh,
    g_position, g_log_scale, g_quaternion, g_corners,
):  # fmt: skip
    """Go back from the Gaussians of the triangles `start` to `stop` to their parameters, and to the triangles' corners.

    Args:
        start: first triangle.
        stop: end of the range.
        first_row: (f + 1,) first Gaussian of each triangle.
        seen: (n,) above 0 where there is a gradient. Where there is none, the gradient is 0 whatever the values are, which may be infinite.
        quaternion: (n, 4) own, of any length.
        means: (n, 3) in the world, like the next five.
        scales: (n, 3).
        turned: (n, 4) of unit length.
        g_means: (n, 3) gradient by `means`.
        g_scales: (n, 3) by `scales`.
        g_turned: (n, 4) by `turned`.
        vertices: (v, 3) posed.
        faces: (f, 3).
        f_rotation: (f, 3, 3) of the frames, like the next two.
        f_scale: (f,).
        f_origin: (f, 3).
        with_mesh: whether `g_corners` is wanted.
        g_position: (n, 3) out.
        g_log_scale: (n, 3) out.
        g_quaternion: (n, 4) out.
        g_corners: (f, 3, 3) out: by the place of each corner.
    """
    zero, half, one = means.dtype.type(0), means.dtype.type(0.5), means.dtype.type(1)
    third, smallest = means.dtype.type(1 / 3), means.dtype.type(SMALLEST_SQUARE)
    for f in range(start, stop):
        k = f_scale[f]
        ax, nx, bx = f_rotation[f, 0, 0], f_rotation[f, 0, 1], f_rotation[f, 0, 2]
        ay, ny, by = f_rotation[f, 1, 0], f_rotation[f, 1, 1], f_rotation[f, 1, 2]
        az, nz, bz = f_rotation[f, 2, 0], f_rotation[f, 2, 1], f_rotation[f, 2, 2]
        ox, oy, oz = f_origin[f, 0], f_origin[f, 1], f_origin[f, 2]
        force_x, force_y, force_z, tension = zero, zero, zero, zero
        torque_x, torque_y, torque_z = zero, zero, zero
        for i in range(first_row[f], first_row[f + 1]):
            if seen[i] == 0:
                for c in range(3):
                    g_position[i, c], g_log_scale[i, c], g_quaternion[i, c] = zero, zero, zero
                g_quaternion[i, 3] = zero
                continue
            gx, gy, gz = g_means[i, 0], g_means[i, 1], g_means[i, 2]
            g_position[i, 0] = k * (ax * gx + ay * gy + az * gz)
            g_position[i, 1] = k * (nx * gx + ny * gy + nz * gz)
            g_position[i, 2] = k * (bx * gx + by * gy + bz * gz)
            sx, sy, sz = g_scales[i, 0] * scales[i, 0], g_scales[i, 1] * scales[i, 1], g_scales[i, 2] * scales[i, 2]
            g_log_scale[i, 0], g_log_scale[i, 1], g_log_scale[i, 2] = sx, sy, sz

            # Of a unit quaternion t only its turn counts, to first order t (0, u): the gradient by u is the vector part of the conjugate
            # of t times the gradient by t. The Gaussian's own quaternion q turns by as much as t does: that by q is q (0, u) / |q|^2.
            tw, tx, ty, tz = turned[i, 0], turned[i, 1], turned[i, 2], turned[i, 3]
            hw, hx, hy, hz = g_turned[i, 0], g_turned[i, 1], g_turned[i, 2], g_turned[i, 3]
            lx, ly, lz = tw * hx - hw * tx, tw * hy - hw * ty, tw * hz - hw * tz
            cx, cy, cz = ty * hz - tz * hy, tz * hx - tx * hz, tx * hy - ty * hx
            ux, uy, uz = lx - cx, ly - cy, lz - cz
            w, x, y, z = quaternion[i, 0], quaternion[i, 1], quaternion[i, 2], quaternion[i, 3]
            inverse = one / max(w * w + x * x + y * y + z * z, smallest)
            ux, uy, uz = ux * inverse, uy * inverse, uz * inverse
            g_quaternion[i, 0] = -x * ux - y * uy - z * uz
            g_quaternion[i, 1] = w * ux + y * uz - z * uy
            g_quaternion[i, 2] = w * uy + z * ux - x * uz
            g_quaternion[i, 3] = w * uz + x * uy - y * ux

            if with_mesh:
                px, py, pz = means[i, 0] - ox, means[i, 1] - oy, means[i, 2] - oz
                force_x, force_y, force_z = force_x + gx, force_y + gy, force_z + gz
                tension += px * gx + py * gy + pz * gz + sx + sy + sz
                # of a turn of the frame the mean sees its own torque; t becomes (0, half the turn) t
                torque_x += py * gz - pz * gy + half * (lx + cx)
                torque_y += pz * gx - px * gz + half * (ly + cy)
                torque_z += px * gy - py * gx + half * (lz + cz)
        if not with_mesh:
            continue
        if first_row[f] == first_row[f + 1]:
            for corner in range(3):
                for c in range(3):
                    g_corners[f, corner, c] = zero
            continue
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
        edge = one / (ex * ax + ey * ay + ez * az)
        s = (hx * ax + hy * ay + hz * az) * edge
        about_a = (torque_x * ax + torque_y * ay + torque_z * az) / -(hx * bx + hy * by + hz * bz)
        about_n = (torque_x * nx + torque_y * ny + torque_z * nz) * edge
        about_b = (torque_x * bx + torque_y * by + torque_z * bz) * edge
        pull = half * tension / k
        by_b, by_n = pull * s - about_n, about_b - about_a * s
        gx, gy, gz = (
            pull * ax + by_b * bx + by_n * nx,
            pull * ay + by_b * by + by_n * ny,
            pull * az + by_b * bz + by_n * nz,
        )
        hx, hy, hz = about_a * nx - pull * bx, about_a * ny - pull * by, about_a * nz - pull * bz
        force_x, force_y, force_z = force_x * third, force_y * third, force_z * third
        g_corners[f, 0, 0], g_corners[f, 0, 1], g_corners[f, 0, 2] = (
            force_x - gx - hx,
            force_y - gy - hy,
            force_z - gz - hz,
        )
        g_corners[f, 1, 0], g_corners[f, 1, 1], g_corners[f, 1, 2] = force_x + gx, force_y + gy, force_z + gz
        g_corners[f, 2, 0], g_corners[f, 2, 1], g_corners[f, 2, 2] = force_x + hx, force_y + hy, force_z + hz
