"""Fifth stage: sum the gradients of each Gaussian's entries and carry them back through the projection."""

from __future__ import annotations

import numpy as np

from sacha_core.parallel.kernels.kernel import kernel
from sacha_core.parallel.kernels.lanes import (
    LANES,
    fma,
    inlined,
    load,
    load_spread,
    load_strided,
    select,
    splat,
    store,
    store_interleaved,
    within,
    zeros,
)
from sacha_core.raster.kernels.geometry import (
    camera_rows,
    covariance,
    dot3,
    jacobian,
    load_quaternions,
    rotation_matrix,
    to_camera,
)
from sacha_core.raster.kernels.layout import (
    E_COLOUR,
    E_S,
    E_X,
    E_XX,
    E_XY,
    E_Y,
    E_YY,
    RECORD,
    V_ROTATION,
)

F = np.float32
KEEP = LANES * RECORD  # plane of the scratch that says which lanes have entries
GATHER_SCRATCH = LANES * RECORD + LANES


@inlined
def gather(block, rows, span, entry_gradients, scratch):
    """Sum the entries of up to sixteen Gaussians into the rows of the scratch; are there any?"""
    found = False
    for lane in range(LANES):
        total = zeros()
        entries = span[2 * (block + lane) + 1] if lane < rows else 0
        if entries > 0:
            at = span[2 * (block + lane)]
            for e in range(at, at + entries):
                total = total + load(entry_gradients, e * RECORD)
            found = True
        store(scratch, lane * RECORD, total)
        scratch[KEEP + lane] = F(1) if entries > 0 else F(0)
    return found


@within
def conic_to_covariance(xx, yy, xy, determinant, scratch):
    """Give the gradient by the projected mean (x, y) and by the covariance's entries (00, 01, 11), from the gathered sums."""
    inverse = splat(F(1)) / determinant
    a, b, c = yy * inverse, -(xy * inverse), xx * inverse
    s_x, s_y = load_strided(scratch, 0, 16, E_X), load_strided(scratch, 0, 16, E_Y)
    s_xx, s_xy, s_yy = (
        load_strided(scratch, 0, 16, E_XX),
        load_strided(scratch, 0, 16, E_XY),
        load_strided(scratch, 0, 16, E_YY),
    )
    # dL/dconic is -1/2 [s_xx s_xy; s_xy s_yy]; dL/dcovariance = -conic dL/dconic conic
    p00, p01 = fma(a, s_xx, b * s_xy), fma(a, s_xy, b * s_yy)
    p10, p11 = fma(b, s_xx, c * s_xy), fma(b, s_xy, c * s_yy)
    half = F(0.5)
    return (
        fma(a, s_x, b * s_y), fma(b, s_x, c * s_y),
        fma(p00, a, p01 * b) * half, fma(p00, b, p01 * c) * half, fma(p10, b, p11 * c) * half,
    )  # fmt: skip


@within
def quaternion_gradient(w, x, y, z, unit, d00, d01, d02, d10, d11, d12, d20, d21, d22):
    """Give the gradient by a quaternion, not necessarily of unit length, from the gradient by its rotation matrix."""
    two = F(2)
    gw = (z * (d10 - d01) + y * (d02 - d20) + x * (d21 - d12)) * two
    gx = (y * (d01 + d10) + z * (d02 + d20) + w * (d21 - d12) - x * (d11 + d22) * two) * two
    gy = (x * (d01 + d10) + z * (d12 + d21) + w * (d02 - d20) - y * (d00 + d22) * two) * two
    gz = (x * (d02 + d20) + y * (d12 + d21) + w * (d10 - d01) - z * (d00 + d11) * two) * two
    radial = fma(w, gw, dot3(x, y, z, gx, gy, gz))
    return (gw - w * radial) * unit, (gx - x * radial) * unit, (gy - y * radial) * unit, (gz - z * radial) * unit


