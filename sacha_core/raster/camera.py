"""A pinhole camera."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from jaxtyping import Float

__all__ = ["Camera"]


@dataclass(frozen=True)
class Camera:
    """A pinhole camera in OpenCV's axes: x right, y down, z forward; pixel centres lie at +0.5.

    Args:
        width: image width, pixels.
        height: image height, pixels.
        fx: focal length along x, pixels.
        fy: focal length along y, pixels.
        cx: principal point from the image's left edge, pixels.
        cy: principal point from the image's top edge, pixels.
        rotation: (3, 3) world to camera.
        translation: (3,) world to camera, metres: x_camera = rotation @ x_world + translation.
        whole_view: x / z at the left and right and y / z at the top and bottom edge of the image that this is a crop of; None for no crop.
            Splats far outside it are simplified, which must not depend on the crop.
    """

    width: int
    height: int
    fx: float
    fy: float
    cx: float
    cy: float
    rotation: Float[np.ndarray, "3 3"]
    translation: Float[np.ndarray, "3"]
    whole_view: tuple[float, float, float, float] | None = None

    @property
    def centre(self) -> Float[np.ndarray, "3"]:
        """Where the camera stands in the world, metres."""
        centre: np.ndarray = -self.rotation.T @ self.translation
        return centre

    @property
    def edges(self) -> tuple[float, float, float, float]:
        """X / z at the left and right edge and y / z at the top and bottom edge, of the whole image where this is a crop."""
        if self.whole_view is not None:
            return self.whole_view
        left, top = -self.cx / self.fx, -self.cy / self.fy
        return left, left + self.width / self.fx, top, top + self.height / self.fy

    def project(self, points: Float[np.ndarray, "p 3"]) -> Float[np.ndarray, "p 2"]:
        """Give where points fall in the image, and beside it: pixels from its left and top edge; NaN where they do not lie in front.

        Args:
            points: (p, 3) in the world, metres; reckoned with in float64.
        """
        seen = points.astype(np.float64) @ self.rotation.T + self.translation
        depth = np.where(seen[:, 2] > 0, seen[:, 2], np.nan)
        places: np.ndarray = seen[:, :2] / depth[:, None] * (self.fx, self.fy) + (self.cx, self.cy)
        return places

    def crop(self, left: int, top: int, width: int, height: int) -> Camera:
        """Give the camera of a rectangle of the image; what it shows is that part of the image, to the bit."""
        cx, cy = self.cx - left, self.cy - top
        return Camera(width, height, self.fx, self.fy, cx, cy, self.rotation, self.translation, self.edges)

    def resized(self, width: int, height: int) -> Camera:
        """Give the camera of the same view at another resolution."""
        x, y = width / self.width, height / self.height
        return replace(self, width=width, height=height, fx=self.fx * x, fy=self.fy * y, cx=self.cx * x, cy=self.cy * y)

    @classmethod
    def look_at(
        cls, eye: Float[np.ndarray, "3"], target: Float[np.ndarray, "3"], width: int, height: int, focal: float
    ) -> Camera:
        """Give the camera at `eye` that looks at `target` with the world's y up; `focal` in pixels."""
        forward = np.asarray(target, np.float64) - eye
        forward /= np.linalg.norm(forward)
        right = np.cross(forward, (0.0, 1.0, 0.0))
        right /= np.linalg.norm(right)
        rotation = np.stack([right, np.cross(forward, right), forward])
        return cls(
            width, height, focal, focal, width / 2, height / 2, rotation, -rotation @ np.asarray(eye, np.float64)
        )
