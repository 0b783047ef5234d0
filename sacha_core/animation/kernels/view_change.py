"""How far views have turned since colours that depend on them were made."""

from __future__ import annotations

from sacha_core.parallel.kernels.kernel import kernel


@kernel(error_model="numpy")
def largest_turn(points, centre, old_points, old_centre):
    """Give how far a point (f, 3) moved against the camera at most, over its distance, squared."""
    largest = 0.0
    for f in range(points.shape[0]):
        x, y, z = points[f, 0] - centre[0], points[f, 1] - centre[1], points[f, 2] - centre[2]
        dx = x - (old_points[f, 0] - old_centre[0])
        dy = y - (old_points[f, 1] - old_centre[1])
        dz = z - (old_points[f, 2] - old_centre[2])
        largest = max(largest, (dx * dx + dy * dy + dz * dz) / (x * x + y * y + z * z))
    return largest
