"""What leaves Blender: heat maps against the colours that are shown, and the engine's exports."""

from __future__ import annotations

import json
import struct
from pathlib import Path
from types import ModuleType, SimpleNamespace

import bpy
import numpy as np
import pytest
from conftest import Material, corner_colours, positions

SIZE = 256
PLACE_ERROR_M = 2e-6  # float32 sums of metres, in another order


def srgb_encoded(linear: np.ndarray) -> np.ndarray:
    """IEC 61966-2-1 to bytes."""
    linear = linear.astype(np.float64)
    encoded = np.where(linear <= 0.0031308, 12.92 * linear, 1.055 * linear ** (1 / 2.4) - 0.055)
    return np.rint(255 * encoded).astype(np.uint8)


def uv_of(mesh: bpy.types.Mesh) -> np.ndarray:
    values = np.empty(2 * len(mesh.loops), np.float32)
    mesh.uv_layers.active.uv.foreach_get("vector", values)
    return values.reshape(-1, 3, 2)


def assert_centres_have_their_colours(mesh: bpy.types.Mesh, path: Path) -> None:
    """Look into the texture where a renderer would, in the middle of each triangle that has some texels."""
    image = bpy.data.images.load(str(path))
    values = np.empty(SIZE * SIZE * 4, np.float32)
    image.pixels.foreach_get(values)  # row 0 at the bottom, as v has it
    texture = np.rint(values.reshape(SIZE, SIZE, 4) * 255).astype(np.uint8)
    uv = uv_of(mesh)
    large = np.abs(np.linalg.det((uv[:, 1:] - uv[:, :1]).astype(np.float64))) * SIZE**2 > 12
    assert large.sum() > 50
    column, row = np.floor(uv.mean(axis=1) * SIZE).astype(int).T
    shown = corner_colours(mesh, mesh.color_attributes.active_color.name)[:, 0, :3]
    assert np.array_equal(texture[row, column, :3][large], srgb_encoded(shown)[large])
    assert (texture[row, column, 3][large] == 255).all()


@pytest.mark.parametrize("view", ["REGION", "COUNT"])
def test_a_heat_map_has_the_colours_that_are_shown(opened: bpy.types.Object, view: str, tmp_path: Path) -> None:
    opened.data.sacha.view = view
    bpy.ops.sacha.bake_heat_map(filepath=str(tmp_path / "map.png"), size=SIZE)
    assert_centres_have_their_colours(opened.data, tmp_path / "map.png")
    material = opened.data.materials[opened.data.polygons[0].material_index]
    texture = next(node for node in material.node_tree.nodes if node.type == "TEX_IMAGE")
    assert Path(bpy.path.abspath(texture.image.filepath)) == tmp_path / "map.png"


def test_a_copy_of_a_mesh_gets_a_heat_map_of_its_own(opened: bpy.types.Object, tmp_path: Path) -> None:
    def baked(thing: bpy.types.Object, name: str) -> None:
        bpy.context.view_layer.objects.active = thing
        bpy.ops.sacha.bake_heat_map(filepath=str(tmp_path / name), size=16)

    def worn(thing: bpy.types.Object) -> str:
        (material,) = thing.data.materials
        texture = next(node for node in material.node_tree.nodes if node.type == "TEX_IMAGE")
        return Path(bpy.path.abspath(texture.image.filepath)).name

    baked(opened, "first.png")
    twin = opened.copy()
    twin.data = opened.data.copy()
    bpy.context.collection.objects.link(twin)
    baked(twin, "twin.png")
    assert (worn(opened), worn(twin)) == ("first.png", "twin.png")
    baked(opened, "again.png")
    assert (worn(opened), worn(twin)) == ("again.png", "twin.png")
    assert len(bpy.data.materials) == 2


def test_a_mesh_without_texture_coordinates_gets_some(opened: bpy.types.Object, tmp_path: Path) -> None:
    while opened.data.uv_layers:
        opened.data.uv_layers.remove(opened.data.uv_layers[0])
    bpy.ops.sacha.bake_heat_map(filepath=str(tmp_path / "map.png"), size=SIZE, material=False)
    assert_centres_have_their_colours(opened.data, tmp_path / "map.png")
    assert not any(opened.data.materials)


