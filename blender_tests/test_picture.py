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
def camera(seen: bpy.types.Object) -> bpy.types.Object:
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

    corners = np.array([list(corner) for corner in seen.bound_box])
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


def met_by_pixels(camera: bpy.types.Object, shown: bpy.types.Object) -> tuple[np.ndarray, np.ndarray]:
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


VIEWS = (
    "region", "count", "density", "bytes", "opacity", "sensitivity", "modulator", "threshold", "ratio", "count_change", "density_change",
    "bytes_change", "opacity_change",
)  # fmt: skip


@pytest.fixture(scope="module")
def expected(material: Material) -> dict[str, np.ndarray]:
    """What the engine says that is to be seen, as sRGB bytes of triangles."""
    with np.load(material.folder / "seen.npz") as arrays:
        return dict(arrays)


def test_every_pixel_of_every_view_has_the_colour_of_the_triangle_behind_it(
    seen: bpy.types.Object, camera: bpy.types.Object, expected: dict[str, np.ndarray], tmp_path: Path
) -> None:
    assert {view.name for view in seen.data.sacha.views} >= set(VIEWS)
    face, near_edge = met_by_pixels(camera, seen)
    sure = ~near_edge
    assert sure.mean() > 0.9
    background, on_head = sure & (face < 0), sure & (face >= 0)
    assert on_head.mean() > 0.2
    pictures = set()
    for view in VIEWS:
        for by in ("TRIANGLE", "REGION"):
            seen.data.sacha.view, seen.data.sacha.by = view.upper(), by
            picture = render(tmp_path / f"{view}_{by}.png")
            colours = expected[f"{view}_{by.lower()}"][face[on_head]]
            assert (picture[background] == 0).all(), view
            assert (picture[on_head][:, 3] == 255).all(), view
            assert np.array_equal(picture[on_head][:, :3], colours), (
                view,
                by,
            )  # the engine's own bytes: nothing on the way changes them
            assert len(np.unique(colours, axis=0)) >= 6 or by == "REGION", view
            pictures.add(picture.tobytes())
    numbers_of_regions = {"region", "modulator", "threshold", "ratio"}
    assert len(pictures) == 2 * len(VIEWS) - len(numbers_of_regions)
