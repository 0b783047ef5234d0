"""Where `render` looks from: round the head, or through a capture's cameras."""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from jaxtyping import Float

from sacha_core.errors import OptionError
from sacha_core.interchange.capture import Capture
from sacha_core.raster.camera import Camera

__all__ = ["Extent", "RoundTheHead", "ThroughCapture", "extent_of", "round_the_head"]

FILLED = 0.92  # of the image, by the box round the head
STRAY_PERCENT = 0.2  # of the Gaussians at each end of an axis that need not fit
SHOWS = 0.1  # of the highest opacity: what is fainter does not count
DISTANCE = 1.0  # metres: a portrait's, with little perspective


@dataclass(frozen=True)
class Extent:
    """The box round the visible part of an avatar.

    Args:
        centre: (3,) metres.
        half_size: (3,) from the centre to the faces of the box, metres.
    """

    centre: Float[np.ndarray, "3"]
    half_size: Float[np.ndarray, "3"]


def extent_of(means_world: Float[np.ndarray, "n 3"], opacities: Float[np.ndarray, " n"]) -> Extent:
    """Give the box round the Gaussians that show, but for the few that stray.

    Raises:
        OptionError: there is nothing to look at.
    """
    if len(opacities) == 0:
        raise OptionError("the avatar has no Gaussians; there is nothing to look at")
    shown = means_world[opacities >= SHOWS * opacities.max()]
    low, high = np.percentile(shown.astype(np.float64), [STRAY_PERCENT, 100 - STRAY_PERCENT], axis=0)
    return Extent((low + high) / 2, (high - low) / 2)


def round_the_head(
    extent: Extent,
    width: int,
    height: int,
    azimuth_deg: float = 0.0,
    elevation_deg: float = 0.0,
    distance: float | None = None,
    focal: float | None = None,
) -> Camera:
    """Give a camera that looks at the middle of the head.

    Args:
        extent: where the head is.
        width: pixels.
        height: pixels.
        azimuth_deg: 0 from the front, 90 from the subject's left.
        elevation_deg: from below (-) or above (+), between -89 and 89.
        distance: metres from the middle; a portrait's by default.
        focal: focal length, pixels; by default such that the head fits, the same from all sides.

    Raises:
        OptionError: the camera would stand in the head, or look straight down.
    """
    if not -89 <= elevation_deg <= 89:
        raise OptionError(f"--elevation is {elevation_deg:g}, expected -89 to 89 degrees")
    across, up = max(extent.half_size[0], extent.half_size[2]), extent.half_size[1]
    if distance is None:
        distance = max(DISTANCE, 3 * float(across))
    if distance <= across:
        raise OptionError(f"--distance is {distance:g} m, which is inside the head; expected more than {across:.2f} m")
    if focal is None:
        fits = min(width / 2 / max(across, 1e-6), height / 2 / max(up, 1e-6))
        focal = FILLED * fits * float(distance - across)
    if focal <= 0:
        raise OptionError(f"--focal is {focal:g}, expected more than 0 pixels")
    azimuth, elevation = math.radians(azimuth_deg), math.radians(elevation_deg)
    away = np.array(
        [math.sin(azimuth) * math.cos(elevation), math.sin(elevation), math.cos(azimuth) * math.cos(elevation)]
    )
    return Camera.look_at(extent.centre + distance * away, extent.centre, width, height, float(focal))


@dataclass(frozen=True)
class RoundTheHead:
    """Cameras at some azimuths, which may travel.

    Args:
        extent: where the head is.
        width: pixels of each picture.
        height: pixels.
        azimuths_deg: one camera each.
        elevation_deg: of all of them.
        distance: metres; see `round_the_head`.
        focal: pixels; see `round_the_head`.
    """

    extent: Extent
    width: int
    height: int
    azimuths_deg: tuple[float, ...]
    elevation_deg: float = 0.0
    distance: float | None = None
    focal: float | None = None

    def cameras(self, frame: int, turned_deg: float) -> list[Camera]:  # noqa: ARG002  (the head is followed by no camera)
        """Give the cameras after they have travelled by `turned_deg`."""
        return [
            round_the_head(
                self.extent,
                self.width,
                self.height,
                azimuth + turned_deg,
                self.elevation_deg,
                self.distance,
                self.focal,
            )
            for azimuth in self.azimuths_deg
        ]


@dataclass(frozen=True)
class ThroughCapture:
    """Cameras of a capture, at each frame as they stood at that timestep.

    Args:
        capture: the capture.
        indices: which of its cameras.
        width: pixels of each picture; the stored width by default.
        height: pixels; the stored height by default.
    """

    capture: Capture
    indices: tuple[int, ...]
    width: int | None = None
    height: int | None = None

    @cached_property
    def _known(self) -> dict[tuple[int, int], Camera]:
        views = (*self.capture.train, *self.capture.val, *self.capture.test)
        return {(view.camera_index, view.timestep): view.camera for view in views}

    def cameras(self, frame: int, turned_deg: float) -> list[Camera]:  # noqa: ARG002  (a capture's cameras stand where they stood)
        """Give the cameras at timestep `frame`, or, beyond the capture's timesteps, as they stood at its first.

        Raises:
            OptionError: the capture has no such camera.
        """
        chosen = []
        for index in self.indices:
            camera = self._known.get((index, frame)) or self._first(index)
            chosen.append(camera.resized(self.width or camera.width, self.height or camera.height))
        return chosen

    def _first(self, index: int) -> Camera:
        timesteps = [timestep for known, timestep in self._known if known == index]
        if not timesteps:
            there = ", ".join(map(str, sorted({known for known, _ in self._known})))
            raise OptionError(f"--camera {index}: {self.capture.root} has the cameras {there}")
        return self._known[index, min(timesteps)]