def test_what_cannot_be_baked_is_a_sentence(addon: ModuleType, opened: bpy.types.Object, tmp_path: Path) -> None:
    target = str(tmp_path / "map.png")
    shown = opened.data.color_attributes.active_color
    shown.data[0].color = (0.5, 0.25, 0.125, 1)
    with pytest.raises(RuntimeError, match="change within triangles"):
        bpy.ops.sacha.bake_heat_map(filepath=target)
    opened.data.color_attributes.remove(shown)
    with pytest.raises(RuntimeError, match="shows no colours of its triangles"):
        bpy.ops.sacha.bake_heat_map(filepath=target)
    bpy.ops.wm.read_homefile(use_empty=True)
    with pytest.raises(RuntimeError, match="No head: open one"):
        bpy.ops.sacha.bake_heat_map(filepath=target)
    assert not list(tmp_path.iterdir())


def test_splats_leave_as_numbered_files(opened: bpy.types.Object, material: Material, tmp_path: Path) -> None:
    bpy.ops.sacha.export_splats(filepath=str(tmp_path / "frames"), frames="1:3")
    files = sorted((tmp_path / "frames").iterdir())
    assert [file.name for file in files] == ["00001.ply", "00002.ply"]
    header = files[0].read_bytes().partition(b"end_header")[0].decode()
    assert f"element vertex {material.truth['count'].sum()}" in header
    assert header.count("property float") == 62
    with pytest.raises(RuntimeError, match="--frames"):
        bpy.ops.sacha.export_splats(filepath=str(tmp_path / "none"), frames="77")


def test_splats_leave_as_the_head_stands(opened: bpy.types.Object, tmp_path: Path) -> None:
    bpy.ops.sacha.show_splats()
    made = next(other for other in bpy.data.objects if other.sacha_splats.head == opened)
    bpy.context.scene.frame_set(bpy.context.scene.frame_current + 2)  # the nodes follow: what they show is what leaves
    points = made.evaluated_get(bpy.context.evaluated_depsgraph_get()).data
    shown = positions(points)[: len(made.data.vertices)]
    bpy.ops.sacha.export_splats(filepath=str(tmp_path / "now.ply"), pose="SCENE")
    header, _, body = (tmp_path / "now.ply").read_bytes().partition(b"end_header\n")
    rows = np.frombuffer(body, "<f4").reshape(len(shown), -1)
    assert header.startswith(b"ply")
    assert np.abs(np.stack([rows[:, 0], -rows[:, 2], rows[:, 1]], axis=1) - shown).max() <= PLACE_ERROR_M


@pytest.mark.parametrize("content", ["HEAD", "SPLATS"])
def test_gltf_leaves_whole(opened: bpy.types.Object, content: str, tmp_path: Path) -> None:
    target, painted = tmp_path / "a.glb", tmp_path / "map.png"
    bpy.ops.sacha.bake_heat_map(filepath=str(painted), size=SIZE)
    bpy.ops.sacha.export_gltf(filepath=str(target), content=content, texture=str(painted))
    magic, version, length, json_length = struct.unpack("<4sIII", target.read_bytes()[:16])
    assert (magic, version, length) == (b"glTF", 2, target.stat().st_size)
    told = json.loads(target.read_bytes()[20 : 20 + json_length])
    primitive = told["meshes"][0]["primitives"][0]
    splats = "KHR_gaussian_splatting" in primitive.get("extensions", {})
    assert splats == (content == "SPLATS")
    assert (painted.read_bytes() in target.read_bytes()) == (content == "HEAD")  # the baked map travels along


def test_the_menu_of_exports_offers_them(addon: ModuleType) -> None:
    module = __import__(f"{addon.__name__}.looking.menu", fromlist=["attach"])
    offered = []
    layout = SimpleNamespace(operator=lambda name, text: offered.append(name))  # noqa: ARG005
    module._export_entries(SimpleNamespace(layout=layout), bpy.context)
    assert offered == ["sacha.export_splats", "sacha.export_gltf", "sacha.bake_heat_map"]


def test_panels_draw_what_layouts_take(opened: bpy.types.Object) -> None:
    from test_panels import drawn_by, operators  # noqa: PLC0415

    look, preview = bpy.types.SACHA_PT_look, bpy.types.SACHA_PT_preview
    assert look.poll(bpy.context)
    assert operators(drawn_by(look)) == [
        *("sacha.show_splats", "sacha.export_splats", "sacha.export_gltf", "sacha.bake_heat_map")
    ]
    assert operators(drawn_by(preview)) == ["sacha.render_preview"]
    bpy.ops.sacha.show_splats()
    next(other for other in bpy.data.objects if other.sacha_splats.head == opened).sacha_splats.soft = True
    assert operators(drawn_by(look))[:2] == ["sacha.update_splats", "sacha.remove_splats"]
