"""The way back from Gaussians in the world to their own parameters, and to the corners of the triangles that carry them.

What a triangle's frame does to its Gaussians is a rigid motion and a scaling. So all that the frame's gradient can be is a force (by the
origin), a torque about the origin (by a turn of the frame) and a tension (by the scale), and each is a plain sum over the Gaussians.
Gaussians are sorted by triangle, and a triangle belongs to one thread: every sum has one order.
"""

from __future__ import annotations

from numba import njit

FAST = {"contract", "nsz", "arcp", "reassoc"}
SMALLEST_SQUARE = 1e-24  # of a quaternion, as `geometry.quaternion` has it


@njit(cache=True, nogil=True, inline="always")
def cross(ax, ay, az, bx, by, bz):
    """Cross product."""
    return ay * bz - az * by, az * bx - ax * bz, ax * by - ay * bx


@njit(cache=True, nogil=True, error_model="numpy", fastmath=FAST)
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
        r, o, k = f_rotation[f], f_origin[f], f_scale[f]
        force_x, force_y, force_z, tension = zero, zero, zero, zero
        torque_x, torque_y, torque_z = zero, zero, zero
        for i in range(first_row[f], first_row[f + 1]):
            if seen[i] == 0:
                for c in range(3):
                    g_position[i, c], g_log_scale[i, c], g_quaternion[i, c] = zero, zero, zero
                g_quaternion[i, 3] = zero
                continue
            gx, gy, gz = g_means[i, 0], g_means[i, 1], g_means[i, 2]
            g_position[i, 0] = k * (r[0, 0] * gx + r[1, 0] * gy + r[2, 0] * gz)
            g_position[i, 1] = k * (r[0, 1] * gx + r[1, 1] * gy + r[2, 1] * gz)
            g_position[i, 2] = k * (r[0, 2] * gx + r[1, 2] * gy + r[2, 2] * gz)
            sx, sy, sz = g_scales[i, 0] * scales[i, 0], g_scales[i, 1] * scales[i, 1], g_scales[i, 2] * scales[i, 2]
            g_log_scale[i, 0], g_log_scale[i, 1], g_log_scale[i, 2] = sx, sy, sz

            # Of a unit quaternion t only its turn counts, to first order t (0, u): the gradient by u is the vector part of the conjugate
            # of t times the gradient by t. The Gaussian's own quaternion q turns by as much as t does: that by q is q (0, u) / |q|^2.
            tw, tx, ty, tz = turned[i, 0], turned[i, 1], turned[i, 2], turned[i, 3]
            hw, hx, hy, hz = g_turned[i, 0], g_turned[i, 1], g_turned[i, 2], g_turned[i, 3]
            ax, ay, az = tw * hx - hw * tx, tw * hy - hw * ty, tw * hz - hw * tz
            bx, by, bz = cross(tx, ty, tz, hx, hy, hz)
            ux, uy, uz = ax - bx, ay - by, az - bz
            w, x, y, z = quaternion[i, 0], quaternion[i, 1], quaternion[i, 2], quaternion[i, 3]
            inverse = one / max(w * w + x * x + y * y + z * z, smallest)
            ux, uy, uz = ux * inverse, uy * inverse, uz * inverse
            g_quaternion[i, 0] = -x * ux - y * uy - z * uz
            g_quaternion[i, 1] = w * ux + y * uz - z * uy
            g_quaternion[i, 2] = w * uy + z * ux - x * uz
            g_quaternion[i, 3] = w * uz + x * uy - y * ux

            if with_mesh:
                px, py, pz = means[i, 0] - o[0], means[i, 1] - o[1], means[i, 2] - o[2]
                force_x, force_y, force_z = force_x + gx, force_y + gy, force_z + gz
                tension += px * gx + py * gy + pz * gz + sx + sy + sz
                # of a turn of the frame the mean sees its own torque; t becomes (0, half the turn) t
                torque_x += py * gz - pz * gy + half * (ax + bx)
                torque_y += pz * gx - px * gz + half * (ay + by)
                torque_z += px * gy - py * gx + half * (az + bz)
        if not with_mesh:
            continue
        pull = g_corners[f]
        if first_row[f] == first_row[f + 1]:
            for corner in range(3):
                pull[corner, 0], pull[corner, 1], pull[corner, 2] = zero, zero, zero
            continue
        along_edge = torque_x * r[0, 0] + torque_y * r[1, 0] + torque_z * r[2, 0]
        along_normal = torque_x * r[0, 1] + torque_y * r[1, 1] + torque_z * r[2, 1]
        along_height = torque_x * r[0, 2] + torque_y * r[1, 2] + torque_z * r[2, 2]
        pull_apart(f, vertices, faces, r, along_edge, along_normal, along_height, half * tension / k, pull)
        for corner in range(3):
            pull[corner, 0] += force_x * third
            pull[corner, 1] += force_y * third
            pull[corner, 2] += force_z * third


@njit(cache=True, nogil=True, error_model="numpy", fastmath=FAST)
def pull_apart(f, vertices, faces, r, along_edge, along_normal, along_height, half_tension, pull):
    """Write what a torque on a frame, in its own axes, and half a tension do to the corners (3, 3) of its triangle.

    Let a, n, b be the frame's columns, e = |e| a the first edge and h = s e - t b the second. A turn about b is n.da = n.de / |e|, one
    about n is -b.da = -b.de / |e|, one about a is b.dn = (n.dh - s n.de) / t. Twice the scale is |e| + t, with d|e| = a.de and
    dt = s b.de - b.dh.
    """
    i0, i1, i2 = faces[f, 0], faces[f, 1], faces[f, 2]
    ax, ay, az = r[0, 0], r[1, 0], r[2, 0]
    nx, ny, nz = r[0, 1], r[1, 1], r[2, 1]
    bx, by, bz = r[0, 2], r[1, 2], r[2, 2]
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
    edge = ex * ax + ey * ay + ez * az
    s = (hx * ax + hy * ay + hz * az) / edge
    t = -(hx * bx + hy * by + hz * bz)
    by_b = half_tension * s - along_normal / edge
    by_n = along_height / edge - along_edge * s / t
    gex, gey, gez = (
        half_tension * ax + by_b * bx + by_n * nx,
        half_tension * ay + by_b * by + by_n * ny,
        half_tension * az + by_b * bz + by_n * nz,
    )
    by_n = along_edge / t
    ghx, ghy, ghz = by_n * nx - half_tension * bx, by_n * ny - half_tension * by, by_n * nz - half_tension * bz
    pull[0, 0], pull[0, 1], pull[0, 2] = -gex - ghx, -gey - ghy, -gez - ghz
    pull[1, 0], pull[1, 1], pull[1, 2] = gex, gey, gez
    pull[2, 0], pull[2, 1], pull[2, 2] = ghx, ghy, ghz
