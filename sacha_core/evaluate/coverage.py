"""Does the tracked head lie where a capture's images show the person?"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from jaxtyping import Bool, Float, Int
from PIL import Image

from sacha_core.errors import DatasetError
from sacha_core.flame.model import HeadModel
from sacha_core.flame.posing import Poser
from sacha_core.interchange.capture import Capture, View
from sacha_core.interchange.image_file import BROKEN_IMAGE
from sacha_core.raster.camera import Camera

__all__ = ["Coverage", "foreground", "mesh_coverage"]

NEARLY_WHITE = 250  # of 255: where a capture has no masks, whatever is darker is taken for the person


@dataclass(frozen=True)
class Coverage:
    """How much of the posed head one view's mask covers.

    Args:
        view: the view.
        inside: fraction of the vertices that project into the mask.
        in_image: fraction of the vertices that project into the image.
        mask_area: fraction of the image that the mask covers.
    """

    view: View
    inside: float
    in_image: float
    mask_area: float


def mesh_coverage(
    capture: Capture, head: HeadModel, views: Sequence[View], masks: Sequence[Bool[np.ndarray, "h w"]]
) -> tuple[Coverage, ...]:
    """Project the posed head into views and look whether the masks cover it.

    Every vertex lies inside the outline of the head, hidden ones too, so a good track leaves out only what the capture masks away.

    Args:
        capture: where the views are from.
        head: the head that its parameters belong to.
        views: which to look at.
        masks: where each of them shows the person.
    """
    pose = Poser(head, capture.motion)
    found = []
    for view, mask in zip(views, masks, strict=True):
        row, column, in_image = pixels_of(pose(view.timestep), view.camera)
        inside = mask[row, column].sum() / len(in_image)
        found.append(Coverage(view, float(inside), float(in_image.mean()), float(mask.mean())))
    return tuple(found)


def foreground(capture: Capture, view: View) -> Bool[np.ndarray, "h w"]:
    """Give where a view shows the person: its mask, or what is not white.

    Raises:
        DatasetError: the image or the mask cannot be decoded.
    """
    image = capture.image(view)
    if view.mask_path is None:
        dark: np.ndarray = image.min(axis=2) < NEARLY_WHITE
        return dark
    try:
        with Image.open(view.mask_path) as stored:
            mask = np.asarray(stored.convert("L"))
    except BROKEN_IMAGE as error:
        raise DatasetError(f"{view.mask_path} cannot be decoded: {error}") from error
    covered: np.ndarray = mask > 127
    return covered


def pixels_of(
    vertices: Float[np.ndarray, "v 3"], camera: Camera
) -> tuple[Int[np.ndarray, " p"], Int[np.ndarray, " p"], Bool[np.ndarray, " v"]]:
    """Give row and column of the pixels of those vertices that fall into the image, and which do."""
    places = camera.project(vertices)
    within = (places >= 0) & (places < (camera.width, camera.height))
    in_image = within[:, 0] & within[:, 1]
    column, row = places[in_image].astype(np.int64).T  # not negative: this rounds down
    return row, column, in_image
