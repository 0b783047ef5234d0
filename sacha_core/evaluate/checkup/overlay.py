"""The posed mesh drawn over images of a capture: the eye finds a lost track at once."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import numpy as np
from jaxtyping import Bool, Float, Int, UInt8
from PIL import Image, ImageDraw

from sacha_core.evaluate.sheet import Panel, write_sheet
from sacha_core.flame.model import HeadModel
from sacha_core.flame.posing import Poser
from sacha_core.interchange.capture import Capture, View
from sacha_core.raster.camera import Camera

__all__ = ["facing_edges", "over_image", "write_overlay"]

MESH_COLOUR, MASK_COLOUR = (0, 158, 255), (255, 120, 0)  # told apart by colour-blind people too
OPACITY = 0.4
PANEL_HEIGHT = 360  # pixels


def write_overlay(
    path: Path, capture: Capture, head: HeadModel, rows: Sequence[Sequence[View]], masks: dict[Path, np.ndarray]
) -> None:
    """Write a sheet of views with the posed mesh and the edge of the mask drawn over each.

    Args:
        path: PNG to write.
        capture: where the views are from.
        head: that it was tracked with.
        rows: views, in rows of the sheet.
        masks: (h, w) of views by their image.

    Raises:
        DatasetError: an image cannot be decoded.
        OSError: the file cannot be written.
    """
    pose = Poser(head, capture.motion)
    sheet = []
    for views in rows:
        panels = []
        for view in views:
            height = min(PANEL_HEIGHT, view.camera.height)
            width = max(round(view.camera.width * height / view.camera.height), 1)
            image = np.asarray(Image.fromarray(capture.image(view)).resize((width, height)))
            mask = np.asarray(Image.fromarray(masks[view.image_path]).resize((width, height)))
            drawn = over_image(image, mask, pose(view.timestep), head.faces, view.camera.resized(width, height))
            panels.append(Panel(drawn / np.float32(255), f"timestep {view.timestep}, camera {view.camera_index}"))
        sheet.append(panels)
    write_sheet(path, sheet)


def facing_edges(places: Float[np.ndarray, "v 2"], faces: Int[np.ndarray, "f 3"]) -> Int[np.ndarray, "e 2"]:
    """Give each edge of the triangles that face the camera once.

    Args:
        places: (v, 2) where vertices are in the image, x right, y down; NaN behind the camera.
        faces: (f, 3) counter-clockwise seen from outside.
    """
    a, b, c = places[faces[:, 0]], places[faces[:, 1]], places[faces[:, 2]]
    area = (b[:, 0] - a[:, 0]) * (c[:, 1] - a[:, 1]) - (b[:, 1] - a[:, 1]) * (c[:, 0] - a[:, 0])
    facing = faces[area < 0]  # the image's y points down; NaN compares false
    edges = np.sort(np.concatenate([facing[:, [0, 1]], facing[:, [1, 2]], facing[:, [2, 0]]]), axis=1)
    once: np.ndarray = np.unique(edges, axis=0)
    return once


def over_image(
    image: UInt8[np.ndarray, "h w 3"],
    mask: Bool[np.ndarray, "h w"],
    vertices: Float[np.ndarray, "v 3"],
    faces: Int[np.ndarray, "f 3"],
    camera: Camera,
) -> UInt8[np.ndarray, "h w 3"]:
    """Draw the side of a mesh that faces the camera as lines, and the edge of a mask, over an image."""
    places = camera.project(vertices)
    lines = places[facing_edges(places, faces)].reshape(-1, 4)
    near = (np.abs(lines) < 4 * max(image.shape[:2])).all(axis=1)
    over = Image.fromarray(image)
    pen = ImageDraw.Draw(over)
    for line in lines[near].tolist():
        pen.line(line, fill=MESH_COLOUR)
    drawn = np.asarray(Image.blend(Image.fromarray(image), over, OPACITY)).copy()
    edge = np.zeros_like(mask)
    edge[1:] |= mask[1:] != mask[:-1]
    edge[:, 1:] |= mask[:, 1:] != mask[:, :-1]
    drawn[edge] = MASK_COLOUR
    return drawn