@inlined
def project_block_backward(
    means, scales, quaternions, opacities, row, view, scratch, at, g_means, g_scales, g_quaternions, g_opacities, g_means_2d
):  # fmt: skip
    """Carry the sums of sixteen Gaussians from `row` on back to their parameters; the results begin at row `at`."""
    x, y, z = to_camera(means, row, view)
    inverse, slope_x, slope_y, j00, j02, j11, j12 = jacobian(x, y, z, view)
    m00, m01, m02 = camera_rows(j00, j02, view, 0)
    m10, m11, m12 = camera_rows(j11, j12, view, 1)
    qw, qx, qy, qz, _, unit = load_quaternions(quaternions, row)
    r00, r01, r02, r10, r11, r12, r20, r21, r22 = rotation_matrix(qw, qx, qy, qz)
    s0, s1 = load_strided(scales, 3 * row, 3, 0), load_strided(scales, 3 * row, 3, 1)
    s2 = load_strided(scales, 3 * row, 3, 2)
    t00, t01, t02 = (
        dot3(m00, m01, m02, r00, r10, r20),
        dot3(m00, m01, m02, r01, r11, r21),
        dot3(m00, m01, m02, r02, r12, r22),
    )
    t10, t11, t12 = (
        dot3(m10, m11, m12, r00, r10, r20),
        dot3(m10, m11, m12, r01, r11, r21),
        dot3(m10, m11, m12, r02, r12, r22),
    )
    u0, u1, u2, v0, v1, v2 = t00 * s0, t01 * s1, t02 * s2, t10 * s0, t11 * s1, t12 * s2
    xx, yy, xy, determinant = covariance(u0, u1, u2, v0, v1, v2)
    g_x, g_y, c00, c01, c11 = conic_to_covariance(xx, yy, xy, determinant, scratch)

    two = F(2)
    du0, du1, du2 = fma(c00, u0, c01 * v0) * two, fma(c00, u1, c01 * v1) * two, fma(c00, u2, c01 * v2) * two
    dv0, dv1, dv2 = fma(c01, u0, c11 * v0) * two, fma(c01, u1, c11 * v1) * two, fma(c01, u2, c11 * v2) * two

    keep = load(scratch, KEEP) > zeros()
    nothing = zeros()
    store_interleaved(
        g_scales,
        3 * at,
        (
            select(keep, fma(du0, t00, dv0 * t10), nothing),
            select(keep, fma(du1, t01, dv1 * t11), nothing),
            select(keep, fma(du2, t02, dv2 * t12), nothing),
        ),
    )
    du0, du1, du2, dv0, dv1, dv2 = du0 * s0, du1 * s1, du2 * s2, dv0 * s0, dv1 * s1, dv2 * s2
    gw, gx, gy, gz = quaternion_gradient(
        qw, qx, qy, qz, unit,
        fma(m00, du0, m10 * dv0), fma(m00, du1, m10 * dv1), fma(m00, du2, m10 * dv2),
        fma(m01, du0, m11 * dv0), fma(m01, du1, m11 * dv1), fma(m01, du2, m11 * dv2),
        fma(m02, du0, m12 * dv0), fma(m02, du1, m12 * dv1), fma(m02, du2, m12 * dv2),
    )  # fmt: skip
    store_interleaved(
        g_quaternions,
        4 * at,
        (select(keep, gw, nothing), select(keep, gx, nothing), select(keep, gy, nothing), select(keep, gz, nothing)),
    )

    # gradients by the rows of Jacobian times view rotation, then by the Jacobian's entries
    a0, a1, a2 = (
        dot3(du0, du1, du2, r00, r01, r02),
        dot3(du0, du1, du2, r10, r11, r12),
        dot3(du0, du1, du2, r20, r21, r22),
    )
    b0, b1, b2 = (
        dot3(dv0, dv1, dv2, r00, r01, r02),
        dot3(dv0, dv1, dv2, r10, r11, r12),
        dot3(dv0, dv1, dv2, r20, r21, r22),
    )
    d00, d02 = along(view, 0, a0, a1, a2), along(view, 2, a0, a1, a2)
    d11, d12 = along(view, 1, b0, b1, b2), along(view, 2, b0, b1, b2)
    # 1 where the slope is not clamped, so that it moves with the mean
    free_x = select((slope_x - x * inverse) * (slope_x - x * inverse) > nothing, nothing, splat(F(1)))
    free_y = select((slope_y - y * inverse) * (slope_y - y * inverse) > nothing, nothing, splat(F(1)))
    through_x, through_y = d02 * free_x * inverse, d12 * free_y * inverse
    cam_x, cam_y = j00 * (g_x - through_x), j11 * (g_y - through_y)
    along_z = fma(g_x, j00 * x, g_y * (j11 * y)) + fma(d00, j00, d11 * j11) + fma(d02, j02, d12 * j12)
    along_z = along_z - fma(through_x, j00 * x, through_y * (j11 * y))
    cam_z = -(along_z * inverse)
    store_interleaved(
        g_means,
        3 * at,
        (
            select(keep, across(view, 0, cam_x, cam_y, cam_z), nothing),
            select(keep, across(view, 1, cam_x, cam_y, cam_z), nothing),
            select(keep, across(view, 2, cam_x, cam_y, cam_z), nothing),
        ),
    )
    store_interleaved(g_means_2d, 2 * at, (select(keep, g_x, nothing), select(keep, g_y, nothing)))
    store(g_opacities, at, select(keep, load_strided(scratch, 0, 16, E_S) / load(opacities, row), nothing))


