"""The preview: its camera against Blender's own projection, its pictures against the engine's, from the scene as it stands."""

from __future__ import annotations

import json
import subprocess
from pathlib import Path
from types import ModuleType

import bpy
import numpy as np
import pytest
from bpy_extras.object_utils import world_to_camera_view
from conftest import ENGINE, Material, positions
from mathutils import Color, Vector
from test_panels import drawn_by, texts

COMMAND_LIMIT_S = 120
PIXEL_ERROR = (
    2e-3  # matrices of Blender are in single precision, distances some metres, focal lengths some hundred pixels
)


@pytest.fixture
def camera(opened: bpy.types.Object) -> bpy.types.Object:
    """A camera that looks at the head from the front left, with everything that lenses can have."""
    scene = bpy.context.scene
    scene.render.resolution_x, scene.render.resolution_y, scene.render.resolution_percentage = 200, 150, 50
    scene.render.pixel_aspect_x, scene.render.pixel_aspect_y = 1.0, 1.25
    lens = bpy.data.cameras.new("camera")
    lens.lens, lens.shift_x, lens.shift_y, lens.sensor_fit, lens.clip_start = 60, 0.1, -0.05, "VERTICAL", 0.01
    placed = bpy.data.objects.new("camera", lens)
    scene.collection.objects.link(placed)
    scene.camera = placed
    corners = [opened.matrix_world @ Vector(corner) for corner in opened.bound_box]
    middle = sum(corners, Vector()) / len(corners)
    away = Vector((0.4, -1.0, 0.2))
    placed.location, placed.scale = middle + away, (2, 2, 2)  # a camera's scale does nothing
    placed.rotation_euler = away.to_track_quat("Z", "Y").to_euler()
    bpy.context.view_layer.update()
    return placed


@pytest.fixture
def camera_file(addon: ModuleType):
    return __import__(f"{addon.__name__}.looking.camera", fromlist=["camera_file"]).camera_file


def described(camera_file, camera: bpy.types.Object, head: bpy.types.Object | None = None) -> dict:
    depsgraph = bpy.context.evaluated_depsgraph_get()
    return camera_file(camera, depsgraph, 100, 75, (1.0, 1.25), None if head is None else head.matrix_world)


def by_the_engines_camera(told: dict, points: np.ndarray) -> np.ndarray:
    """Project (n, 3) points in Blender's axes: pinhole by hand, in pixels from the top left."""
    y_up = np.stack([points[:, 0], points[:, 2], -points[:, 1]], axis=1).astype(np.float64)
    pose, intrinsics = np.array(told["world_to_camera"]), np.array(told["K"])
    seen = (y_up @ pose[:3, :3].T + pose[:3, 3]) @ intrinsics.T
    return seen[:, :2] / seen[:, 2:]


def by_blenders(camera: bpy.types.Object, points: np.ndarray) -> np.ndarray:
    seen = [world_to_camera_view(bpy.context.scene, camera, Vector(point)) for point in points]
    return np.array([(100 * x, 75 * (1 - y)) for x, y, _ in seen])


@pytest.mark.parametrize("fit", ["AUTO", "HORIZONTAL", "VERTICAL"])
def test_points_fall_where_blender_has_them(camera_file, opened, camera: bpy.types.Object, fit: str) -> None:
    camera.data.sensor_fit = fit
    points = positions(opened.data)[::37]
    error = by_the_engines_camera(described(camera_file, camera), points) - by_blenders(camera, points)
    assert np.abs(error).max() <= PIXEL_ERROR


def test_a_head_that_is_moved_turned_and_scaled_is_seen_as_it_stands(
    camera_file, opened: bpy.types.Object, camera: bpy.types.Object
) -> None:
    opened.location, opened.rotation_euler, opened.scale = (0.02, 0.1, -0.03), (0.2, -0.3, 0.5), (1.2, 1.2, 1.2)
    bpy.context.view_layer.update()
    told, points = described(camera_file, camera, opened), positions(opened.data)[::37]
    world = np.array([opened.matrix_world @ Vector(point) for point in points])
    assert np.abs(by_the_engines_camera(told, points) - by_blenders(camera, world)).max() <= PIXEL_ERROR
    assert told["near"] == pytest.approx(0.01 / 1.2, rel=1e-5)


def test_what_the_engine_cannot_draw_is_a_sentence(opened: bpy.types.Object, camera: bpy.types.Object) -> None:
    camera.data.type = "ORTHO"
    with pytest.raises(RuntimeError, match="has no perspective"):
        bpy.ops.sacha.render_preview(level="FILE")
    camera.data.type, opened.scale = "PERSP", (1, 2, 1)
    bpy.context.view_layer.update()
    with pytest.raises(RuntimeError, match="scaled unevenly or mirrored"):
        bpy.ops.sacha.render_preview(level="FILE")
    opened.scale = (1, 1, 1)
    bpy.context.view_layer.update()
    with pytest.raises(RuntimeError, match="Nothing to compare with"):
        bpy.ops.sacha.render_preview(level="FILE", error="DIFFERENCE")


