"""One picture of the opened avatar, pixel by pixel: what an artist sees is what the engine says."""

from __future__ import annotations

from pathlib import Path

import bpy
import numpy as np
import pytest
from conftest import Material
from mathutils import Vector

SIZE = 160
BORDER_PIXELS = (
    0.02  # pixels whose centre lies nearer to an edge may fall to either side: rasterisers round coordinates
)


@pytest.fixture
def camera(opened: bpy.types.Object) -> bpy.types.Object:
    """Look at the opened head from the front left, the whole head in view, without perspective."""
    scene = bpy.context.scene
    scene.render.engine = "BLENDER_WORKBENCH"
    scene.render.resolution_x = scene.render.resolution_y = SIZE
    scene.render.resolution_percentage = 100
    scene.render.film_transparent = True
    scene.render.dither_intensity = 0
    scene.render.image_settings.file_format = "PNG"
    scene.render.image_settings.color_mode = "RGBA"
    scene.display.render_aa = "OFF"
    scene.display.shading.light = "FLAT"
    scene.display.shading.color_type = "VERTEX"
    scene.view_settings.view_transform = "Standard"

    corners = np.array([list(corner) for corner in opened.bound_box])
    centre, height = corners.mean(axis=0), np.ptp(corners[:, 2])
    lens = bpy.data.cameras.new("camera")
    lens.type, lens.ortho_scale = "ORTHO", float(1.1 * height)
    lens.clip_end = float(10 * height)
    placed = bpy.data.objects.new("camera", lens)
    scene.collection.objects.link(placed)
    scene.camera = placed
    towards = Vector((0.5, -1.0, 0.15)).normalized()
    placed.location = Vector(centre) + towards * float(3 * height)
    placed.rotation_euler = towards.to_track_quat("Z", "Y").to_euler()
    bpy.context.view_layer.update()
    return placed


def render(path: Path) -> np.ndarray:
    """Give (h, w, 4) bytes, row 0 at the bottom, through the file that a user would get."""
    bpy.context.scene.render.filepath = str(path)
    bpy.ops.render.render(write_still=True)
    picture = bpy.data.images.load(str(path))
    picture.colorspace_settings.name = "Non-Color"
    values = np.empty(SIZE * SIZE * 4, np.float32)
    picture.pixels.foreach_get(values)
    return np.rint(values.reshape(SIZE, SIZE, 4) * 255).astype(np.uint8)


def seen(camera: bpy.types.Object, shown: bpy.types.Object) -> tuple[np.ndarray, np.ndarray]:
    """Cast a ray through each pixel's centre: (h, w) the triangle it meets, -1 for none; and whether an edge is near."""
    frame = camera.data.view_frame(
        scene=bpy.context.scene
    )  # of an orthographic camera at any depth: taken at the camera's own
    top_right, _, bottom_left, top_left = (camera.matrix_world @ Vector((x, y, 0)) for x, y, _ in frame)
    forward = -(camera.matrix_world.to_3x3() @ Vector((0, 0, 1)))
    right, up = (top_right - top_left) / SIZE, (top_left - bottom_left) / SIZE
    shifts = [(0.0, 0.0), (BORDER_PIXELS, 0.0), (-BORDER_PIXELS, 0.0), (0.0, BORDER_PIXELS), (0.0, -BORDER_PIXELS)]
    met = np.empty((len(shifts), SIZE, SIZE), int)
    for index, (dx, dy) in enumerate(shifts):
        for row in range(SIZE):
            for column in range(SIZE):
                origin = bottom_left + right * (column + 0.5 + dx) + up * (row + 0.5 + dy)
                hit, _, _, face = shown.ray_cast(origin, forward)
                met[index, row, column] = face if hit else -1
    return met[0], (met != met[0]).any(axis=0)


@pytest.mark.parametrize("view", ["REGION", "COUNT"])
def test_every_pixel_has_the_colour_of_the_triangle_behind_it(
    opened: bpy.types.Object, camera: bpy.types.Object, material: Material, view: str, tmp_path: Path
) -> None:
    opened.data.sacha.view = view
    picture = render(tmp_path / "picture.png")
    face, near_edge = seen(camera, opened)
    sure = ~near_edge
    assert sure.mean() > 0.9
    background = sure & (face < 0)
    assert (picture[background] == 0).all()
    on_head = sure & (face >= 0)
    assert on_head.mean() > 0.2
    if view == "REGION":  # the scheme's own bytes: nothing between the engine and the picture changes a colour
        expected = material.truth["region_srgb"][material.truth["labels"][face[on_head]]]
        assert len(np.unique(expected, axis=0)) >= 6
    else:
        expected = srgb_encoded(material.truth["count_linear"][face[on_head], :3])
    assert (picture[on_head][:, 3] == 255).all()
    assert np.array_equal(picture[on_head][:, :3], expected)


def srgb_encoded(linear: np.ndarray) -> np.ndarray:
    """IEC 61966-2-1 to bytes."""
    linear = linear.astype(np.float64)
    encoded = np.where(linear <= 0.0031308, 12.92 * linear, 1.055 * linear ** (1 / 2.4) - 0.055)
    return np.rint(255 * encoded).astype(np.uint8)
