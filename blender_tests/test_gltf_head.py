"""Oracle: Blender's own importer and player of glTF, against the engine's posing: FLAME's moving joints and correctives included."""

from __future__ import annotations

import subprocess
from pathlib import Path

import addon_utils
import bpy
import numpy as np
from conftest import ENGINE, MATERIAL_TIME_LIMIT_S, in_blenders_axes

VERTEX_ERROR_M = 2e-6  # float32, in Blender's order of operations
FRAME_RATE = 30


def corners_shown(mesh: bpy.types.Object) -> np.ndarray:
    """Give (f, 3, 3) corners of triangles of an object as it is shown."""
    shown = mesh.evaluated_get(bpy.context.evaluated_depsgraph_get())
    data = shown.to_mesh()
    places, used = np.empty(3 * len(data.vertices), np.float32), np.empty(len(data.loops), np.int32)
    data.vertices.foreach_get("co", places)
    data.loops.foreach_get("vertex_index", used)
    matrix = np.array(shown.matrix_world)
    world = places.reshape(-1, 3) @ matrix[:3, :3].T + matrix[:3, 3]
    shown.to_mesh_clear()
    return world[used].reshape(-1, 3, 3)


def test_blender_plays_the_exported_head_as_the_engine_poses_it(tmp_path: Path) -> None:
    script = Path(__file__).with_name("make_gltf.py")
    subprocess.run([ENGINE, script, tmp_path], check=True, timeout=MATERIAL_TIME_LIMIT_S, stdin=subprocess.DEVNULL)
    bpy.ops.wm.read_homefile(use_empty=True)
    addon_utils.enable("io_scene_gltf2")
    bpy.context.scene.render.fps = FRAME_RATE
    bpy.ops.import_scene.gltf(filepath=str(tmp_path / "head.glb"))
    (head,) = [one for one in bpy.context.scene.objects if one.type == "MESH" and one.data.shape_keys]
    for key in head.data.shape_keys.key_blocks[1:]:
        # The importer takes the range of a shape key from the first frame alone, and values beyond it are clamped
        key.slider_min, key.slider_max = -2, 2
    for frame, corners in enumerate(np.load(tmp_path / "corners.npy")):
        bpy.context.scene.frame_set(frame)
        expected = in_blenders_axes(corners.reshape(-1, 3)).reshape(-1, 3, 3)
        np.testing.assert_allclose(corners_shown(head), expected, atol=VERTEX_ERROR_M)
