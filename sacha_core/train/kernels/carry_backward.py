"""The way back from Gaussians in the world to their own parameters, and to the corners of the triangles that carry them.

What a triangle's frame does to its Gaussians is a rigid motion and a scaling. So all that the frame's gradient can be is a force (by the
origin), a torque about the origin (by a turn of the frame) and a tension (by the scale), and each is a plain sum over the Gaussians.
All three are taken along the axes of the frame, where a Gaussian's own parameters and their gradients already are. Gaussians are sorted by
triangle, and a triangle belongs to one thread: every sum has one order.

From there to the corners: let a, n, b be the columns of the frame's rotation, e = |e| a the first edge and h = s e - t b the second. A turn
shows as n.de / |e| about b, as -b.de / |e| about n, and as (n.dh - s n.de) / t about a. Twice the scale is |e| + t, with d|e| = a.de and
dt = s b.de - b.dh.
"""

from __future__ import annotations

import numpy as np

from sacha_core.parallel.kernels.lanes import (
    LANES,
    absolute,
    every,
    fma,
    inlined,
    load,
    load_first,
    maximum,
    select,
    splat,
    store,
    store_first,
    store_transposed,
    zeros,
)
from sacha_core.parallel.kernels.rows import first_lanes, load_rows, load_wide, store_wide

F = np.float32
SMALLEST_SQUARE = F(1e-24)  # of a quaternion, as `geometry.quaternion` has it
PULLS = 16  # numbers a row of sums: force, torque, tension, and nothing


@inlined
def dot(ax, ay, az, bx, by, bz):
    """Give the dot products of sixteen pairs of vectors."""
    return fma(ax, bx, fma(ay, by, az * bz))


@inlined
def cross(ax, ay, az, bx, by, bz):
    """Give their cross products."""
    return ay * bz - az * by, az * bx - ax * bz, ax * by - ay * bx


@inlined
def position_slopes(keep, unit, rotation, slopes):
    """Give the gradient by the own positions from that by the means, with the frames' scales `unit` and rotations, row by row."""
    x, y, z = slopes
    r, nothing = rotation, zeros()
    return (
        select(keep, unit * dot(r[0], r[3], r[6], x, y, z), nothing),
        select(keep, unit * dot(r[1], r[4], r[7], x, y, z), nothing),
        select(keep, unit * dot(r[2], r[5], r[8], x, y, z), nothing),
    )


@inlined
def quaternion_slopes(keep, own, turned, slopes):
    """Give the gradient by the Gaussians' own quaternions, of any length, from that by their unit quaternions in the world.

    Of a unit quaternion t only its turn counts, to first order t (0, u): the gradient by u is the vector part of the conjugate of t times
    the gradient by t. The Gaussian's own quaternion q turns by as much as t does: that by q is q (0, u) / |q|^2.
    """
    tw, tx, ty, tz = turned
    hw, hx, hy, hz = slopes
    cx, cy, cz = cross(tx, ty, tz, hx, hy, hz)
    ux, uy, uz = tw * hx - hw * tx - cx, tw * hy - hw * ty - cy, tw * hz - hw * tz - cz
    w, x, y, z = own
    inverse = F(1) / maximum(splat(SMALLEST_SQUARE), fma(w, w, dot(x, y, z, x, y, z)))
    ux, uy, uz = ux * inverse, uy * inverse, uz * inverse
    ax, ay, az = cross(x, y, z, ux, uy, uz)
    nothing = zeros()
    return (
        select(keep, -dot(x, y, z, ux, uy, uz), nothing),
        select(keep, fma(w, ux, ax), nothing),
        select(keep, fma(w, uy, ay), nothing),
        select(keep, fma(w, uz, az), nothing),
    )


