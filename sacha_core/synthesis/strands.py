"""Hair of any kind: thin strands that grow from triangles of the head and move with them."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float, Int

from sacha_core.geometry.triangle import TriangleFrames

__all__ = ["Strands", "joined"]


@dataclass(frozen=True)
class Strands:
    """s strands of m points each, on the unposed head.

    Args:
        root_face: (s,) triangle from which each grows.
        points: (s, m, 3) from root to tip, metres.
        radii: (s, m) half widths, metres.
        albedo: (s, m, 3) linear RGB.
        normals: (s, m, 3) unit: away from the head, for soft light.
        exposure: (s, m) how much of that light is left between the other strands, 0 to 1.
    """

    root_face: Int[np.ndarray, " s"]
    points: Float[np.ndarray, "s m 3"]
    radii: Float[np.ndarray, "s m"]
    albedo: Float[np.ndarray, "s m 3"]
    normals: Float[np.ndarray, "s m 3"]
    exposure: Float[np.ndarray, "s m"]

    def __len__(self) -> int:
        """Give the number of strands."""
        return len(self.root_face)

    def follow(
        self, rest: TriangleFrames, posed: TriangleFrames
    ) -> tuple[Float[np.ndarray, "s m 3"], Float[np.ndarray, "s m 3"]]:
        """Give points and normals after the head has moved: each strand rigidly with its triangle.

        Args:
            rest: frames of the unposed head's triangles.
            posed: frames of the posed head's.
        """
        roots = self.root_face
        turn = posed.rotation[roots] @ rest.rotation[roots].transpose(0, 2, 1)
        offset = self.points - rest.origin[roots, None]
        points = np.einsum("sij,smj->smi", turn, offset) + posed.origin[roots, None]
        return points, np.einsum("sij,smj->smi", turn, self.normals)


def joined(parts: list[Strands]) -> Strands:
    """Put strands of several kinds, with equal numbers of points, into one."""
    names = ("root_face", "points", "radii", "albedo", "normals", "exposure")
    return Strands(*(np.concatenate([getattr(part, name) for part in parts]) for name in names))
