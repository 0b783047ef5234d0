"""Looking at triangles and regions: numbers against the engine's own, the table against sorting, selections against Blender's rules."""

from __future__ import annotations

from pathlib import Path
from types import ModuleType, SimpleNamespace

import bmesh
import bpy
import numpy as np
import pytest
from conftest import Material, corner_colours, face_attribute

COLOURS = "sacha_colour"
SORTED = ("place", "gaussians", "share", "n_bytes", "before", "change", "before_bytes", "bytes_change")


@pytest.fixture(scope="module")
def numbers(material: Material) -> dict[str, np.ndarray]:
    """What the engine says of every triangle, view by view."""
    with np.load(material.folder / "seen.npz") as arrays:
        return {name: arrays[name] for name in arrays.files if not name.endswith(("_triangle", "_region"))}


def part(addon: ModuleType, name: str) -> ModuleType:
    return __import__(f"{addon.__name__}.seeing.{name}", fromlist=[name])


def selected(elements: bpy.types.bpy_prop_collection) -> np.ndarray:
    flags = np.empty(len(elements), bool)
    elements.foreach_get("select", flags)
    return flags


def test_every_number_of_every_triangle_is_the_engines(seen: bpy.types.Object, numbers: dict[str, np.ndarray]) -> None:
    assert {"sensitivity", "modulator", "threshold", "ratio", "bytes", "count_change"} <= numbers.keys()
    assert [view.name for view in seen.data.sacha.views] == list(numbers)
    for name, values in numbers.items():
        kind = "INT" if np.issubdtype(values.dtype, np.integer) else "FLOAT"
        assert np.array_equal(face_attribute(seen.data, name, kind), values, equal_nan=kind == "FLOAT"), name


def test_only_the_shown_view_takes_room_for_colours(seen: bpy.types.Object) -> None:
    for view in seen.data.sacha.views:
        seen.data.sacha.view = view.name.upper()
        assert [attribute.name for attribute in seen.data.color_attributes] == [COLOURS]
        assert seen.data.color_attributes.active_color.name == COLOURS


def test_whole_regions_have_hard_borders_and_one_colour_each(seen: bpy.types.Object) -> None:
    shown = seen.data.sacha
    labels = face_attribute(seen.data, "region")
    shown.view, shown.by = "BYTES", "REGION"
    colours = corner_colours(seen.data, COLOURS)
    assert (colours == colours[:, :1]).all()
    for row, number in zip(shown.regions, shown.views["bytes"].by_region, strict=True):
        of_region = colours[labels == row.place, 0, :3]
        assert np.array_equal(of_region, np.broadcast_to(np.array(number.colour, np.float32), of_region.shape))
    assert [round(number.value) for number in shown.views["count"].by_region] == [
        row.gaussians for row in shown.regions
    ]


def test_a_view_that_is_absent_cannot_be_chosen_and_its_remedy_is_told(opened: bpy.types.Object) -> None:
    with pytest.raises(TypeError, match="THRESHOLD"):
        opened.data.sacha.view = "THRESHOLD"
    assert any("threshold" in line.name and "sacha score" in line.name for line in opened.data.sacha.absent)


def test_the_table_has_now_and_before(seen: bpy.types.Object, numbers: dict[str, np.ndarray]) -> None:
    shown = seen.data.sacha
    labels, n = numbers["region"], len(shown.regions)

    def of_regions(name: str) -> list[int]:
        return np.rint(np.bincount(labels, numbers[name].astype(float), n)).astype(int).tolist()

    assert [row.gaussians for row in shown.regions] == of_regions("count")
    assert [row.change for row in shown.regions] == of_regions("count_change")
    assert all(row.before == row.gaussians - row.change for row in shown.regions)
    assert sum(row.share for row in shown.regions) == pytest.approx(1)
    assert (
        np.abs(np.subtract([row.n_bytes for row in shown.regions], of_regions("bytes"))).max() <= 1
    )  # whole bytes that add up
    assert all(row.bytes_change == row.n_bytes - row.before_bytes for row in shown.regions)
    assert shown.before_name == "other"


