"""Heads that an artist can move: what Blender makes of the controls against the engine's posing, vertex by vertex."""

from __future__ import annotations

import os
import subprocess
import sys
from dataclasses import dataclass
from pathlib import Path
from types import ModuleType

import addon_utils
import bpy
import numpy as np
import pytest
from bpy_extras.object_utils import world_to_camera_view
from conftest import ENGINE, EXTENSION, MATERIAL_TIME_LIMIT_S, Material, in_blenders_axes
from mathutils import Vector

POSE_ERROR_M = 2e-6  # promised are 1e-5; float32 at the size of a head and joints in whole nanometres leave 3e-7
TEXT_ERROR_M = 1e-6  # an OBJ holds micrometres
STILL_ERROR_M = 1e-6  # one float32 sum for another
PARAMETER_ERROR = 2e-6  # radians, metres and coefficients through float32 matrices and quaternions
PIXEL_ERROR = 2e-3  # float32 matrices: 1e-6 of the 130 pixels of focal length, and of a metre of distance
JOINTS = ("root", "neck", "jaw", "left_eye", "right_eye")


@dataclass(frozen=True)
class Rigs:
    """What `make_rigs.py` made, which see."""

    folder: Path
    truth: dict[str, np.ndarray]

    def open(self, name: str) -> bpy.types.Object:
        """Open one of the files, and give the mesh."""
        bpy.ops.sacha.open(filepath=str(self.folder / name), head=str(self.folder / "hard.npz"))
        return bpy.context.object


@pytest.fixture(scope="session")
def rigs(tmp_path_factory: pytest.TempPathFactory) -> Rigs:
    """Let the engine make heads that are hard to move."""
    folder = tmp_path_factory.mktemp("rigs")
    script = Path(__file__).with_name("make_rigs.py")
    subprocess.run([ENGINE, script, folder], check=True, timeout=MATERIAL_TIME_LIMIT_S, stdin=subprocess.DEVNULL)
    with np.load(folder / "truth.npz") as truth:
        return Rigs(folder, dict(truth))


