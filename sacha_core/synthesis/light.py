"""The studio: light from all around, and what of it reaches each point of a posed head."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float, Int

from sacha_core.synthesis.kernels.light import depth_map, gather_light

__all__ = ["STUDIO", "Shadows", "Studio"]

MAP_SIZE = 160  # texels of a shadow map's side: about 2.5 mm
BIAS_M = 0.003  # the map's mesh is coarser than the surface that it shades
SLOPE_BIAS_M = 0.006
N_DIRECTIONS = 36


@dataclass(frozen=True)
class Lamp:
    """A soft light: radiance falls off around a direction as a lobe.

    Args:
        direction: (3,) unit, towards the lamp.
        colour: (3,) linear RGB at the middle of the lobe.
        sharpness: of the lobe exp(sharpness (cos - 1)).
    """

    direction: tuple[float, float, float]
    colour: tuple[float, float, float]
    sharpness: float


@dataclass(frozen=True)
class Studio:
    """Lamps and a sky.

    Args:
        lamps: soft lights; the specular highlights are theirs.
        sky: (3,) radiance from straight above.
        ground: (3,) from straight below.
    """

    lamps: tuple[Lamp, ...]
    sky: tuple[float, float, float]
    ground: tuple[float, float, float]

    def radiance(self, directions: Float[np.ndarray, "d 3"]) -> Float[np.ndarray, "d 3"]:
        """Give the linear RGB radiance that comes from directions."""
        height = (directions[:, 1:2] + 1) / 2
        total: np.ndarray = height * np.array(self.sky) + (1 - height) * np.array(self.ground)
        for lamp in self.lamps:
            towards = np.array(lamp.direction) / np.linalg.norm(lamp.direction)
            total = total + np.exp(lamp.sharpness * (directions @ towards - 1))[:, None] * np.array(lamp.colour)
        return total

    def lamp_table(self) -> Float[np.ndarray, "l 7"]:
        """Give the lamps as rows of unit direction, colour and sharpness."""
        rows = [(*(np.array(x.direction) / np.linalg.norm(x.direction)), *x.colour, x.sharpness) for x in self.lamps]
        return np.array(rows, np.float32)


STUDIO = Studio(
    lamps=(
        Lamp((0.65, 0.55, 0.75), (3.3, 3.1, 2.85), 5.0),  # key: large, warm, from the subject's upper left
        Lamp((-0.8, 0.15, 0.6), (0.75, 0.85, 1.0), 4.0),  # fill: weak and cool
        Lamp((-0.55, 0.5, -0.85), (1.7, 1.75, 1.9), 8.0),  # rim from behind
    ),
    sky=(0.52, 0.56, 0.62),
    ground=(0.24, 0.21, 0.19),
)


def even_directions(n: int) -> Float[np.ndarray, "n 3"]:
    """Give n directions spread evenly over the sphere.

    Source: the Fibonacci lattice, as Gonzalez, Mathematical Geosciences 2010.
    """
    row = np.arange(n) + 0.5
    y = 1 - 2 * row / n
    angle = np.pi * (3 - np.sqrt(5)) * row
    ring = np.sqrt(1 - y * y)
    return np.stack([ring * np.cos(angle), y, ring * np.sin(angle)], axis=1)


class Shadows:
    """Shadow maps of one posed head from every direction of the studio's light.

    Args:
        studio: where light comes from.
        vertices: (v, 3) of the mesh that casts shadows, metres.
        faces: (f, 3).
    """

    def __init__(self, studio: Studio, vertices: Float[np.ndarray, "v 3"], faces: Int[np.ndarray, "f 3"]) -> None:
        directions = even_directions(N_DIRECTIONS)
        # A surface that faces an even sky of radiance 1 receives 1: the sum over directions of cos is n / 4.
        self.radiance = (studio.radiance(directions) * (4 / N_DIRECTIONS)).astype(np.float32)
        self.axes = np.stack([axes_towards(d) for d in directions]).astype(np.float32)
        low, high = vertices.min(axis=0), vertices.max(axis=0)
        self.centre = ((low + high) / 2).astype(np.float32)
        self.radius = np.float32(np.linalg.norm(high - low) / 2)
        self.maps = np.empty((N_DIRECTIONS, MAP_SIZE, MAP_SIZE), np.float32)
        ids = np.empty((MAP_SIZE, MAP_SIZE), np.int32)
        screen, height = np.empty((len(vertices), 2), np.int32), np.empty(len(vertices), np.float32)
        for axes, nearness in zip(self.axes, self.maps, strict=True):
            depth_map(vertices, faces, axes, self.centre, self.radius, ids, nearness, screen, height)

    def irradiance(
        self,
        points: Float[np.ndarray, "n 3"],
        normals: Float[np.ndarray, "n 3"],
        wrap: tuple[float, float, float],
        bias_m: float = BIAS_M,
    ) -> Float[np.ndarray, "n 3"]:
        """Give the linear RGB light that arrives at points.

        Args:
            points: (n, 3) metres.
            normals: (n, 3) unit.
            wrap: how far light reaches past the terminator, for each colour; red first and largest.
            bias_m: how far behind the map's surface a point may lie and still be lit.
        """
        total = np.zeros((len(points), 3), np.float32)
        for axes, radiance, nearness in zip(self.axes, self.radiance, self.maps, strict=True):
            gather_light(
                points,
                normals,
                nearness,
                axes,
                radiance,
                np.array(wrap, np.float32),
                self.centre,
                self.radius,
                np.float32(bias_m),
                np.float32(SLOPE_BIAS_M),
                total,
            )
        return total


def axes_towards(direction: Float[np.ndarray, "3"]) -> Float[np.ndarray, "3 3"]:
    """Give right, up and `direction` as the rows of a rotation."""
    aside = np.array([0.0, 1.0, 0.0]) if abs(direction[1]) < 0.9 else np.array([0.0, 0.0, 1.0])
    right = np.cross(aside, direction)
    right /= np.linalg.norm(right)
    return np.stack([right, np.cross(direction, right), direction])
