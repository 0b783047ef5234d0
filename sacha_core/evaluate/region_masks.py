"""Which region of the head each pixel of a captured image shows."""

from __future__ import annotations

import numpy as np
from jaxtyping import Bool, Float, Int32, UInt8

from sacha_core.flame.model import HeadModel
from sacha_core.flame.posing import Poser
from sacha_core.interchange.capture import Capture, View
from sacha_core.raster.camera import Camera
from sacha_core.regions.labels import label_triangles
from sacha_core.regions.partition import Partition
from sacha_core.regions.scheme import PAPER, RegionScheme
from sacha_core.synthesis.kernels.surface import project
from sacha_core.synthesis.kernels.triangles import rasterise

__all__ = ["NOWHERE", "RegionMasks", "region_mask"]

NOWHERE = 255  # a pixel that shows no triangle: background, hair, clothes
NEAR_M = 0.1  # what is closer to the camera is not drawn


class RegionMasks:
    """Masks of a capture's views, from its head as it was tracked: the same for every avatar that is judged on it.

    A pixel shows the region of the nearest triangle at its centre. Where that triangle is seen from behind, one looks into the head:
    through the mouth, as a mesh of FLAME has no cavity behind its lips, or through the neck's end. Such an opening belongs to the region
    around it. What the mesh does not have, hair above all, belongs nowhere. Masks are kept, a byte a pixel, so that judging many avatars
    makes them once.

    Args:
        capture: with the tracked motion.
        head: the head that its parameters belong to, with vertex masks.
        scheme: the regions; a `Partition` is of this head.

    Raises:
        HeadError: the head lacks a mask that the scheme is made from.
    """

    def __init__(self, capture: Capture, head: HeadModel, scheme: RegionScheme | Partition = PAPER) -> None:
        self.scheme = scheme
        self._pose = Poser(head, capture.motion)
        self._faces = np.ascontiguousarray(head.faces, np.int32)
        self._labels = scheme.labels if isinstance(scheme, Partition) else label_triangles(head, scheme)
        self._known: dict[tuple[int, int, int, int], UInt8[np.ndarray, "h w"]] = {}

    def region_of_pixel(
        self, view: View, width: int | None = None, height: int | None = None
    ) -> UInt8[np.ndarray, "h w"]:
        """Give the region that each pixel of a view shows.

        Args:
            view: of the capture.
            width: pixels; the stored width by default.
            height: pixels; the stored height by default.

        Returns:
            (h, w) places in the scheme's regions, `NOWHERE` where none is shown; not to be written to.
        """
        camera = view.camera.resized(width or view.camera.width, height or view.camera.height)
        key = (view.timestep, view.camera_index, camera.width, camera.height)
        if key not in self._known:
            mask = self._drawn(view.timestep, camera)
            mask.setflags(write=False)
            self._known[key] = mask
        return self._known[key]

    def _drawn(self, timestep: int, camera: Camera) -> UInt8[np.ndarray, "h w"]:
        """Draw one mask."""
        return region_mask(self._pose(timestep), self._faces, self._labels, camera)


def region_mask(
    vertices: Float[np.ndarray, "v 3"], faces: Int32[np.ndarray, "f 3"], labels: UInt8[np.ndarray, " f"], camera: Camera
) -> UInt8[np.ndarray, "h w"]:
    """Draw which region each pixel shows, as `RegionMasks` tells.

    Args:
        vertices: (v, 3) of the posed head, metres.
        faces: (f, 3) its triangles.
        labels: (f,) region of each.
        camera: which looks at it.
    """
    vertices = np.ascontiguousarray(vertices, np.float32)
    screen, inverse_depth = np.zeros((len(vertices), 2), np.int32), np.zeros(len(vertices), np.float32)
    lens = (camera.rotation, camera.translation, camera.fx, camera.fy, camera.cx, camera.cy, NEAR_M)
    project(vertices, *lens, screen, inverse_depth)
    shape = (camera.height, camera.width)
    ids, depth = np.full(shape, -1, np.int32), np.zeros(shape, np.float32)
    rasterise(screen, inverse_depth, faces, 0, ids, depth)
    a, b, c = (screen[faces[:, corner]].astype(np.int64).T for corner in range(3))
    from_behind = (b[0] - a[0]) * (c[1] - a[1]) - (b[1] - a[1]) * (c[0] - a[0]) > 0  # y points down
    mask: np.ndarray = np.append(labels, np.uint8(NOWHERE))[ids]  # id -1, no triangle, takes the last
    close_openings(mask, np.append(from_behind, False)[ids])
    return mask


def close_openings(mask: UInt8[np.ndarray, "h w"], inside: Bool[np.ndarray, "h w"]) -> None:
    """Let pixels of `mask` that show the inside of the head take the region of what surrounds them, ring by ring."""
    if not inside.any():
        return
    rows, columns = (np.flatnonzero(inside.any(axis=axis)) for axis in (1, 0))
    top, left = max(rows[0] - 1, 0), max(columns[0] - 1, 0)
    area = (slice(top, rows[-1] + 2), slice(left, columns[-1] + 2))
    found, waiting = mask[area], inside[area].copy()  # found is a view
    found[waiting] = NOWHERE
    while True:
        around = np.pad(found, 1, constant_values=NOWHERE)
        ring = np.minimum.reduce([around[:-2, 1:-1], around[2:, 1:-1], around[1:-1, :-2], around[1:-1, 2:]])
        reached = waiting & (ring != NOWHERE)
        if not reached.any():
            return
        found[reached] = ring[reached]
        waiting &= ~reached
