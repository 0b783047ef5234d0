"""What cameras would have to mean for the tracked head to lie where it is seen.

Cameras come in other axes, inverted, in millimetres, or with the intrinsics of images of another size; each leaves a file that reads
without a complaint. So every such reading is tried, and where another one puts the head far better into the masks than the file's own,
it is named.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from jaxtyping import Float

from sacha_core.evaluate.checkup.finding import Finding
from sacha_core.evaluate.checkup.silhouette import CoarseMask, agreement
from sacha_core.interchange.transforms import camera_to_world_opengl
from sacha_core.raster.camera import Camera

__all__ = ["Posed", "best_reading", "judge_cameras", "mean_agreement"]

Y_AND_Z_TURNED = np.array([1.0, -1.0, -1.0])
AS_WRITTEN = "as written"
BETTER = 0.15  # by how much another reading must agree better with the masks to be named
GOOD = 0.4  # agreement of a reading that may be the right one: hair and shoulders cost up to half
BAD = 0.25  # agreement below which a head is not where it is seen
MANY = 0.25  # share of views in which it is not so from which on training is in vain


@dataclass(frozen=True)
class Posed:
    """One view with the head as it is posed there.

    Args:
        points: (p, 3) all over the head, metres.
        camera: as the file says.
        mask: of the view, coarse.
    """

    points: Float[np.ndarray, "p 3"]
    camera: Camera
    mask: CoarseMask


def as_opencv_axes(camera: Camera) -> Camera:
    """Read the matrix as camera to world with y down and z forward."""
    return _posed(camera, Y_AND_Z_TURNED[:, None] * camera.rotation, Y_AND_Z_TURNED * camera.translation)


def as_world_to_camera(camera: Camera) -> Camera:
    """Read the matrix as world to camera with y down and z forward."""
    matrix = camera_to_world_opengl(camera)
    return _posed(camera, matrix[:3, :3], matrix[:3, 3])


def as_world_to_camera_opengl(camera: Camera) -> Camera:
    """Read the matrix as world to camera with y up and z backward."""
    return as_opencv_axes(as_world_to_camera(camera))


READINGS = {
    AS_WRITTEN: lambda camera: camera,
    "camera to world in OpenCV's axes (y down, z forward)": as_opencv_axes,
    "world to camera in OpenCV's axes (y down, z forward)": as_world_to_camera,
    "world to camera in OpenGL's axes (y up, z backward)": as_world_to_camera_opengl,
}
UNITS = {"metres": 1.0, "millimetres": 1e-3, "centimetres": 1e-2}
IMAGE_SCALES = {1.0: "", 2.0: "half", 0.5: "twice", 4.0: "a quarter", 0.25: "four times"}


def mean_agreement(views: Sequence[Posed]) -> float:
    """Give how far head and masks agree over views, 0 to 1."""
    return float(np.mean([agreement(view.points, view.camera, view.mask) for view in views]))


def best_reading(views: Sequence[Posed]) -> tuple[str, float]:
    """Give the reading of the cameras under which the head agrees best with the masks, and how far it does.

    Args:
        views: some views of different cameras and timesteps.

    Returns:
        What the cameras would be, `AS_WRITTEN` where no other reading is better by `BETTER`; and its agreement.
    """
    best = (AS_WRITTEN, mean_agreement(views))
    least = best[1] + BETTER
    for name, cameras in _candidates(views):
        found = float(
            np.mean([agreement(view.points, camera, view.mask) for view, camera in zip(views, cameras, strict=True)])
        )
        if found > max(least, best[1]):
            best = (name, found)
    return best


def judge_cameras(views: Sequence[Posed]) -> list[Finding]:
    """Say what is wrong with the cameras, or that the head is not where it is seen whatever they mean."""
    written = mean_agreement(views)
    name, found = best_reading(views)
    if name != AS_WRITTEN and found >= GOOD:
        what = f"the tracked head agrees with {100 * written:.0f} % of the masks, but with {100 * found:.0f} % if cameras are {name}"
        return [Finding("error", "cameras", what, _remedy(name))]
    if written < BAD:
        what = f"the tracked head misses the masks: they agree by {100 * written:.0f} %; training would fail for that"
        remedy = "look at the picture (--picture): another head than it was tracked with, cameras of another capture, or a lost track"
        return [Finding("error", "tracking", what, remedy)]
    missed = sum(agreement(view.points, view.camera, view.mask) < BAD for view in views)
    if missed >= MANY * len(views):
        what = f"the tracked head misses the masks in {missed} of {len(views)} views; training would fail for that"
        remedy = "look at the picture (--picture): a lost track, or a sequence of another head or with other cameras"
        return [Finding("error", "tracking", what, remedy)]
    return []


def _candidates(views: Sequence[Posed]) -> list[tuple[str, list[Camera]]]:
    found = []
    for reading, read in READINGS.items():
        for unit, metres in UNITS.items():
            words = [words for words in (reading, f"in {unit}") if words not in {AS_WRITTEN, "in metres"}]
            if words:
                cameras = [read(view.camera) for view in views]
                found.append((", ".join(words), [_moved(camera, metres) for camera in cameras]))
    for scale, words_of in IMAGE_SCALES.items():
        if scale != 1:
            name = f"meant for images {words_of} as wide and high"
            found.append((name, [_scaled(view.camera, scale) for view in views]))
    centred = [replace(view.camera, cx=view.camera.width / 2, cy=view.camera.height / 2) for view in views]
    found.append(("taken with the principal point in the middle of the image", centred))
    return found


def _remedy(name: str) -> str:
    if "images" in name:
        return "scale fl_x, fl_y, cx and cy in the transforms*.json together with the images"
    if "principal" in name:
        return "correct cx and cy in the transforms*.json: where images are cropped, they move with the crop"
    return "write transform_matrix as camera to world in OpenGL's axes (x right, y up, z backward), in metres"


def _posed(camera: Camera, rotation: Float[np.ndarray, "3 3"], translation: Float[np.ndarray, " 3"]) -> Camera:
    return replace(camera, rotation=np.ascontiguousarray(rotation), translation=translation)


def _moved(camera: Camera, scale: float) -> Camera:
    """Bring the camera to `scale` times its distance from the origin."""
    return replace(camera, translation=camera.translation * scale)


def _scaled(camera: Camera, scale: float) -> Camera:
    return replace(camera, fx=camera.fx * scale, fy=camera.fy * scale, cx=camera.cx * scale, cy=camera.cy * scale)