@pytest.fixture(scope="session")
def hard_blend(installed: str, rigs: Rigs, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A .blend of nothing but the hard head, opened from its model file."""
    bpy.ops.wm.read_homefile(use_empty=True)
    bpy.context.preferences.addons[installed].preferences.engine_python = ENGINE
    rigs.open("hard.npz")
    path = tmp_path_factory.mktemp("rigged") / "hard.blend"
    bpy.ops.wm.save_as_mainfile(filepath=str(path), check_existing=False)
    return path


@pytest.fixture
def hard(addon: ModuleType, hard_blend: Path) -> bpy.types.Object:
    """The hard head as the active object of the scene."""
    bpy.ops.wm.open_mainfile(filepath=str(hard_blend))
    return bpy.context.object


def evaluated(shown: bpy.types.Object) -> np.ndarray:
    """Give (v, 3) vertices in the world as they are shown now, in Blender's axes."""
    graph = bpy.context.evaluated_depsgraph_get()
    mesh = shown.evaluated_get(graph).data
    values = np.empty(3 * len(mesh.vertices), np.float32)
    mesh.vertices.foreach_get("co", values)
    world = np.array(shown.evaluated_get(graph).matrix_world)
    return values.reshape(-1, 3) @ world[:3, :3].T + world[:3, 3]


def error_m(shown: bpy.types.Object, vertices: np.ndarray) -> float:
    """Give the largest distance along an axis between what is shown and vertices in the engine's axes."""
    return float(np.abs(evaluated(shown) - in_blenders_axes(vertices)).max())


def dial(shown: bpy.types.Object, truth: dict[str, np.ndarray], row: int) -> None:
    """Set the controls by hand to one row of parameters."""
    blocks = shown.data.shape_keys.key_blocks
    for k, value in enumerate(truth["dial_expression"][row]):
        blocks[f"expression_{k:03d}"].value = value
    bones = shown.parent.pose.bones
    turns = np.concatenate([truth[f"dial_{name}"][row] for name in ("rotation", "neck", "jaw", "eyes")]).reshape(5, 3)
    for joint, turn in zip(JOINTS, turns, strict=True):
        angle = float(np.linalg.norm(turn))
        bones[joint].rotation_mode = "AXIS_ANGLE"
        bones[joint].rotation_axis_angle = (angle, *(turn / angle))
    bones["root"].location = truth["dial_translation"][row]


def test_random_controls_pose_as_the_engine_does(hard: bpy.types.Object, rigs: Rigs) -> None:
    for row, vertices in enumerate(rigs.truth["dialled"]):
        dial(hard, rigs.truth, row)
        assert error_m(hard, vertices) <= POSE_ERROR_M


def test_a_head_that_is_nobodys_can_be_made_somebodys(addon: ModuleType, hard: bpy.types.Object, rigs: Rigs) -> None:
    controls = __import__(f"{EXTENSION}.opening.controls", fromlist=["read"])
    shape = rigs.truth["dial_shape"]
    for k, value in enumerate(shape):
        hard.data.shape_keys.key_blocks[f"identity_{k:03d}"].value = value
    for row, vertices in enumerate(rigs.truth["shaped"]):
        dial(hard, rigs.truth, row)
        assert error_m(hard, vertices) <= POSE_ERROR_M
    read = controls.read(hard, bpy.context.evaluated_depsgraph_get())
    assert np.array_equal(read["shape"], shape)
    assert np.array_equal(read["expression"], rigs.truth["dial_expression"][-1])
    assert np.abs(controls.neutral(hard) - rigs.truth["somebody"]).max() <= STILL_ERROR_M
    bpy.ops.sacha.load_motion(filepath=str(rigs.folder / "other.npz"))
    again = controls.read(hard, bpy.context.evaluated_depsgraph_get())
    assert np.array_equal(again["shape"], shape)  # who it is stays, whoever the motion was tracked on
    bpy.ops.sacha.rest()
    assert hard.data.shape_keys.key_blocks["identity_000"].value == shape[0]


def test_joints_that_stayed_would_be_seen(hard: bpy.types.Object, rigs: Rigs) -> None:
    for bone in hard.parent.pose.bones:
        bone.constraints["SACHA joint"].mute = True
    dial(hard, rigs.truth, 0)
    assert error_m(hard, rigs.truth["dialled"][0]) > 100 * POSE_ERROR_M


def test_controls_need_no_add_on(hard: bpy.types.Object) -> None:
    drivers = [*hard.parent.animation_data.drivers, *hard.data.shape_keys.animation_data.drivers]
    assert len(drivers) > 36 + 15
    assert all(curve.driver.is_valid and curve.driver.is_simple_expression for curve in drivers)
    assert not any(curve.keyframe_points or curve.driver.use_self for curve in drivers)


WITHOUT_ADD_ON = """
import sys, bpy, numpy as np
bpy.ops.wm.open_mainfile(filepath=sys.argv[1])
assert not hasattr(bpy.types.Mesh, "sacha")
shown, graph, posed = bpy.data.objects["hard"], bpy.context.evaluated_depsgraph_get(), []
for frame in range(bpy.context.scene.frame_start, bpy.context.scene.frame_end + 1):
    bpy.context.scene.frame_set(frame)
    mesh = shown.evaluated_get(graph).data
    values = np.empty(3 * len(mesh.vertices), np.float32)
    mesh.vertices.foreach_get("co", values)
    posed.append(values.reshape(-1, 3))
np.save(sys.argv[2], np.stack(posed))
"""


def test_a_saved_head_plays_where_the_add_on_is_not_installed(addon: ModuleType, rigs: Rigs, tmp_path: Path) -> None:
    rigs.open("hard.sacha")
    bpy.ops.wm.save_as_mainfile(filepath=str(tmp_path / "hard.blend"), check_existing=False)
    command = [sys.executable, "-c", WITHOUT_ADD_ON, tmp_path / "hard.blend", tmp_path / "posed.npy"]
    elsewhere = os.environ | {"BLENDER_USER_RESOURCES": str(tmp_path)}
    subprocess.run(command, check=True, env=elsewhere, timeout=MATERIAL_TIME_LIMIT_S)
    for shown, vertices in zip(np.load(tmp_path / "posed.npy"), rigs.truth["posed"], strict=True):
        assert np.abs(shown - in_blenders_axes(vertices)).max() <= POSE_ERROR_M


def test_controls_read_back_what_was_dialled(addon: ModuleType, hard: bpy.types.Object, rigs: Rigs) -> None:
    controls = __import__(f"{EXTENSION}.opening.controls", fromlist=["read"])
    dial(hard, rigs.truth, 1)
    read = controls.read(hard, bpy.context.evaluated_depsgraph_get())
    assert np.array_equal(read["shape"], np.zeros_like(rigs.truth["dial_shape"]))
    for name in ("expression", "rotation", "neck", "jaw", "eyes", "translation"):
        assert np.abs(read[name] - rigs.truth[f"dial_{name}"][1]).max() <= PARAMETER_ERROR, name


def test_where_the_object_stands_is_part_of_what_is_read(
    addon: ModuleType, hard: bpy.types.Object, rigs: Rigs, tmp_path: Path
) -> None:
    controls = __import__(f"{EXTENSION}.opening.controls", fromlist=["read"])
    dial(hard, rigs.truth, 2)
    hard.parent.location, hard.parent.rotation_euler = (0.3, -0.2, 0.1), (0.4, 0.2, -1.1)
    read = controls.read(hard, bpy.context.evaluated_depsgraph_get())
    np.savez(tmp_path / "read.npz", **read)
    code = (
        "import sys, numpy as np, sacha_core\n"
        "from sacha_core.flame.open import open_head\n"
        "from sacha_core.flame.posing import pose_vertices\n"
        "read = np.load(sys.argv[1])\n"
        "rows = {k: read[k][None] for k in ('expression', 'rotation', 'neck', 'jaw', 'eyes', 'translation')}\n"
        "motion = sacha_core.Motion(read['shape'], np.zeros((0, 3), np.float32), **rows)\n"
        "np.save(sys.argv[3], pose_vertices(open_head(sys.argv[2]), motion, 0))\n"
    )
    files = [tmp_path / "read.npz", rigs.folder / "hard.npz", tmp_path / "posed.npy"]
    subprocess.run([ENGINE, "-c", code, *files], check=True, timeout=MATERIAL_TIME_LIMIT_S)
    assert error_m(hard, np.load(tmp_path / "posed.npy")) <= 2 * POSE_ERROR_M  # read, and posed again


def test_a_scaled_or_broken_head_is_not_read(addon: ModuleType, hard: bpy.types.Object) -> None:
    controls = __import__(f"{EXTENSION}.opening.controls", fromlist=["read"])
    hard.parent.scale = (2, 2, 2)
    with pytest.raises(ValueError, match="scale"):
        controls.read(hard, bpy.context.evaluated_depsgraph_get())
    hard.parent.scale = (1, 1, 1)
    hard.location.x = 0.1
    with pytest.raises(ValueError, match="moved apart"):
        controls.read(hard, bpy.context.evaluated_depsgraph_get())
    hard.data.shape_keys.key_blocks["expression_003"].name = "mine"
    with pytest.raises(ValueError, match="'expression_003'"):
        controls.read(hard, bpy.context.evaluated_depsgraph_get())
    hard.modifiers.clear()
    with pytest.raises(ValueError, match="no controls"):
        controls.read(hard, bpy.context.evaluated_depsgraph_get())


@pytest.mark.parametrize(
    ("name", "truth"),
    [
        ("hard.sacha", "posed"),
        ("model", "model_posed"),
        ("model/point_cloud/iteration_30/point_cloud.ply", "model_posed"),
    ],
)
def test_a_motion_plays_as_the_engine_poses_it(addon: ModuleType, rigs: Rigs, name: str, truth: str) -> None:
    shown, scene = rigs.open(name), bpy.context.scene
    assert (scene.render.fps, scene.render.fps_base) == (30, 1)
    assert (scene.frame_start, scene.frame_end) == (1, len(rigs.truth[truth]))
    controls = __import__(f"{EXTENSION}.opening.controls", fromlist=["motion_frame"])
    for frame, vertices in enumerate(rigs.truth[truth]):
        scene.frame_set(1 + frame)
        assert controls.motion_frame(shown, scene) == frame
        assert error_m(shown, vertices) <= POSE_ERROR_M


def test_a_motion_keeps_its_pace_in_a_scene_of_another(addon: ModuleType, rigs: Rigs) -> None:
    scene = bpy.context.scene
    cube = bpy.data.objects.new("cube", None)
    scene.collection.objects.link(cube)
    cube.keyframe_insert("location", frame=1)
    scene.render.fps, scene.frame_end = 24, 100
    shown = rigs.open("hard.sacha")
    assert (scene.render.fps, scene.frame_end) == (24, 100)
    for frame, vertices in enumerate(rigs.truth["posed"]):
        at = 1 + frame * 24 / 30
        scene.frame_set(int(at), subframe=at - int(at))
        assert error_m(shown, vertices) <= 10 * POSE_ERROR_M  # the subframe is float32: 1e-7 of a second, at full speed


def actions_of(shown: bpy.types.Object) -> set[bpy.types.Action]:
    """Give the actions that move a head: one in a Blender whose actions have slots, else one for each data block that moves."""
    return {
        block.animation_data.action for block in (shown.parent, shown.data.shape_keys) if block.animation_data.action
    }


def test_another_motion_takes_the_place_of_the_first(addon: ModuleType, rigs: Rigs) -> None:
    shown, scene = rigs.open("hard.sacha"), bpy.context.scene
    n_actions = 1 if "slots" in bpy.types.Action.bl_rna.properties else 2
    assert {*bpy.data.actions} == actions_of(shown)
    assert len(bpy.data.actions) == n_actions
    for action in bpy.data.actions:
        action["first"] = True
    bpy.ops.sacha.pose_joints()  # the head is also meant while its joints are in hand
    assert bpy.context.object == shown.parent
    bpy.ops.sacha.load_motion(filepath=str(rigs.folder / "other.npz"))
    assert {*bpy.data.actions} == actions_of(shown)
    assert len(bpy.data.actions) == n_actions
    assert not any("first" in action for action in bpy.data.actions)
    assert (scene.frame_start, scene.frame_end) == (1, len(rigs.truth["other"]))
    for frame, vertices in enumerate(rigs.truth["other"]):  # the person stays the file's
        scene.frame_set(1 + frame)
        assert error_m(shown, vertices) <= POSE_ERROR_M
    with pytest.raises(RuntimeError, match="expected a motion"):
        bpy.ops.sacha.load_motion(filepath=str(rigs.folder / "arkit.npz"))


def test_a_motion_can_be_given_with_the_file(addon: ModuleType, rigs: Rigs) -> None:
    files = {"filepath": rigs.folder / "hard.npz", "motion": rigs.folder / "other.npz"}
    bpy.ops.sacha.open(**{name: str(path) for name, path in files.items()})
    shown = bpy.context.object
    assert len(shown.data["sacha_shape"]) > 0
    bpy.context.scene.frame_set(3)
    assert np.abs(evaluated(shown) - evaluated_rest(shown)).max() > 1e-3


def evaluated_rest(shown: bpy.types.Object) -> np.ndarray:
    """Give (v, 3) vertices of the unposed head, in Blender's axes."""
    values = np.empty(3 * len(shown.data.vertices), np.float32)
    shown.data.vertices.foreach_get("co", values)
    return values.reshape(-1, 3)


def test_a_motion_too_large_for_the_keys_says_so(addon: ModuleType, rigs: Rigs) -> None:
    rigs.open("hard.npz")
    with np.load(rigs.folder / "other.npz") as kept:
        arrays = dict(kept)
    arrays["expr"][1, 2] = 11
    np.savez(rigs.folder / "large.npz", **arrays)
    with pytest.raises(RuntimeError, match=r"'expression_002' to 11"):
        bpy.ops.sacha.load_motion(filepath=str(rigs.folder / "large.npz"))


def test_joints_are_taken_in_hand_and_let_go_and_all_comes_to_rest(hard: bpy.types.Object, rigs: Rigs) -> None:
    dial(hard, rigs.truth, 0)
    bpy.ops.sacha.pose_joints()
    assert (bpy.context.object, bpy.context.object.mode) == (hard.parent, "POSE")
    bpy.ops.sacha.rest()
    assert error_m(hard, rigs.truth["template"]) <= STILL_ERROR_M
    bpy.ops.sacha.pose_joints()
    assert (bpy.context.object, bpy.context.object.mode) == (hard, "OBJECT")


def test_two_heads_move_apart_from_each_other(addon: ModuleType, rigs: Rigs) -> None:
    one, other = rigs.open("hard.npz"), rigs.open("hard.npz")
    dial(one, rigs.truth, 0)
    dial(other, rigs.truth, 1)
    assert error_m(one, rigs.truth["dialled"][0]) <= POSE_ERROR_M
    assert error_m(other, rigs.truth["dialled"][1]) <= POSE_ERROR_M


def test_a_copy_with_its_joints_moves_by_itself_and_a_linked_one_with_the_first(
    hard: bpy.types.Object, rigs: Rigs
) -> None:
    linked = hard.copy()
    bpy.context.collection.objects.link(linked)
    for item in (hard, hard.parent):
        item.select_set(True)
    bpy.ops.object.duplicate()
    copy = next(item for item in bpy.context.selected_objects if item.type == "MESH")
    assert copy.parent not in {None, hard.parent}
    dial(hard, rigs.truth, 0)
    dial(copy, rigs.truth, 1)
    for shown, row in ((hard, 0), (linked, 0), (copy, 1)):
        assert error_m(shown, rigs.truth["dialled"][row]) <= POSE_ERROR_M


def test_undo_takes_a_pose_back_and_redo_brings_it_again(addon: ModuleType, rigs: Rigs) -> None:
    bpy.ops.ed.undo_push(message="before")
    shown = rigs.open("hard.npz")
    bpy.ops.ed.undo_push(message="opened")
    name = shown.name
    dial(shown, rigs.truth, 3)
    bpy.ops.ed.undo_push(message="dialled")
    bpy.ops.ed.undo()
    assert error_m(bpy.data.objects[name], rigs.truth["template"]) <= STILL_ERROR_M
    bpy.ops.ed.redo()
    assert error_m(bpy.data.objects[name], rigs.truth["dialled"][3]) <= POSE_ERROR_M
    bpy.ops.ed.undo()
    bpy.ops.ed.undo()
    assert not bpy.data.objects


def test_a_flame_pickle_is_a_head_with_controls(addon: ModuleType, rigs: Rigs) -> None:
    shown = rigs.open("flame.pkl")
    dial(shown, rigs.truth, 4)
    assert error_m(shown, rigs.truth["dialled"][4]) <= POSE_ERROR_M


def test_a_gltf_that_split_every_vertex_is_joined_to_the_heads(addon: ModuleType, rigs: Rigs) -> None:
    shown = rigs.open("split.glb")
    assert len(shown.data.vertices) == len(rigs.truth["template"])
    assert error_m(shown, rigs.truth["template"]) <= STILL_ERROR_M
    dial(shown, rigs.truth, 5)
    assert error_m(shown, rigs.truth["dialled"][5]) <= POSE_ERROR_M


@pytest.mark.parametrize("kind", ["glb", "obj", "ply"])
def test_what_blender_exports_opens_with_controls(
    addon: ModuleType, hard: bpy.types.Object, rigs: Rigs, tmp_path: Path, kind: str
) -> None:
    path = str(tmp_path / f"exported.{kind}")
    if kind == "glb":
        addon_utils.enable("io_scene_gltf2")
        bpy.ops.export_scene.gltf(filepath=path, use_selection=True)
    elif kind == "obj":
        bpy.ops.wm.obj_export(filepath=path, export_selected_objects=True)
    else:
        bpy.ops.wm.ply_export(filepath=path, export_selected_objects=True, forward_axis="NEGATIVE_Z", up_axis="Y")
    bpy.ops.sacha.open(filepath=path, head=str(rigs.folder / "hard.npz"))
    shown = bpy.context.object
    assert shown != hard
    assert len(shown.data.vertices) == len(rigs.truth["template"])  # exporters split vertices at texture seams
    dial(shown, rigs.truth, 0)
    assert error_m(shown, rigs.truth["dialled"][0]) <= TEXT_ERROR_M + POSE_ERROR_M


def test_a_rig_of_named_shapes_has_them_by_name(addon: ModuleType, rigs: Rigs) -> None:
    bpy.ops.sacha.open(filepath=str(rigs.folder / "arkit.npz"))
    shown = bpy.context.object
    blocks = shown.data.shape_keys.key_blocks
    assert [block.name for block in blocks][:3] == ["Basis", "jawOpen", "eyeBlinkLeft"]
    assert [bone.name for bone in shown.parent.pose.bones] == ["root"]
    for block, vertices in zip(blocks[1:], rigs.truth["arkit"], strict=True):
        assert (block.slider_min, block.slider_max) == (0, 1)
        block.value = 1
        assert error_m(shown, vertices) <= STILL_ERROR_M
        block.value = 0


def test_a_head_without_texture_coordinates_is_unwrapped(hard: bpy.types.Object) -> None:
    uv = np.empty(6 * len(hard.data.polygons), np.float32)
    hard.data.uv_layers.active.uv.foreach_get("vector", uv)
    first, second, third = uv.reshape(-1, 3, 2).transpose(1, 0, 2)
    (ax, ay), (bx, by) = (second - first).T, (third - first).T
    area = np.abs(ax * by - ay * bx) / 2
    assert uv.min() >= 0
    assert uv.max() <= 1
    assert (area > 0).mean() > 0.99
    assert area.sum() <= 1  # charts that lie beside each other fit into the square


def test_cameras_of_a_capture_see_what_its_own_saw(addon: ModuleType, rigs: Rigs) -> None:
    bpy.ops.sacha.open_folder(directory=f"{rigs.folder / 'capture'}/")
    shown, scene = bpy.context.object, bpy.context.scene
    cameras = sorted((item for item in scene.objects if item.type == "CAMERA"), key=lambda item: item.name)
    assert [camera.name for camera in cameras] == ["camera_00", "camera_01", "camera_02"]
    assert scene.camera == cameras[0]
    size = np.array((scene.render.resolution_x, scene.render.resolution_y))
    assert size.tolist() == [64, 48]
    scene.frame_set(3)
    assert error_m(shown, rigs.truth["last"]) <= POSE_ERROR_M
    for camera, seen in zip(cameras, rigs.truth["seen"], strict=True):
        views = [world_to_camera_view(scene, camera, Vector(point)) for point in evaluated(shown).tolist()]
        pixels = np.array([(view.x, 1 - view.y) for view in views]) * size
        assert np.abs(pixels - seen).max() <= PIXEL_ERROR


def test_pixels_that_are_not_square_are_the_scenes(addon: ModuleType) -> None:
    cameras = __import__(f"{EXTENSION}.opening.cameras", fromlist=["add_cameras"])
    folder = __import__(f"{EXTENSION}.opening.scene_folder", fromlist=["Part"])
    scene, size = bpy.context.scene, np.array([[80, 60], [80, 60]])
    intrinsics = np.array([[100.0, 125.0, 33.0, 37.0]] * 2)
    placed = np.concatenate([np.eye(3), [[0.0], [0.0], [2.0]]], axis=1)
    part = folder.Part(
        {"sizes": size, "intrinsics": intrinsics, "world_to_camera": np.stack([placed] * 2)}, {"names": ["a", "b"]}
    )
    assert cameras.add_cameras(bpy.context, "x", part) == []
    bpy.context.view_layer.update()
    point = np.array([[0.3, -0.2, 0.5]])  # engine's axes
    x, y, z = point[0] + (0, 0, 2)
    view = world_to_camera_view(scene, scene.camera, Vector(in_blenders_axes(point)[0].tolist()))
    assert abs(view.x * 80 - (100 * x / z + 33)) <= PIXEL_ERROR
    assert abs((1 - view.y) * 60 - (125 * y / z + 37)) <= PIXEL_ERROR


def test_a_mesh_edited_after_opening_still_moves(hard: bpy.types.Object, rigs: Rigs) -> None:
    bpy.ops.object.mode_set(mode="EDIT")
    bpy.ops.mesh.select_all(action="DESELECT")
    bpy.ops.object.mode_set(mode="OBJECT")
    hard.data.vertices[0].select = True
    bpy.ops.object.mode_set(mode="EDIT")
    bpy.ops.mesh.delete(type="VERT")
    bpy.ops.object.mode_set(mode="OBJECT")
    dial(hard, rigs.truth, 0)
    assert error_m(hard, rigs.truth["dialled"][0][1:]) <= POSE_ERROR_M


def test_opening_while_another_mesh_is_edited_ends_the_edit(hard: bpy.types.Object, rigs: Rigs) -> None:
    bpy.ops.object.mode_set(mode="EDIT")
    again = rigs.open("hard.npz")
    assert again != hard
    assert again.mode == hard.mode == "OBJECT"


@pytest.mark.parametrize("hide", ["exclude", "hide_viewport"])
def test_where_the_active_collection_is_hidden_the_scenes_own_is_taken(
    addon: ModuleType, rigs: Rigs, hide: str
) -> None:
    hidden = bpy.data.collections.new("hidden")
    bpy.context.scene.collection.children.link(hidden)
    layer = bpy.context.view_layer.layer_collection.children["hidden"]
    bpy.context.view_layer.active_layer_collection = layer
    setattr(layer, hide, True)
    dial(rigs.open("hard.npz"), rigs.truth, 0)
    assert error_m(bpy.context.object, rigs.truth["dialled"][0]) <= POSE_ERROR_M


def test_names_too_long_for_blender_move_all_the_same(addon: ModuleType, rigs: Rigs, tmp_path: Path) -> None:
    with np.load(rigs.folder / "arkit.npz") as kept:
        arrays = dict(kept)
    arrays["arkit_names"] = np.array(["Basis", *(f"{'x' * 70}{k}" for k in range(1, 5))])
    np.savez(tmp_path / "long.npz", **arrays)
    weights = np.eye(5, dtype=np.float32)
    np.savez(tmp_path / "weights.npz", weights=weights, names=arrays["arkit_names"], time_s=np.arange(5) / 30)
    bpy.ops.sacha.open(filepath=str(tmp_path / "long.npz"), motion=str(tmp_path / "weights.npz"))
    shown = bpy.context.object
    controls = __import__(f"{EXTENSION}.opening.controls", fromlist=["read"])
    for frame, vertices in enumerate(rigs.truth["arkit"]):
        bpy.context.scene.frame_set(1 + frame)
        assert error_m(shown, vertices) <= STILL_ERROR_M
        read = controls.read(shown, bpy.context.evaluated_depsgraph_get())
        assert np.array_equal(read["expression"], weights[frame])


def test_an_avatar_of_the_materials_head_rests_as_before(opened: bpy.types.Object, material: Material) -> None:
    for block in opened.data.shape_keys.key_blocks:
        block.id_data.animation_data_clear()
        break
    for block in opened.data.shape_keys.key_blocks:
        block.value = 0
    assert error_m(opened, material.truth["vertices"]) <= STILL_ERROR_M
