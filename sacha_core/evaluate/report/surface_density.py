"""How densely Gaussians lie on a head, and the head with each triangle in a colour."""

from __future__ import annotations

import numpy as np
from jaxtyping import Float, Int

from sacha_core.raster.camera import Camera
from sacha_core.synthesis.kernels.surface import project
from sacha_core.synthesis.kernels.triangles import rasterise

__all__ = ["portrait_camera", "smooth_density", "triangle_picture"]

NEAR_M = 0.01
SAMPLES = 3  # along each axis of a pixel
CHUNK = 512  # triangles at a time: the distances to all others take some ten megabytes
SQUARE_CM_PER_SQUARE_M = 1e4
FACING = 0.5  # cosine between normals from which two triangles count as of one layer: skin, not the eye behind the lid
SHADE = 0.3  # of the light, that leaves triangles seen from the side
DISTANCE = 4.0  # of the camera, in head radii


def smooth_density(
    vertices: Float[np.ndarray, "v 3"], faces: Int[np.ndarray, "f 3"], counts: Float[np.ndarray, "c f"], radius_m: float
) -> Float[np.ndarray, "c f"]:
    """Give the density around each triangle: what lies within a radius, over the area within it.

    One triangle's own count tells little where there is about one Gaussian a triangle: it would show the triangles' sizes.

    Args:
        vertices: (v, 3) of a posed head, metres.
        faces: (f, 3).
        counts: (c, f) Gaussians of each triangle, of c avatars.
        radius_m: between centroids, metres; triangles that face elsewhere do not count.

    Returns:
        (c, f) Gaussians per square centimetre.
    """
    corners = vertices[faces].astype(np.float64)
    normals = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    doubled = np.linalg.norm(normals, axis=1)
    normals /= np.maximum(doubled, np.finfo(float).tiny)[:, None]
    centres = corners.mean(axis=1)
    lengths = (centres**2).sum(axis=1)
    sums = np.concatenate([counts, 0.5 * doubled[None]]).T
    found = np.empty_like(sums)
    for start in range(0, len(faces), CHUNK):
        rows = slice(start, start + CHUNK)
        squared = lengths[rows, None] + lengths - 2 * (centres[rows] @ centres.T)
        near = (squared <= radius_m**2) & (normals[rows] @ normals.T > FACING)
        near[np.arange(near.shape[0]), np.arange(start, start + near.shape[0])] = True  # itself, even without an area
        found[rows] = near @ sums
    areas = np.maximum(found[:, -1], np.finfo(float).tiny) * SQUARE_CM_PER_SQUARE_M
    density: np.ndarray = (found[:, :-1] / areas[:, None]).T
    return density


def portrait_camera(
    vertices: Float[np.ndarray, "v 3"], direction: tuple[float, float, float], width: int, height: int
) -> Camera:
    """Give a camera that sees the whole head from a direction, a little air around it.

    Args:
        vertices: (v, 3) of the head.
        direction: from the head to the camera.
        width: pixels.
        height: pixels.
    """
    low, high = vertices.min(axis=0), vertices.max(axis=0)
    centre, radius = (low + high) / 2, float(np.linalg.norm(high - low)) / 2
    towards = np.array(direction, np.float64) / np.linalg.norm(direction)
    camera = Camera.look_at(centre + DISTANCE * radius * towards, centre, width, height, 1.0)
    across, down = np.abs(camera.project(vertices) - (camera.cx, camera.cy)).max(axis=0)
    focal = 0.48 * min(width / across, height / down)
    return Camera.look_at(centre + DISTANCE * radius * towards, centre, width, height, focal)


def triangle_picture(
    vertices: Float[np.ndarray, "v 3"], faces: Int[np.ndarray, "f 3"], colours: Float[np.ndarray, "f 3"], camera: Camera
) -> Float[np.ndarray, "h w 3"]:
    """Draw a head with each triangle in one colour, darker the more it is seen from the side, on white.

    Args:
        vertices: (v, 3), metres.
        faces: (f, 3).
        colours: (f, 3) sRGB in [0, 1].
        camera: from where.
    """
    points = np.ascontiguousarray(vertices, np.float32)
    fine = camera.resized(camera.width * SAMPLES, camera.height * SAMPLES)
    screen, inverse_depth = np.zeros((len(points), 2), np.int32), np.zeros(len(points), np.float32)
    lens = (fine.rotation, fine.translation, fine.fx, fine.fy, fine.cx, fine.cy, NEAR_M)
    project(points, *lens, screen, inverse_depth)
    ids, depth = np.full((fine.height, fine.width), -1, np.int32), np.zeros((fine.height, fine.width), np.float32)
    rasterise(screen, inverse_depth, np.ascontiguousarray(faces, np.int32), 0, ids, depth)
    corners = points[faces].astype(np.float64)
    normals = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    towards = camera.centre - corners.mean(axis=1)
    sizes = np.linalg.norm(normals, axis=1) * np.linalg.norm(towards, axis=1)
    facing = np.abs((normals * towards).sum(axis=1)) / np.maximum(sizes, np.finfo(float).tiny)
    shaded = np.clip(colours * (1 - SHADE + SHADE * facing[:, None]), 0, 1)
    table = np.concatenate([shaded, np.ones((1, 3))])  # id -1, no triangle, takes the last
    samples = table[ids].reshape(camera.height, SAMPLES, camera.width, SAMPLES, 3)
    picture: np.ndarray = samples.mean(axis=(1, 3))
    return picture