@pytest.mark.parametrize("column", SORTED)
def test_the_table_sorts_by_any_column_and_back(addon: ModuleType, seen: bpy.types.Object, column: str) -> None:
    shown, table = seen.data.sacha, part(addon, "table")
    shown.sort_by, shown.sort_down = "place", False
    names = [row.name for row in shown.regions]
    assert bpy.ops.sacha.sort_regions(by="gaussians") == {"FINISHED"}
    for down in (column != "place", column == "place"):
        if column == "gaussians" and down:
            bpy.ops.sacha.sort_regions(by="place")
        bpy.ops.sacha.sort_regions(by=column)
        assert shown.sort_by == column
        assert shown.sort_down == down
        flags, order = bpy.types.SACHA_UL_regions.filter_items(
            SimpleNamespace(filter_name="", bitflag_filter_item=1 << 30), bpy.context, shown, "regions"
        )
        assert flags == [1 << 30] * len(names)
        assert sorted(order) == list(range(len(names)))
        drawn = sorted(range(len(names)), key=order.__getitem__)
        values = [getattr(shown.regions[place], column) for place in drawn]
        assert values == sorted(values, reverse=down)
        assert table.order_of(shown) == order


@pytest.mark.parametrize(
    ("number", "text"),
    [
        (0, "0"),
        (-999, "-999"),
        (1000, "1.0k"),
        (-17_865, "-17.9k"),
        (99_949, "99.9k"),
        (250_000, "250k"),
        (1_234_567, "1.2M"),
    ],
)
def test_numbers_of_the_table_are_short(addon: ModuleType, number: int, text: str) -> None:
    assert part(addon, "table").compact(number) == text


def test_the_table_has_the_columns_of_which_it_has_numbers(
    addon: ModuleType, seen: bpy.types.Object, opened_blend: Path
) -> None:
    table, shown = part(addon, "table"), seen.data.sacha
    assert table.tables_of(shown) == ["NOW", "COUNT", "BYTES"]
    assert table.columns_of(shown) == ["gaussians", "share", "n_bytes"]
    shown.table = "BYTES"
    assert table.columns_of(shown) == ["before_bytes", "n_bytes", "bytes_change"]
    bpy.ops.wm.open_mainfile(filepath=str(opened_blend))
    assert table.tables_of(bpy.context.object.data.sacha) == ["NOW"]


def test_a_narrow_sidebar_has_the_column_that_it_is_sorted_by(addon: ModuleType, seen: bpy.types.Object) -> None:
    table, shown = part(addon, "table"), seen.data.sacha

    def fitting(width: int) -> list[str]:
        preferences = SimpleNamespace(system=SimpleNamespace(ui_scale=2.0))  # of a display that is drawn large
        region = SimpleNamespace(width=2 * width)
        return table.fitting_columns(shown, SimpleNamespace(region=region, preferences=preferences))

    shown.sort_by = "place"
    assert fitting(229) == ["gaussians"]
    shown.sort_by = "n_bytes"
    assert fitting(229) == ["n_bytes"]
    assert fitting(300) == ["gaussians", "n_bytes"]
    assert fitting(400) == ["gaussians", "share", "n_bytes"]


def test_a_swatch_keeps_its_colour(seen: bpy.types.Object) -> None:
    line = seen.data.sacha.views["count"].legend[0]
    before = tuple(line.colour)
    line.colour = (0.1, 0.9, 0.1)
    assert tuple(line.colour) == before == tuple(line.kept)


def test_the_table_keeps_to_names_that_are_typed(seen: bpy.types.Object) -> None:
    typed = SimpleNamespace(filter_name="E", bitflag_filter_item=1)
    flags, _ = bpy.types.SACHA_UL_regions.filter_items(typed, bpy.context, seen.data.sacha, "regions")
    assert flags == [int("e" in row.name) for row in seen.data.sacha.regions]


def test_a_column_without_numbers_is_refused(opened: bpy.types.Object) -> None:
    with pytest.raises(RuntimeError, match="Nothing is known of bytes_change"):
        bpy.ops.sacha.sort_regions(by="bytes_change")


def test_choosing_a_row_selects_the_regions_faces(seen: bpy.types.Object) -> None:
    mesh = seen.data
    labels = face_attribute(mesh, "region")
    corners, edges = np.empty(len(mesh.loops), np.int32), np.empty(len(mesh.loops), np.int32)
    mesh.loops.foreach_get("vertex_index", corners)
    mesh.loops.foreach_get("edge_index", edges)
    for place in (0, 7, 1):
        mesh.sacha.active_region = place
        assert np.array_equal(selected(mesh.polygons), labels == place)
        of_region = np.repeat(labels == place, 3)
        assert set(np.flatnonzero(selected(mesh.vertices))) == set(corners[of_region])
        assert set(np.flatnonzero(selected(mesh.edges))) == set(edges[of_region])
    bpy.ops.sacha.select_region(region="mouth", extend=True)
    assert np.array_equal(selected(mesh.polygons), (labels == 0) | (labels == 1))
    with pytest.raises(RuntimeError, match="No region 'beard'; there are mouth, eyes"):
        bpy.ops.sacha.select_region(region="beard")


