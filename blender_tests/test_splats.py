"""Splats in the view: attributes and places against the engine's own, at rest, in a pose, and where the head has changed."""

from __future__ import annotations

import subprocess
from pathlib import Path
from types import ModuleType

import bpy
import numpy as np
import pytest
from conftest import ENGINE, Material, positions

COMMAND_LIMIT_S = 60
PLACE_ERROR_M = 2e-6  # float32 sums of metres, in another order
TURN_ERROR = 2e-4  # of unit quaternions: small triangles have few digits left in their edges
FADE_ERROR = 0.03  # a ball of 80 facets, which ends at three deviations, where 0.009 are left
KINDS = {"scale": "vector", "rotation": "value", "color": "color", "position": "vector"}


def read(data: bpy.types.Mesh, name: str, width: int) -> np.ndarray:
    attribute = data.attributes[name]
    values = np.empty(width * len(attribute.data), np.float32)
    attribute.data.foreach_get(KINDS[name], values)
    return values.reshape(-1, width)


def engines_own(avatar: Path, vertices: np.ndarray, folder: Path) -> dict[str, np.ndarray]:
    """Let the engine carry the Gaussians along with a mesh in Blender's axes."""
    folder.mkdir()
    np.save(folder / "v.npy", np.stack([vertices[:, 0], vertices[:, 2], -vertices[:, 1]], axis=1).astype(np.float32))
    command = [ENGINE, "-m", "sacha_core", "splats", avatar, "--vertices", folder / "v.npy", "--out", folder]
    subprocess.run(command, check=True, timeout=COMMAND_LIMIT_S, capture_output=True)
    return {name: np.load(folder / f"{name}.npy") for name in (*KINDS, "binding")}


def shown_points(splats: bpy.types.Object) -> tuple[bpy.types.Mesh, slice]:
    """Give what the nodes make of the splats, and where in it the points themselves are: before the ellipsoids."""
    made = splats.evaluated_get(bpy.context.evaluated_depsgraph_get()).data
    return made, slice(0, len(splats.data.vertices))


def assert_alike(made: bpy.types.Mesh, rows: slice, expected: dict[str, np.ndarray]) -> None:
    assert np.abs(read(made, "position", 3)[rows] - expected["position"]).max() <= PLACE_ERROR_M
    np.testing.assert_allclose(read(made, "scale", 3)[rows], expected["scale"], rtol=1e-3)
    turns = np.abs(np.einsum("ni,ni->n", read(made, "rotation", 4)[rows], expected["rotation"]))
    assert (1 - turns).max() <= TURN_ERROR  # a quaternion and its negative are the same turn


