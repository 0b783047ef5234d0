"""Opening files: the mesh that Blender holds against what the engine's own functions say, number by number."""

from __future__ import annotations

import re
from pathlib import Path
from types import ModuleType

import bpy
import numpy as np
import pytest
from conftest import Material, corner_colours, face_attribute, in_blenders_axes, positions, triangles

COLOUR_ERROR = 1e-6  # the test decodes sRGB in double precision, the engine stores float32
POSITION_ERROR_M = 1e-7  # an OBJ holds nine decimal digits, which bring back every float32 but for its last bit


def srgb_decoded(srgb: np.ndarray) -> np.ndarray:
    """IEC 61966-2-1, value by value."""
    return np.array(
        [[c / 12.92 if c <= 0.04045 else ((c + 0.055) / 1.055) ** 2.4 for c in row] for row in srgb / 255.0]
    )


@pytest.fixture
def fresh(addon: ModuleType, material: Material) -> bpy.types.Object:
    """The avatar opened just now; `opened`, which other tests use, comes from a .blend that was saved after the same."""
    bpy.ops.sacha.open(filepath=str(material.folder / "avatar.sacha"))
    return bpy.context.object


def kept_of(mesh: bpy.types.Mesh) -> list:
    """Everything that opening leaves with a mesh."""
    shown = mesh.sacha
    annotated = type(shown.regions[0]).__annotations__  # what a row is declared to hold
    numbers = [name for name in annotated if name not in {"kept", "colour"}]
    rows = [(tuple(row.colour), *(getattr(row, name) for name in numbers)) for row in shown.regions]
    views = [
        (view.name, view.label, view.palette, [(line.name, tuple(line.colour)) for line in view.legend])
        for view in shown.views
    ]
    texts = [shown.source, shown.kind, shown.head, shown.scheme, shown.view, shown.by, shown.n_faces, shown.columns]
    return [
        texts,
        views,
        rows,
        [fact.name for fact in shown.facts],
        [number.value for view in shown.views for number in view.by_region],
    ]


def test_a_blend_keeps_all_that_was_opened(fresh: bpy.types.Object, opened_blend: Path) -> None:
    def arrays(mesh: bpy.types.Mesh) -> list[np.ndarray]:
        whole = [face_attribute(mesh, name) for name in ("region", "count", "region_level", "count_level")]
        return [*whole, corner_colours(mesh, "sacha_colour"), positions(mesh), triangles(mesh)]

    opened, said = arrays(fresh.data), kept_of(fresh.data)
    bpy.ops.wm.open_mainfile(filepath=str(opened_blend))
    kept = bpy.context.object.data
    assert all(np.array_equal(one, other) for one, other in zip(opened, arrays(kept), strict=True))
    assert kept_of(kept) == said


def test_an_avatar_has_its_persons_shape_and_the_heads_triangles(opened: bpy.types.Object, material: Material) -> None:
    assert np.array_equal(triangles(opened.data), material.truth["faces"])
    assert np.array_equal(positions(opened.data), in_blenders_axes(material.truth["vertices"]))
    assert opened.data.sacha.kind == "avatar"
    assert opened.data.sacha.source == str(material.folder / "avatar.sacha")


def test_regions_and_counts_are_the_engines_own(opened: bpy.types.Object, material: Material) -> None:
    assert np.array_equal(face_attribute(opened.data, "region"), material.truth["labels"])
    count = face_attribute(opened.data, "count")
    assert np.array_equal(count, material.truth["count"])
    assert count.min() == 0  # a triangle that carries nothing is in the material, and stays in the mesh
    assert count.max() > 10


def test_region_colours_are_the_schemes(opened: bpy.types.Object, material: Material) -> None:
    colours = corner_colours(opened.data, "sacha_colour")
    assert (colours == colours[:, :1]).all()  # hard edges: the three corners of a triangle agree
    expected = srgb_decoded(material.truth["region_srgb"])[material.truth["labels"]]
    assert np.abs(colours[:, 0, :3] - expected).max() <= COLOUR_ERROR
    assert (colours[..., 3] == 1).all()