def test_regions_are_selected_in_edit_mode_too(seen: bpy.types.Object) -> None:
    labels = face_attribute(seen.data, "region")
    bpy.ops.object.mode_set(mode="EDIT")
    bpy.ops.sacha.select_region(region="nose")
    held = bmesh.from_edit_mesh(seen.data)
    assert [face.index for face in held.faces if face.select] == np.flatnonzero(labels == 2).tolist()
    seen.data.sacha.active_region = 3
    assert [face.index for face in held.faces if face.select] == np.flatnonzero(labels == 3).tolist()
    bpy.ops.object.mode_set(mode="OBJECT")
    assert np.array_equal(selected(seen.data.polygons), labels == 3)


def test_views_change_in_edit_mode(seen: bpy.types.Object) -> None:
    seen.data.sacha.view = "OPACITY"
    expected = corner_colours(seen.data, COLOURS)
    seen.data.sacha.view = "REGION"
    bpy.ops.object.mode_set(mode="EDIT")
    seen.data.sacha.view = "OPACITY"
    bpy.ops.object.mode_set(mode="OBJECT")
    assert np.array_equal(corner_colours(seen.data, COLOURS), expected)


def test_an_edited_mesh_keeps_its_colours_and_says_that_it_was_edited(
    addon: ModuleType, seen: bpy.types.Object
) -> None:
    mesh = seen.data
    seen.data.sacha.view = "COUNT"
    colours, labels = corner_colours(mesh, COLOURS)[:, 0], face_attribute(mesh, "region")
    held = bmesh.new()
    held.from_mesh(mesh)
    held.faces.ensure_lookup_table()
    bmesh.ops.delete(held, geom=[held.faces[i] for i in np.flatnonzero(labels == 5)], context="FACES_ONLY")
    held.to_mesh(mesh)
    held.free()
    left = labels != 5
    assert np.array_equal(face_attribute(mesh, "region"), labels[left])
    mesh.sacha.view = "REGION"
    mesh.sacha.view = "COUNT"
    assert np.array_equal(corner_colours(mesh, COLOURS)[:, 0], colours[left])
    assert f"{len(mesh.polygons):,} faces now" in part(addon, "shown").edited(mesh)
    bpy.ops.sacha.select_region(region="mouth")
    assert np.array_equal(selected(mesh.polygons), labels[left] == 0)
    for command in (bpy.ops.sacha.refresh, lambda: bpy.ops.sacha.compare(filepath="/nowhere.sacha")):
        with pytest.raises(RuntimeError, match="open the file anew instead"):
            command()


def test_faces_of_any_number_of_corners_are_painted(seen: bpy.types.Object) -> None:
    mesh = seen.data
    held = bmesh.new()
    held.from_mesh(mesh)
    held.edges.ensure_lookup_table()
    inner = [edge for edge in held.edges if len(edge.link_faces) == 2][::40]
    bmesh.ops.dissolve_edges(held, edges=inner)
    held.to_mesh(mesh)
    held.free()
    mesh.sacha.view = "COUNT"
    corners = np.empty(len(mesh.polygons), np.int32)
    mesh.polygons.foreach_get("loop_total", corners)
    assert corners.max() > 3
    assert len(mesh.attributes[COLOURS].data) == corners.sum()


def test_reading_again_forgets_what_it_was_compared_with(seen: bpy.types.Object, material: Material) -> None:
    shown = seen.data.sacha
    assert shown.compared == str(material.folder / "other.sacha")
    shown.view = "DENSITY"
    assert bpy.ops.sacha.refresh() == {"FINISHED"}
    assert (shown.compared, shown.view) == ("", "DENSITY")
    assert not [name for name in seen.data.attributes.keys() if "_change" in name]  # noqa: SIM118  (what Blender gives is no dict)
    assert shown.before_name == "when scored"
    assert all(row.change == row.gaussians - row.before for row in shown.regions)


def test_a_comparison_can_be_undone(addon: ModuleType, material: Material) -> None:
    bpy.ops.sacha.open(filepath=str(material.folder / "avatar.sacha"))
    bpy.ops.ed.undo_push(message="opened")
    name = bpy.context.object.data.name
    bpy.ops.sacha.compare(filepath=str(material.folder / "other.sacha"))
    assert bpy.data.meshes[name].sacha.view == "COUNT_CHANGE"
    bpy.ops.ed.undo_push(message="compared")
    bpy.ops.ed.undo()
    mesh = bpy.data.meshes[name]
    assert mesh.sacha.view == "REGION"
    assert "count_change" not in mesh.attributes
    assert mesh.sacha.compared == ""