@pytest.fixture(scope="session")
def splats_blend(opened_blend: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A .blend of the material's avatar with its splats."""
    bpy.ops.wm.open_mainfile(filepath=str(opened_blend))
    bpy.ops.sacha.show_splats()
    path = tmp_path_factory.mktemp("splats") / "splats.blend"
    bpy.ops.wm.save_as_mainfile(filepath=str(path), check_existing=False)
    return path


@pytest.fixture
def head(addon: ModuleType, splats_blend: Path) -> bpy.types.Object:
    """The avatar's head, active, with splats."""
    bpy.ops.wm.open_mainfile(filepath=str(splats_blend))
    return bpy.context.object


@pytest.fixture
def splats(head: bpy.types.Object) -> bpy.types.Object:
    """The head's splats."""
    return next(other for other in bpy.data.objects if other.sacha_splats.head == head)


def posed(head: bpy.types.Object) -> np.ndarray:
    """Give the vertices of a head as it stands, in its own space and Blender's axes."""
    return positions(head.evaluated_get(bpy.context.evaluated_depsgraph_get()).data)


def bend(head: bpy.types.Object) -> np.ndarray:
    """Bend a head by a shape key, beside whatever else poses it, and give its vertices as they then stand."""
    before, bent = posed(head), positions(head.data)
    if head.data.shape_keys is None:
        head.shape_key_add(name="Basis")
    key = head.shape_key_add(name="bent", from_mix=False)
    key.data.foreach_set("co", (bent + 0.01 * np.sin(30 * bent[:, ::-1])).ravel())
    key.value = 1.0
    after = posed(head)
    assert np.abs(after - before).max() > 0.005
    return after


def test_points_have_the_attributes_of_blenders_own_splats(
    splats: bpy.types.Object, head: bpy.types.Object, material: Material, tmp_path: Path
) -> None:
    expected = engines_own(material.folder / "avatar.sacha", posed(head), tmp_path / "own")
    kinds = {name: (splats.data.attributes[name].data_type, splats.data.attributes[name].domain) for name in KINDS}
    assert kinds == {
        "scale": ("FLOAT_VECTOR", "POINT"),
        "rotation": ("QUATERNION", "POINT"),
        "color": ("FLOAT_COLOR", "POINT"),
        "position": ("FLOAT_VECTOR", "POINT"),
    }
    assert np.array_equal(read(splats.data, "position", 3), expected["position"])
    assert np.array_equal(read(splats.data, "color", 4), expected["color"])
    assert_alike(splats.data, slice(None), expected)
    assert splats.parent == head


def test_nodes_put_them_where_the_engine_has_them(
    splats: bpy.types.Object, head: bpy.types.Object, material: Material, tmp_path: Path
) -> None:
    moved = bend(head)
    made, rows = shown_points(splats)
    assert_alike(made, rows, engines_own(material.folder / "avatar.sacha", moved, tmp_path / "own"))


def test_they_follow_shape_keys_and_the_heads_place(
    splats: bpy.types.Object, head: bpy.types.Object, material: Material, tmp_path: Path
) -> None:
    head.location, head.rotation_euler = (1, 2, 3), (0.3, 0.2, 0.1)
    moved = bend(head)
    made, rows = shown_points(splats)
    assert_alike(made, rows, engines_own(material.folder / "avatar.sacha", moved, tmp_path / "own"))
    assert splats.evaluated_get(bpy.context.evaluated_depsgraph_get()).matrix_world == head.matrix_world


def test_a_hidden_head_goes_on_carrying_them(
    splats: bpy.types.Object, head: bpy.types.Object, material: Material, tmp_path: Path
) -> None:
    head.hide_viewport = True
    moved = bend(head)
    made, rows = shown_points(splats)
    assert_alike(made, rows, engines_own(material.folder / "avatar.sacha", moved, tmp_path / "own"))


def test_where_the_mesh_was_edited_they_stay_and_an_update_refuses(
    splats: bpy.types.Object, head: bpy.types.Object
) -> None:
    before = read(splats.data, "position", 3)
    head.modifiers.new("finer", "SUBSURF").levels = 1
    made, rows = shown_points(splats)
    assert np.array_equal(read(made, "position", 3)[rows], before)
    with pytest.raises(RuntimeError, match="change its topology"):
        bpy.ops.sacha.update_splats()


def test_not_following_they_stay_until_they_are_brought_to_the_pose(
    splats: bpy.types.Object, head: bpy.types.Object
) -> None:
    splats.sacha_splats.follow = False
    before = read(splats.data, "position", 3)
    bend(head)
    made, rows = shown_points(splats)
    assert np.array_equal(read(made, "position", 3)[rows], before)
    bpy.ops.sacha.update_splats()
    assert not np.array_equal(read(splats.data, "position", 3), before)
    made, rows = shown_points(splats)
    assert np.array_equal(read(made, "position", 3)[rows], read(splats.data, "position", 3))


def test_solid_ellipsoids_have_size_and_colours(splats: bpy.types.Object) -> None:
    splats.sacha_splats.size, splats.sacha_splats.least_opacity = 2.0, 0.5
    made, rows = shown_points(splats)
    clear = np.flatnonzero(read(splats.data, "color", 4)[:, 3] >= 0.5)
    assert 0 < len(clear) < len(splats.data.vertices)
    corners = read(made, "position", 3)[rows.stop :].reshape(len(clear), 12, 3)  # an icosahedron each
    np.testing.assert_allclose(corners.mean(axis=1), read(made, "position", 3)[rows][clear], atol=1e-5)
    colours = read(made, "color", 4)[rows.stop :].reshape(len(clear), 12, 4)
    np.testing.assert_array_equal(colours[:, 0, :3], read(splats.data, "color", 4)[clear, :3])
    assert (colours[..., 3] == 1).all()  # solid views would fade what is fainter
    assert made.color_attributes.active_color.name == "color"
    sizes = np.linalg.norm(corners - corners.mean(axis=1, keepdims=True), axis=2)
    largest = read(made, "scale", 3)[rows][clear].max(axis=1)
    assert (sizes.max(axis=1) <= 2.0 * largest * 1.001).all()
    assert (sizes.max(axis=1) >= 2.0 * largest * 0.8).all()  # corners of an icosahedron lie not on every axis


def test_soft_ones_are_instances(splats: bpy.types.Object) -> None:
    splats.sacha_splats.soft, splats.sacha_splats.least_opacity = True, 0.0
    depsgraph = bpy.context.evaluated_depsgraph_get()
    materials = [
        one.object.data.materials[-1].name
        for one in depsgraph.object_instances
        if one.is_instance and one.parent.original == splats
    ]
    assert materials == ["SACHA Splats"] * len(splats.data.vertices)


def test_two_heads_have_their_own_splats(splats: bpy.types.Object, head: bpy.types.Object, material: Material) -> None:
    bpy.ops.sacha.open(filepath=str(material.folder / "avatar.sacha"))
    second = bpy.context.object
    bpy.ops.sacha.show_splats()
    other = next(one for one in bpy.data.objects if one.sacha_splats.head == second)
    assert other != splats
    assert other.data != splats.data
    assert splats.sacha_splats.head == head
    assert other.modifiers[0].node_group == splats.modifiers[0].node_group


def test_showing_again_makes_no_second_object(splats: bpy.types.Object, head: bpy.types.Object) -> None:
    counts = len(bpy.data.objects), len(bpy.data.meshes), len(bpy.data.node_groups)
    bpy.ops.sacha.show_splats()
    bpy.context.view_layer.objects.active = splats  # from the splats themselves, too
    bpy.ops.sacha.show_splats()
    assert (len(bpy.data.objects), len(bpy.data.meshes), len(bpy.data.node_groups)) == counts
    bpy.ops.sacha.remove_splats()
    assert not any(other.sacha_splats.head for other in bpy.data.objects)
    assert bpy.context.object == head


def test_they_survive_saving_and_work_without_the_addon(
    splats: bpy.types.Object, head: bpy.types.Object, addon: ModuleType, tmp_path: Path
) -> None:
    names = splats.name, head.name
    bpy.ops.wm.save_as_mainfile(filepath=str(tmp_path / "a.blend"), check_existing=False)
    addon.unregister()
    try:
        bpy.ops.wm.open_mainfile(filepath=str(tmp_path / "a.blend"))
        again, carrier = (bpy.data.objects[name] for name in names)
        before = read(shown_points(again)[0], "position", 3)
        bend(carrier)
        assert np.abs(read(shown_points(again)[0], "position", 3) - before).max() > 1e-3
    finally:
        addon.register()


def test_a_linked_duplicate_has_none_until_they_are_shown(splats: bpy.types.Object, head: bpy.types.Object) -> None:
    twin = head.copy()  # with the same mesh
    bpy.context.collection.objects.link(twin)
    bpy.context.view_layer.objects.active = twin
    assert not bpy.ops.sacha.remove_splats.poll()
    bpy.context.view_layer.objects.active = head
    assert bpy.ops.sacha.remove_splats.poll()


def test_without_their_head_they_stay(splats: bpy.types.Object, head: bpy.types.Object) -> None:
    before = read(splats.data, "position", 3)
    bpy.data.objects.remove(head)
    made, rows = shown_points(splats)
    assert np.array_equal(read(made, "position", 3)[rows], before)


def test_undo_takes_them_away(opened: bpy.types.Object) -> None:
    bpy.ops.ed.undo_push(message="before")
    bpy.ops.sacha.show_splats()
    assert any(other.sacha_splats.head for other in bpy.data.objects)
    bpy.ops.ed.undo_push(message="after")
    bpy.ops.ed.undo()
    assert not any(other.sacha_splats.head for other in bpy.data.objects)


def test_without_an_avatar_there_is_a_sentence(addon: ModuleType) -> None:
    with pytest.raises(RuntimeError, match="No avatar: open one, or select the mesh of one that is open"):
        bpy.ops.sacha.show_splats()


def test_where_blender_draws_splats_itself_they_are_its_own(addon: ModuleType, monkeypatch: pytest.MonkeyPatch) -> None:
    """No Blender that can be had here draws splats: the switch is thrown on a stand-in with the members that it has."""
    data = __import__(f"{addon.__name__}.looking.splat_data", fromlist=["make_data"])
    assert data._native_cloud("none", 3, 0) is None

    class Cloud:
        length = 0

        def resize(self, n: int) -> None:
            self.length = n

    made = Cloud()
    monkeypatch.setattr(data, "NATIVE", ())
    monkeypatch.setattr(
        data.bpy, "data", type("Data", (), {"pointclouds": type("Clouds", (), {"new": lambda _: made})})
    )
    assert data._native_cloud("some", 3, 2) is made
    assert (made.length, made.render_as, made.spherical_harmonics_degree) == (3, "SPLATS", 2)


def test_a_soft_splat_hides_what_its_gaussian_hides(
    splats: bpy.types.Object, head: bpy.types.Object, addon: ModuleType, tmp_path: Path
) -> None:
    """One splat, drawn by Cycles from the front, without perspective: its alpha is the Gaussian of the picture's coordinates."""
    data = __import__(f"{addon.__name__}.looking.splat_data", fromlist=["make_data"])
    one = {name: np.zeros((1, 3)) for name in ("position", "position_local")} | {"binding": np.zeros(1)}
    one |= {name: np.array([[1.0, 0, 0, 0]]) for name in ("rotation", "rotation_local")} | {"sh": np.zeros((1, 0, 3))}
    one |= {
        "scale": np.array([[0.1, 0.05, 0.06]]),
        "scale_local": np.ones((1, 3)),
        "color": np.array([[1, 0.25, 0, 0.8]]),
    }
    splats.data, _ = data.make_data("one", one, {"sh_degree": 0})
    settings = splats.sacha_splats
    settings.follow, settings.soft, settings.least_opacity, splats.parent, head.hide_render = (
        False,
        True,
        0.0,
        None,
        True,
    )
    scene, lens = bpy.context.scene, bpy.data.cameras.new("front")
    lens.type, lens.ortho_scale = "ORTHO", 0.8
    scene.camera = bpy.data.objects.new("front", lens)
    scene.collection.objects.link(scene.camera)
    scene.camera.location, scene.camera.rotation_euler = (0, -2, 0), (np.pi / 2, 0, 0)
    scene.render.engine, scene.cycles.samples, scene.cycles.pixel_filter_type = "CYCLES", 16, "BOX"
    scene.cycles.use_denoising, scene.render.film_transparent = False, True
    scene.render.resolution_x = scene.render.resolution_y = 64
    scene.render.image_settings.file_format, scene.render.filepath = "OPEN_EXR", str(tmp_path / "one.exr")
    bpy.ops.render.render(write_still=True)
    values = np.empty(64 * 64 * 4, np.float32)
    bpy.data.images.load(str(tmp_path / "one.exr")).pixels.foreach_get(values)
    alpha = values.reshape(64, 64, 4)[..., 3]
    x, z = np.meshgrid(*2 * [(np.arange(64) + 0.5) / 64 * 0.8 - 0.4])
    expected = 0.8 * np.exp(-0.5 * ((x / 0.1) ** 2 + (z / 0.06) ** 2))
    assert np.abs(alpha - expected).max() <= FADE_ERROR
