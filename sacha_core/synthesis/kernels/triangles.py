"""Drawing triangles into a depth buffer."""

from __future__ import annotations

from sacha_core.parallel.kernels.kernel import kernel
from sacha_core.synthesis.kernels.surface import SUBPIXEL_BITS

UNIT = 1 << SUBPIXEL_BITS
HALF = UNIT >> 1


@kernel
def rasterise(screen, inverse_depth, faces, first_id, ids, depth):
    """Draw triangles, both sides, into `ids` (h, w) int32 and `depth` (h, w) float32, the inverse depth; nearer wins, then lower id.

    Edge functions are exact in whole numbers and include the edges, so neighbours leave no gap. Triangles with a vertex of inverse
    depth 0 are left out.

    Source: Pineda, A parallel algorithm for polygon rasterization, SIGGRAPH 1988.
    """
    height, width = ids.shape
    for f in range(len(faces)):
        a, b, c = faces[f, 0], faces[f, 1], faces[f, 2]
        if inverse_depth[a] <= 0 or inverse_depth[b] <= 0 or inverse_depth[c] <= 0:
            continue
        xa, ya = int(screen[a, 0]), int(screen[a, 1])
        xb, yb = int(screen[b, 0]), int(screen[b, 1])
        xc, yc = int(screen[c, 0]), int(screen[c, 1])
        area = (xb - xa) * (yc - ya) - (yb - ya) * (xc - xa)
        if area == 0:
            continue
        if area < 0:
            area = -area
            b, c = c, b
            xb, yb, xc, yc = xc, yc, xb, yb
        left = max((min(xa, xb, xc) + HALF - 1) >> SUBPIXEL_BITS, 0)
        right = min((max(xa, xb, xc) - HALF) >> SUBPIXEL_BITS, width - 1)
        top = max((min(ya, yb, yc) + HALF - 1) >> SUBPIXEL_BITS, 0)
        bottom = min((max(ya, yb, yc) - HALF) >> SUBPIXEL_BITS, height - 1)
        if left > right or top > bottom:
            continue
        za, zb, zc = inverse_depth[a] / area, inverse_depth[b] / area, inverse_depth[c] / area
        step_a, step_b, step_c = -(yc - yb) * UNIT, -(ya - yc) * UNIT, -(yb - ya) * UNIT
        px = left * UNIT + HALF
        for y in range(top, bottom + 1):
            py = y * UNIT + HALF
            edge_a = (xc - xb) * (py - yb) - (yc - yb) * (px - xb)
            edge_b = (xa - xc) * (py - yc) - (ya - yc) * (px - xc)
            edge_c = (xb - xa) * (py - ya) - (yb - ya) * (px - xa)
            for x in range(left, right + 1):
                if (edge_a | edge_b | edge_c) >= 0:
                    nearness = edge_a * za + edge_b * zb + edge_c * zc
                    if nearness > depth[y, x]:
                        depth[y, x] = nearness
                        ids[y, x] = first_id + f
                edge_a += step_a
                edge_b += step_b
                edge_c += step_c
