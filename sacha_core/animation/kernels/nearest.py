"""The nearest triangle of a mesh to each of many points."""

from __future__ import annotations

from sacha_core.parallel.kernels.kernel import kernel

__all__ = ["nearest_triangles"]


@kernel(error_model="numpy", forceinline=True)
def squared_distance(px, py, pz, t):
    """Give the squared distance of a point to the triangle whose corners are the nine numbers of `t`, by the region that it lies over."""
    abx, aby, abz = t[3] - t[0], t[4] - t[1], t[5] - t[2]
    acx, acy, acz = t[6] - t[0], t[7] - t[1], t[8] - t[2]
    apx, apy, apz = px - t[0], py - t[1], pz - t[2]
    d1, d2 = abx * apx + aby * apy + abz * apz, acx * apx + acy * apy + acz * apz
    bpx, bpy, bpz = px - t[3], py - t[4], pz - t[5]
    d3, d4 = abx * bpx + aby * bpy + abz * bpz, acx * bpx + acy * bpy + acz * bpz
    cpx, cpy, cpz = px - t[6], py - t[7], pz - t[8]
    d5, d6 = abx * cpx + aby * cpy + abz * cpz, acx * cpx + acy * cpy + acz * cpz
    va, vb, vc = d3 * d6 - d5 * d4, d5 * d2 - d1 * d6, d1 * d4 - d3 * d2
    if d1 <= 0 and d2 <= 0:
        v, w = 0.0, 0.0
    elif d3 >= 0 and d4 <= d3:
        v, w = 1.0, 0.0
    elif d6 >= 0 and d5 <= d6:
        v, w = 0.0, 1.0
    elif vc <= 0 and d1 >= 0 and d3 <= 0:
        v, w = d1 / (d1 - d3), 0.0
    elif vb <= 0 and d2 >= 0 and d6 <= 0:
        v, w = 0.0, d2 / (d2 - d6)
    elif va <= 0 and d4 >= d3 and d5 >= d6:
        w = (d4 - d3) / ((d4 - d3) + (d5 - d6))
        v = 1 - w
    else:
        v, w = vb / (va + vb + vc), vc / (va + vb + vc)
    x, y, z = apx - v * abx - w * acx, apy - v * aby - w * acy, apz - v * abz - w * acz
    return x * x + y * y + z * z


@kernel(error_model="numpy")
def nearest_triangles(points, corners, centres, radii, starts, cluster_centres, cluster_radii, faces, squared):
    """Find for each point (n, 3) the triangle (f, 9) that is nearest, the first of several; all float64.

    Triangles stand in clusters, of which cluster c holds those from starts[c] to starts[c + 1]; a cluster and a triangle each lie within a
    sphere, which tells most of them to be too far. Writes places of triangles and squared distances.
    """
    for i in range(points.shape[0]):
        px, py, pz = points[i, 0], points[i, 1], points[i, 2]
        best, found, first = 1e300, 0, 0
        least = 1e300
        for c in range(len(cluster_radii)):  # begin where it is likely
            x, y, z = px - cluster_centres[c, 0], py - cluster_centres[c, 1], pz - cluster_centres[c, 2]
            near = (x * x + y * y + z * z) ** 0.5 - cluster_radii[c]
            if near < least:
                least, first = near, c
        for step in range(len(cluster_radii) + 1):
            c = first if step == 0 else step - 1
            x, y, z = px - cluster_centres[c, 0], py - cluster_centres[c, 1], pz - cluster_centres[c, 2]
            near = (x * x + y * y + z * z) ** 0.5 - cluster_radii[c]
            if (near > 0 and near * near > best) or (step > 0 and c == first):
                continue
            for t in range(starts[c], starts[c + 1]):
                x, y, z = px - centres[t, 0], py - centres[t, 1], pz - centres[t, 2]
                near = (x * x + y * y + z * z) ** 0.5 - radii[t]
                if near > 0 and near * near > best:
                    continue
                distance = squared_distance(px, py, pz, corners[t])
                if distance < best or (distance == best and t < found):
                    best, found = distance, t
        faces[i], squared[i] = found, best