def test_avatars_of_other_heads_are_not_compared(seen: bpy.types.Object, material: Material, tmp_path: Path) -> None:
    before = [fact.name for fact in seen.data.sacha.facts]
    for path in (material.folder / "head.npz", tmp_path / "nothing.sacha"):
        with pytest.raises(RuntimeError) as said:
            bpy.ops.sacha.compare(filepath=str(path))
        assert len(str(said.value).strip().splitlines()) == 1
    assert [fact.name for fact in seen.data.sacha.facts] == before


def test_numbers_that_somebody_removed_are_missed_and_come_back(addon: ModuleType, seen: bpy.types.Object) -> None:
    mesh, painting = seen.data, part(addon, "painting")
    mesh.sacha.view = "COUNT"
    assert painting.complaint(mesh) == ""
    mesh.attributes.remove(mesh.attributes["opacity_level"])
    mesh.attributes.remove(mesh.attributes[COLOURS])
    mesh.sacha.view = "OPACITY"
    assert "has lost its attribute opacity_level" in painting.complaint(mesh)
    mesh.sacha.by = "REGION"
    assert painting.complaint(mesh) == ""
    assert bpy.ops.sacha.refresh() == {"FINISHED"}
    mesh.sacha.by = "TRIANGLE"
    assert painting.complaint(mesh) == ""
    assert mesh.color_attributes.active_color.name == COLOURS
    mesh.attributes.remove(mesh.attributes["region"])
    bpy.ops.sacha.select_region(region="mouth")  # finds nothing, and says so


def test_linked_duplicates_show_the_same(seen: bpy.types.Object) -> None:
    twin = seen.copy()
    bpy.context.collection.objects.link(twin)
    twin.data.sacha.view = "MODULATOR"
    assert seen.data.sacha.view == "MODULATOR"
    own = seen.copy()
    own.data = seen.data.copy()
    bpy.context.collection.objects.link(own)
    own.data.sacha.view = "RATIO"
    assert seen.data.sacha.view == "MODULATOR"
    assert not np.array_equal(corner_colours(own.data, COLOURS), corner_colours(seen.data, COLOURS))


def test_an_attribute_of_the_users_own_is_not_written_over(
    seen: bpy.types.Object, addon: ModuleType, material: Material
) -> None:
    bpy.ops.sacha.open(filepath=str(material.folder / "head.npz"))
    mesh = bpy.context.object.data
    mesh.attributes.new("count", "FLOAT", "POINT")
    folder = SimpleNamespace(
        name="x", kind="avatar", head=mesh.sacha.head, faces=np.zeros((len(mesh.polygons), 3)), parts={}, facts=[], notes=[],
        absent=[], views=[SimpleNamespace(name="count", values=np.zeros(len(mesh.polygons), np.int32))],
    )  # fmt: skip
    with pytest.raises(ValueError, match="attribute 'count' of another kind"):
        part(addon, "numbers").take(mesh, folder)


def test_the_joints_of_a_head_stand_for_it(seen: bpy.types.Object, material: Material) -> None:
    joints = seen.parent
    assert joints.type == "ARMATURE"
    bpy.context.view_layer.objects.active = joints
    for panel in ("SACHA_PT_shown", "SACHA_PT_regions"):
        assert getattr(bpy.types, panel).poll(bpy.context)
    assert bpy.ops.sacha.select_region(region="eyes") == {"FINISHED"}
    assert np.array_equal(selected(seen.data.polygons), face_attribute(seen.data, "region") == 1)
    assert bpy.ops.sacha.refresh() == {"FINISHED"}
    assert seen.data.sacha.compared == ""
    stranger = bpy.data.objects.new("stranger", bpy.data.armatures.new("stranger"))
    bpy.context.collection.objects.link(stranger)
    bpy.context.view_layer.objects.active = stranger
    assert not bpy.types.SACHA_PT_shown.poll(bpy.context)


def test_measuring_brings_the_views_that_were_absent(addon: ModuleType, material: Material, tmp_path: Path) -> None:
    path = tmp_path / "measured.sacha"
    path.write_bytes((material.folder / "avatar.sacha").read_bytes())
    bpy.ops.sacha.open(filepath=str(path))
    shown = bpy.context.object.data.sacha
    assert "threshold" not in shown.views
    assert bpy.ops.sacha.measure(views=2) == {"FINISHED"}
    assert {"sensitivity", "modulator", "threshold", "ratio"} <= set(shown.views.keys())
    assert not shown.absent
    assert (tmp_path / "measured.scores.npz").is_file()
    shown.view = "THRESHOLD"
    assert len(np.unique(corner_colours(bpy.context.object.data, COLOURS)[:, 0], axis=0)) > 1
