"""Pictures of a dressed head: depth buffer, shading, averaging of samples."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float, Int, UInt8

from sacha_core.raster.camera import Camera
from sacha_core.synthesis.kernels.shading import shade_image
from sacha_core.synthesis.kernels.surface import project, widen_strands
from sacha_core.synthesis.kernels.triangles import rasterise

__all__ = ["Renderer", "Scene", "ribbon_faces"]

NEAR_M = 0.1  # what is closer to the camera is not drawn
ENCODE_STEPS = 4096


@dataclass(frozen=True)
class Scene:
    """One moment of a head, lit and ready to be seen by any camera.

    Args:
        points: (p, 3) float32 vertices of the surface, metres.
        strand_points: (s * m, 3) float32 points of s strands.
        strand_radii: (s * m,) float32 half widths there, metres.
        points_per_strand: m.
        faces: (g, 3) int32: triangles between `points`, then those of ribbons, whose vertices (two for each strand point) come after.
        kinds: (g,) uint8, kind of each triangle.
        table: (p + s m, 17) float32, what is known of each vertex and strand point; columns as in `kernels.shading`.
        lamps: (l, 7) float32 unit direction, colour and sharpness.
        iris: (5,) float32 colour, sine of its border's angle and of the pupil's.
        cloth: (7,) float32 colour of the shirt; height of its collar above `REST` where z is 0 and its slope over z; z of the neck's
            axis; length that its seams are measured by.
    """

    points: Float[np.ndarray, "p 3"]
    strand_points: Float[np.ndarray, "q 3"]
    strand_radii: Float[np.ndarray, " q"]
    points_per_strand: int
    faces: Int[np.ndarray, "g 3"]
    kinds: UInt8[np.ndarray, " g"]
    table: Float[np.ndarray, "r 17"]
    lamps: Float[np.ndarray, "l 7"]
    iris: Float[np.ndarray, "5"]
    cloth: Float[np.ndarray, "7"]


def ribbon_faces(n_strands: int, points_per_strand: int, first_vertex: int) -> Int[np.ndarray, "g 3"]:
    """Give the triangles of ribbons whose points have two vertices each, side by side."""
    start = first_vertex + 2 * points_per_strand * np.arange(n_strands)[:, None]
    a = (start + 2 * np.arange(points_per_strand - 1)).reshape(-1)
    return np.stack([a, a + 1, a + 2, a + 2, a + 1, a + 3], axis=1).reshape(-1, 3).astype(np.int32)


def srgb_bytes() -> UInt8[np.ndarray, " e"]:
    """Give the table from linear light, 0 to 1 in even steps, to sRGB bytes."""
    linear = np.linspace(0, 1, ENCODE_STEPS)
    encoded = np.where(linear <= 0.0031308, 12.92 * linear, 1.055 * linear ** (1 / 2.4) - 0.055)
    return np.round(encoded * 255).astype(np.uint8)


class Renderer:
    """Draws scenes; keeps its buffers from picture to picture, so each thread needs its own.

    Args:
        supersample: samples along each axis of a pixel.
    """

    def __init__(self, supersample: int = 2) -> None:
        self.supersample = supersample
        self.encode = srgb_bytes()
        self.ids = np.empty((0, 0), np.int32)
        self.depth = np.empty((0, 0), np.float32)
        self.screen = np.empty((0, 2), np.int32)
        self.inverse_depth = np.empty(0, np.float32)

    def draw(self, scene: Scene, camera: Camera) -> tuple[UInt8[np.ndarray, "h w 3"], UInt8[np.ndarray, "h w"]]:
        """Draw one picture.

        Args:
            scene: what is seen.
            camera: from where, and at what size.

        Returns:
            The image, sRGB on white, and the mask of what is not background.
        """
        self.find_visible(scene, camera)
        image = np.empty((camera.height, camera.width, 3), np.uint8)
        mask = np.empty((camera.height, camera.width), np.uint8)
        shade_image(
            self.ids,
            self.screen,
            self.inverse_depth,
            scene.faces,
            scene.kinds,
            len(scene.points),
            scene.table,
            scene.lamps,
            scene.iris,
            scene.cloth,
            camera.centre.astype(np.float32),
            self.encode,
            self.supersample,
            image,
            mask,
        )
        return image, mask

    def find_visible(self, scene: Scene, camera: Camera) -> None:
        """Fill `ids` and `depth` with the nearest triangle of each sample, `screen` and `inverse_depth` with all vertices."""
        shape = (camera.height * self.supersample, camera.width * self.supersample)
        if self.ids.shape != shape:
            self.ids, self.depth = np.empty(shape, np.int32), np.empty(shape, np.float32)
        self.ids.fill(-1)
        self.depth.fill(0)
        sampled = camera.resized(shape[1], shape[0])
        lens = (sampled.rotation, sampled.translation, sampled.fx, sampled.fy, sampled.cx, sampled.cy, NEAR_M)
        n_surface, n_strand_vertices = len(scene.points), 2 * len(scene.strand_points)
        if len(self.screen) != n_surface + n_strand_vertices:
            self.screen = np.empty((n_surface + n_strand_vertices, 2), np.int32)
            self.inverse_depth = np.empty(len(self.screen), np.float32)
        project(scene.points, *lens, self.screen[:n_surface], self.inverse_depth[:n_surface])
        widen_strands(
            scene.strand_points,
            scene.strand_radii,
            scene.points_per_strand,
            *lens,
            self.screen[n_surface:],
            self.inverse_depth[n_surface:],
        )
        rasterise(self.screen, self.inverse_depth, scene.faces, 0, self.ids, self.depth)