def test_count_colours_darken_as_counts_grow(opened: bpy.types.Object) -> None:
    count = face_attribute(opened.data, "count")
    opened.data.sacha.view = "COUNT"
    colours = corner_colours(opened.data, "sacha_colour")[:, 0, :3]
    of_count = {int(n): colours[count == n] for n in np.unique(count)}
    assert all((same == same[0]).all() for same in of_count.values())
    light = [
        0.2126 * same[0, 0] + 0.7152 * same[0, 1] + 0.0722 * same[0, 2] for n, same in sorted(of_count.items()) if n
    ]
    assert (np.diff(light) < 0).all()


def test_the_table_says_what_the_triangles_say(opened: bpy.types.Object, material: Material) -> None:
    rows = opened.data.sacha.regions
    assert [row.name for row in rows] == material.told["regions"]
    assert [row.gaussians for row in rows] == material.told["gaussians"]
    assert [row.triangles for row in rows] == np.bincount(material.truth["labels"], minlength=len(rows)).tolist()
    assert sum(row.gaussians for row in rows) == material.truth["count"].sum()
    counts = [line.name for line in opened.data.sacha.views["count"].legend]
    assert (counts[0], counts[-1]) == ("0", str(material.truth["count"].max()))


def test_a_ply_of_bound_gaussians_opens_like_the_avatar(addon: ModuleType, material: Material) -> None:
    bpy.ops.sacha.open(filepath=str(material.folder / "avatar.ply"), head=str(material.folder / "head.npz"))
    mesh = bpy.context.object.data
    assert mesh.sacha.kind == "avatar"
    assert np.array_equal(face_attribute(mesh, "count"), material.truth["ply_count"])


def test_a_head_model_opens_with_regions_and_texture_coordinates(addon: ModuleType, material: Material) -> None:
    bpy.ops.sacha.open(filepath=str(material.folder / "head.npz"))
    mesh = bpy.context.object.data
    assert mesh.sacha.kind == "head"
    assert np.array_equal(positions(mesh), in_blenders_axes(material.truth["template"]))
    assert np.array_equal(face_attribute(mesh, "region"), material.truth["labels"])
    assert "count" not in mesh.attributes
    uv = np.empty(6 * len(mesh.polygons), np.float32)
    mesh.uv_layers.active.uv.foreach_get("vector", uv)
    assert np.array_equal(uv.reshape(-1, 3, 2), material.truth["uv"])


@pytest.mark.parametrize("name", ["head.obj", "head.ply"])
def test_a_mesh_of_the_heads_topology_gets_its_regions(addon: ModuleType, material: Material, name: str) -> None:
    bpy.context.scene.sacha.head = str(material.folder / "head.npz")
    bpy.ops.sacha.open(filepath=str(material.folder / name))
    mesh = bpy.context.object.data
    n_faces = len(mesh.polygons)
    assert n_faces == (len(material.truth["faces"]) if name == "head.obj" else material.truth["n_skin"])
    assert np.array_equal(triangles(mesh), material.truth["faces"][:n_faces])  # texture seams split no vertex
    error = np.abs(positions(mesh) - in_blenders_axes(material.truth["mesh_vertices"])).max()
    assert error <= POSITION_ERROR_M
    assert np.array_equal(face_attribute(mesh, "region"), material.truth["labels"][:n_faces])


def test_a_mesh_without_a_head_opens_and_says_what_it_lacks(addon: ModuleType, material: Material) -> None:
    bpy.ops.sacha.open(filepath=str(material.folder / "head.obj"))
    mesh = bpy.context.object.data
    assert len(mesh.polygons) == len(material.truth["faces"])
    assert not mesh.sacha.views
    assert "region" not in mesh.attributes


def test_undo_takes_the_mesh_away_again(addon: ModuleType, material: Material) -> None:
    bpy.ops.ed.undo_push(message="before")
    bpy.ops.sacha.open(filepath=str(material.folder / "avatar.sacha"))
    name = bpy.context.object.name
    bpy.ops.ed.undo_push(message="after")
    bpy.ops.ed.undo()
    assert name not in bpy.data.objects