@within
def along(view, row, x, y, z):
    """Give the dot product of a row of the view rotation with (x, y, z)."""
    at = V_ROTATION + 3 * row
    return dot3(load_spread(view, at), load_spread(view, at + 1), load_spread(view, at + 2), x, y, z)


@within
def across(view, column, x, y, z):
    """Give the dot product of a column of the view rotation with (x, y, z)."""
    at = V_ROTATION + column
    return dot3(load_spread(view, at), load_spread(view, at + 3), load_spread(view, at + 6), x, y, z)


@inlined
def clear_block(at, g_means, g_scales, g_quaternions, g_opacities, g_means_2d):
    """Set the gradients of sixteen Gaussians from `at` on to zero."""
    for part in range(3):
        store(g_means, 3 * at + part * LANES, zeros())
        store(g_scales, 3 * at + part * LANES, zeros())
    for part in range(4):
        store(g_quaternions, 4 * at + part * LANES, zeros())
    for part in range(2):
        store(g_means_2d, 2 * at + part * LANES, zeros())
    store(g_opacities, at, zeros())


@kernel
def project_backward(
    start, stop, scratch, means, scales, quaternions, opacities, tail_means, tail_scales, tail_quaternions, tail_opacities,
    n, channels, view, span, entry_gradients, g_means, g_scales, g_quaternions, g_opacities, g_means_2d, g_colours,
):  # fmt: skip
    """Give the gradients of the Gaussians `start` to `stop` (`start` a multiple of 16).

    Arguments as of `project`; the results `g_...` are flat, with room for a whole number of blocks of sixteen.
    """
    row = start
    for block in range(start, stop, LANES):
        rows = min(LANES, n - block)
        if rows < LANES:
            means, scales, quaternions, opacities = tail_means, tail_scales, tail_quaternions, tail_opacities
            row = np.int64(0)
        if gather(block, rows, span, entry_gradients, scratch):
            project_block_backward(
                means, scales, quaternions, opacities, row, view, scratch, block,
                g_means, g_scales, g_quaternions, g_opacities, g_means_2d,
            )  # fmt: skip
        else:
            clear_block(block, g_means, g_scales, g_quaternions, g_opacities, g_means_2d)
        for lane in range(rows):
            for k in range(channels):
                g_colours[(block + lane) * channels + k] = scratch[lane * RECORD + E_COLOUR + k]
        row += LANES


@kernel
def gather_weights(start, stop, span, entry_sums, weights):
    """Sum the entries of the Gaussians `start` to `stop` into `weights` (n, k), their first k numbers, float64."""
    for g in range(start, stop):
        for k in range(weights.shape[1]):
            total = 0.0
            for e in range(span[2 * g], span[2 * g] + span[2 * g + 1]):
                total += entry_sums[e * RECORD + k]
            weights[g, k] = total