def pixels(name: str) -> np.ndarray:
    """Give (h, w, 3) bytes of an image, row 0 at the top."""
    image = bpy.data.images[name]
    values = np.empty(image.size[0] * image.size[1] * 4, np.float32)
    image.pixels.foreach_get(values)
    return np.rint(values.reshape(image.size[1], image.size[0], 4)[::-1, :, :3] * 255).astype(np.uint8)


def test_pictures_are_the_engines_and_stay_in_the_blend(
    camera_file, opened: bpy.types.Object, camera: bpy.types.Object, material: Material, tmp_path: Path
) -> None:
    points = positions(opened.data)
    points += 0.004 * np.sin(40 * points[:, ::-1])  # sculpted: what is drawn is what stands there
    opened.data.vertices.foreach_set("co", points.ravel())
    opened.data.update()
    bpy.ops.sacha.render_preview(level="1", error="DIFFERENCE")
    assert "dB" in bpy.context.scene.sacha_looking.told
    posed = positions(opened.evaluated_get(bpy.context.evaluated_depsgraph_get()).data)
    np.save(tmp_path / "v.npy", np.stack([posed[:, 0], posed[:, 2], -posed[:, 1]], axis=1))
    (tmp_path / "c.json").write_text(json.dumps(described(camera_file, camera, opened)))
    files = ("--vertices", "v.npy", "--camera-file", "c.json", "-o", "p.png", "--error", "e.png", "--truth", "t.png")
    command = [ENGINE, "-m", "sacha_core", "render", material.folder / "avatar.sacha", *files, "--level", "1"]
    subprocess.run(command, check=True, timeout=COMMAND_LIMIT_S, capture_output=True, cwd=tmp_path)
    bpy.ops.wm.save_as_mainfile(filepath=str(tmp_path / "a.blend"), check_existing=False)
    bpy.ops.wm.open_mainfile(filepath=str(tmp_path / "a.blend"))
    for name, file in {"SACHA Preview": "p", "SACHA Error": "e", "SACHA Uncompressed": "t"}.items():
        assert bpy.data.images[name].packed_file.data == (tmp_path / f"{file}.png").read_bytes()
    picture, truth, error = pixels("SACHA Preview"), pixels("SACHA Uncompressed"), pixels("SACHA Error")
    assert picture.shape == (75, 100, 3)
    assert 0.05 < (truth != 255).any(axis=2).mean() < 0.95
    assert np.array_equal((picture != truth).any(axis=2), error.any(axis=2))


@pytest.mark.parametrize("kind", ["DIFFERENCE", "FLIP"])
def test_colours_of_an_error_are_explained_and_it_goes_with_its_picture(
    opened: bpy.types.Object, camera: bpy.types.Object, kind: str
) -> None:
    """Oracle: the colours that are there, and the scale that was asked for."""
    chosen = bpy.context.scene.sacha_looking
    chosen.level, chosen.error, chosen.brightest, chosen.brightest_flip = "1", kind, 0.05, 0.05
    bpy.ops.sacha.render_preview()
    shown = texts(drawn_by(bpy.types.SACHA_PT_preview))
    assert [line.name for line in chosen.legend] == ["0", "0.01", "0.02", "0.03", "0.04", "0.05 and more"]
    assert [name for name in shown if name in chosen.legend] == chosen.legend.keys()
    colours = np.array([Color(line.kept).from_scene_linear_to_srgb() for line in chosen.legend])
    error = pixels("SACHA Error").reshape(-1, 3)
    assert (error == np.rint(255 * colours[0])).all(axis=1).any()  # beside the avatar
    assert (error == np.rint(255 * colours[-1])).all(axis=1).any()  # the material's level 1 is far off
    chosen.error = "NONE"
    bpy.ops.sacha.render_preview()
    assert "SACHA Error" not in bpy.data.images
    assert not len(chosen.legend)
    assert "SACHA Error" not in texts(drawn_by(bpy.types.SACHA_PT_preview))


def test_the_scenes_settings_count_where_none_are_given_and_no_second_image_is_made(
    opened: bpy.types.Object, camera: bpy.types.Object
) -> None:
    chosen = bpy.context.scene.sacha_looking
    chosen.level, chosen.error = (
        "FILE",
        "DIFFERENCE",
    )  # a level that leaves nothing to compare is no fault of the button's
    bpy.ops.sacha.render_preview()
    assert chosen.told == ""
    bpy.ops.sacha.render_preview()
    assert [image.name for image in bpy.data.images if image.name.startswith("SACHA")] == ["SACHA Preview"]


def test_without_a_camera_there_is_nothing_to_press(opened: bpy.types.Object) -> None:
    bpy.context.scene.camera = None
    assert not bpy.ops.sacha.render_preview.poll()