def test_long_and_foreign_file_names_open(addon: ModuleType, material: Material, tmp_path: Path) -> None:
    path = tmp_path / ("köpfe und 頭 " + "x" * 100 + ".sacha")
    path.write_bytes((material.folder / "avatar.sacha").read_bytes())
    bpy.ops.sacha.open(filepath=str(path))
    assert bpy.context.object.data.sacha.source == str(path)
    assert np.array_equal(face_attribute(bpy.context.object.data, "count"), material.truth["count"])


def test_two_avatars_lie_side_by_side_in_the_scene(opened: bpy.types.Object, material: Material) -> None:
    bpy.ops.sacha.open(filepath=str(material.folder / "avatar.sacha"))
    second = bpy.context.object
    assert second != opened
    assert second.data != opened.data
    before = corner_colours(opened.data, "sacha_colour")
    second.data.sacha.view = "COUNT"
    assert opened.data.sacha.view == "REGION"
    assert np.array_equal(corner_colours(opened.data, "sacha_colour"), before)
    assert not np.array_equal(corner_colours(second.data, "sacha_colour"), before)


BROKEN = {
    "garbage.sacha": b"\x00garbage\xff" * 50,
    "garbage.npz": b"PK\x03\x04 nothing",
    "outside.obj": b"v 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 4\n",
}


@pytest.mark.parametrize("name", BROKEN)
def test_a_broken_file_is_one_clear_line_and_changes_nothing(addon: ModuleType, tmp_path: Path, name: str) -> None:
    path = tmp_path / name
    path.write_bytes(BROKEN[name])
    before = sorted(bpy.data.meshes.keys())
    with pytest.raises(RuntimeError, match=re.escape(name)) as said:
        bpy.ops.sacha.open(filepath=str(path))
    assert len(str(said.value).strip().splitlines()) == 1
    assert sorted(bpy.data.meshes.keys()) == before
    assert not bpy.data.objects


def test_a_cut_avatar_is_refused(addon: ModuleType, material: Material, tmp_path: Path) -> None:
    whole = (material.folder / "avatar.sacha").read_bytes()
    path = tmp_path / "cut.sacha"
    path.write_bytes(whole[: len(whole) * 2 // 3])
    with pytest.raises(RuntimeError, match=r"cut\.sacha: .*get it again"):
        bpy.ops.sacha.open(filepath=str(path))


def test_a_missing_file_and_a_missing_head_are_named(addon: ModuleType, material: Material) -> None:
    with pytest.raises(RuntimeError, match=r"/nowhere/at-all\.sacha"):
        bpy.ops.sacha.open(filepath="/nowhere/at-all.sacha")
    with pytest.raises(RuntimeError, match=r"/nowhere/head\.npz"):
        bpy.ops.sacha.open(filepath=str(material.folder / "avatar.ply"), head="/nowhere/head.npz")


def test_an_avatar_whose_head_is_unknown_names_it_and_opens_once_it_is_given(
    addon: ModuleType, material: Material
) -> None:
    avatar, head = str(material.folder / "stranger.sacha"), str(material.folder / "stranger.npz")
    with pytest.raises(RuntimeError, match=r"'a stranger'.*Choose its head model under Head"):
        bpy.ops.sacha.open(filepath=avatar)
    with pytest.raises(RuntimeError, match="is not the head that the avatar is bound to"):
        bpy.ops.sacha.open(filepath=avatar, head=str(material.folder / "head.npz"))
    bpy.ops.sacha.open(filepath=avatar, head=head)
    assert bpy.context.object.data.sacha.head == "a stranger"


def test_another_heads_mesh_is_refused(addon: ModuleType, material: Material, tmp_path: Path) -> None:
    lines = (material.folder / "head.obj").read_text().splitlines()
    faces = [i for i, line in enumerate(lines) if line.startswith("f ")]
    lines[faces[0]], lines[faces[1]] = (
        lines[faces[1]],
        lines[faces[0]],
    )  # same surface, other order: bindings would be wrong
    (tmp_path / "other.obj").write_text("\n".join(lines))
    with pytest.raises(RuntimeError, match="does not have those of head"):
        bpy.ops.sacha.open(filepath=str(tmp_path / "other.obj"), head=str(material.folder / "head.npz"))