@inlined
def add_pulls(keep, row, count, own, quaternion, g_position, g_log_scale, g_quaternion, binding, first, sums, scratch):
    """Add what up to sixteen Gaussians from `row` on do to their triangles to the sums, of which row 0 is that of triangle `first`.

    Of a turn of the frame a mean sees its own torque; q becomes (0, half the turn) q.
    """
    x, y, z = own
    gx, gy, gz = g_position
    tx, ty, tz = cross(x, y, z, gx, gy, gz)
    qw, qx, qy, qz = quaternion
    gw, vx, vy, vz = g_quaternion
    cx, cy, cz = cross(qx, qy, qz, vx, vy, vz)
    half, nothing = F(0.5), zeros()
    tension = dot(x, y, z, gx, gy, gz) + (g_log_scale[0] + g_log_scale[1] + g_log_scale[2])
    store_transposed(scratch, 0, (
        gx, gy, gz,
        select(keep, tx + half * (qw * vx - gw * qx + cx), nothing),
        select(keep, ty + half * (qw * vy - gw * qy + cy), nothing),
        select(keep, tz + half * (qw * vz - gw * qz + cz), nothing),
        select(keep, tension, nothing),
        nothing, nothing, nothing, nothing, nothing, nothing, nothing, nothing, nothing,
    ))  # fmt: skip
    for lane in range(min(count, LANES)):
        at = PULLS * (binding[row + lane] - first)
        store(sums, at, load(sums, at) + load(scratch, PULLS * lane))


@inlined
def corner_slopes(face, count, first, sums, vertices, faces, f_rotation, f_scale, g_corners):
    """Write the gradients by the corners of up to sixteen triangles from `face` on; arguments flat, sums as of `add_pulls`."""
    wanted = first_lanes(count)
    fx, fy, fz, about_a, about_n, about_b, tension = load_wide(sums, PULLS * (face - first), PULLS, 7, wanted)
    pulled = absolute(fx) + absolute(fy) + absolute(fz) + absolute(about_a) + absolute(about_n) + absolute(about_b)
    if every(pulled + absolute(tension) <= F(0)):
        for at in range(9 * face, 9 * (face + min(count, LANES)), LANES):
            store_first(g_corners, at, 9 * (face + min(count, LANES)) - at, zeros())
        return
    r = load_wide(f_rotation, 9 * face, 9, 9, wanted)
    unit = F(1) / load_first(f_scale, face, count)
    x, y, z = load_rows(vertices, faces, 3 * face, count, 3, 3)
    ex, ey, ez = load_rows(vertices, faces, 3 * face + 1, count, 3, 3)
    hx, hy, hz = load_rows(vertices, faces, 3 * face + 2, count, 3, 3)
    ex, ey, ez, hx, hy, hz = ex - x, ey - y, ez - z, hx - x, hy - y, hz - z
    edge = F(1) / dot(ex, ey, ez, r[0], r[3], r[6])
    s = dot(hx, hy, hz, r[0], r[3], r[6]) * edge
    about_a = -(about_a / dot(hx, hy, hz, r[2], r[5], r[8]))
    about_n, about_b = about_n * edge, about_b * edge
    pull = F(0.5) * tension * unit
    third = unit * F(1 / 3)
    fx, fy, fz = fx * third, fy * third, fz * third
    # by e along a, n and b, and by h likewise, where the first is 0
    ea, en, eb = pull, about_b - about_a * s, pull * s - about_n
    hn, hb = about_a, -pull
    one, two, none = (fx + ea, fy + en, fz + eb), (fx, fy + hn, fz + hb), (fx - ea, fy - en - hn, fz - eb - hb)
    store_wide(g_corners, 9 * face, count, (
        dot(r[0], r[1], r[2], none[0], none[1], none[2]), dot(r[3], r[4], r[5], none[0], none[1], none[2]),
        dot(r[6], r[7], r[8], none[0], none[1], none[2]),
        dot(r[0], r[1], r[2], one[0], one[1], one[2]), dot(r[3], r[4], r[5], one[0], one[1], one[2]),
        dot(r[6], r[7], r[8], one[0], one[1], one[2]),
        dot(r[0], r[1], r[2], two[0], two[1], two[2]), dot(r[3], r[4], r[5], two[0], two[1], two[2]),
        dot(r[6], r[7], r[8], two[0], two[1], two[2]),
    ))  # fmt: skip
