"""Steering the budget: the file is what was asked for, the mesh shows what is in it, and undo, save and duplicates keep it true."""

from __future__ import annotations

import shutil
from pathlib import Path
from types import ModuleType

import bpy
import numpy as np
import pytest
from conftest import ENGINE, Material, face_attribute, positions
from test_panels import drawn_by, operators, texts

VIEWS = 16  # the fewest that scores are made from
TARGET_KB = 20.0  # so little that every region has to give


@pytest.fixture(scope="session")
def steered_blend(installed: str, material: Material, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A .blend of a copy of the material's avatar, since its scores will come to lie beside it."""
    folder = tmp_path_factory.mktemp("steered")
    shutil.copy(material.folder / "avatar.sacha", folder / "a.sacha")
    shutil.copy(material.folder / "head.npz", folder / "head.npz")
    bpy.ops.wm.read_homefile(use_empty=True)
    bpy.context.preferences.addons[installed].preferences.engine_python = ENGINE
    bpy.context.scene.sacha.head = str(folder / "head.npz")
    bpy.ops.sacha.open(filepath=str(folder / "a.sacha"))
    asked = bpy.context.object.data.sacha_steering
    asked.views, asked.measure = VIEWS, False
    asked.limit, asked.keep = "SHARE", 40.0
    bpy.context.scene.sacha.level = 1
    path = folder / "a.blend"
    bpy.ops.wm.save_as_mainfile(filepath=str(path), check_existing=False)
    return path


@pytest.fixture(scope="session")
def applied_blend(steered_blend: Path) -> Path:
    """The same after one Apply that kept 40 % with neutral weights."""
    bpy.ops.wm.open_mainfile(filepath=str(steered_blend))
    bpy.ops.sacha.apply_budget()
    path = steered_blend.with_name("applied.blend")
    bpy.ops.wm.save_as_mainfile(filepath=str(path), check_existing=False)
    return path


@pytest.fixture
def avatar(addon: ModuleType, steered_blend: Path) -> bpy.types.Object:
    """The avatar as the active object, with a budget of 40 %."""
    bpy.ops.wm.open_mainfile(filepath=str(steered_blend))
    return bpy.context.object


@pytest.fixture
def applied(addon: ModuleType, applied_blend: Path) -> bpy.types.Object:
    """The avatar after an Apply, as it was saved."""
    bpy.ops.wm.open_mainfile(filepath=str(applied_blend))
    return bpy.context.object


def regions(shown: bpy.types.Object) -> dict[str, int]:
    """Give the Gaussians of each region that the mesh shows."""
    return {row.name: row.gaussians for row in shown.data.sacha.regions}


def consistent(shown: bpy.types.Object) -> None:
    """Check that table, attributes and outcome tell of the same Gaussians."""
    mesh = shown.data
    count, labels = face_attribute(mesh, "count"), face_attribute(mesh, "region")
    of = np.bincount(labels, count, len(mesh.sacha.regions)).astype(int)
    assert [row.gaussians for row in mesh.sacha.regions] == of.tolist()
    if len(mesh.sacha_steering.outcome):
        assert [row.after for row in mesh.sacha_steering.outcome] == of.tolist()
        assert Path(mesh.sacha.source).stat().st_size == mesh.sacha_steering.bytes_after


def test_every_region_has_a_row_from_the_start(avatar: bpy.types.Object, material: Material) -> None:
    assert avatar.data.sacha_steering.regions.keys() == material.told["regions"]
    avatar.data.sacha_steering.regions["nose"].weight = 3
    bpy.ops.sacha.list_regions()
    assert avatar.data.sacha_steering.regions["nose"].weight == 3


def test_the_mouth_keeps_more_where_it_weighs_more_and_the_file_meets_its_size(
    avatar: bpy.types.Object, tmp_path: Path
) -> None:
    origin, before, vertices = avatar.data.sacha.source, regions(avatar), positions(avatar.data)
    kept, avatar.data.sacha_steering.measure = [], True
    for name, weights in (("neutral", ""), ("mouth", "mouth=2")):
        path = tmp_path / f"{name}.sacha"
        bpy.ops.sacha.apply_budget(filepath=str(path), target_kb=TARGET_KB, weights=weights)
        assert 0.9 * 1000 * TARGET_KB < path.stat().st_size <= 1000 * TARGET_KB
        assert (avatar.data.sacha.source, avatar.data.sacha_steering.origin) == (str(path), origin)
        consistent(avatar)
        kept.append(regions(avatar))
        rows = avatar.data.sacha_steering.outcome
        assert all(row.known_before == (name == "mouth") and row.known_after for row in rows if row.after)
        if name == "neutral":
            spent = [row.n_bytes for row in avatar.data.sacha.regions]
            assert 0 < sum(spent) < path.stat().st_size
    assert kept[0]["mouth"] < kept[1]["mouth"] <= before["mouth"]
    rows = avatar.data.sacha_steering.outcome
    assert {row.name: row.before for row in rows} == kept[0]
    table = avatar.data.sacha.regions
    assert {row.name: row.before for row in table} == kept[0]
    assert [row.before_bytes for row in table] == spent
    assert rows["mouth"].psnr_after_db > rows["mouth"].psnr_before_db
    assert np.array_equal(positions(avatar.data), vertices)
    assert avatar.data.sacha.view == "REGION"
    assert (Path(origin).parent / "a.scores.npz").is_file()


def test_undo_brings_back_what_was_shown_and_redo_what_came_of_it(avatar: bpy.types.Object) -> None:
    name, before, source = avatar.name, regions(avatar), avatar.data.sacha.source
    bpy.ops.ed.undo_push(message="opened")
    bpy.ops.sacha.apply_budget()
    after, result = regions(avatar), avatar.data.sacha.source
    assert sum(after.values()) < sum(before.values())
    assert Path(result).parent == Path(source).parent
    bpy.ops.ed.undo_push(message="applied")
    bpy.ops.ed.undo()
    shown = bpy.data.objects[name]
    assert (regions(shown), shown.data.sacha.source) == (before, source)
    assert not len(shown.data.sacha_steering.outcome)
    consistent(shown)
    bpy.ops.ed.redo()
    shown = bpy.data.objects[name]
    assert (regions(shown), shown.data.sacha.source) == (after, result)
    consistent(shown)


def test_locks_and_shares_hold_and_a_second_apply_begins_from_the_origin(
    applied: bpy.types.Object, material: Material
) -> None:
    asked, now = applied.data.sacha_steering, regions(applied)
    whole = dict(zip(material.told["regions"], material.told["gaussians"], strict=True))
    asked.regions["ears"].locked = True
    asked.regions["nose"].highest_share = 1
    asked.keep = 70.0
    bpy.ops.sacha.apply_budget()
    after, total = regions(applied), sum(whole.values())
    assert after["ears"] == now["ears"]  # as many as it had, though more is kept elsewhere
    assert sum(after.values()) == total - int(np.floor(0.3 * total + 1e-9)) > sum(now.values())
    assert after["nose"] <= 0.01 * sum(after.values())
    assert now["face"] < after["face"] <= whole["face"]
    assert {row.name: row.before for row in asked.outcome} == now
    consistent(applied)


@pytest.mark.parametrize("by", ["GROUP", "COLOUR"])
def test_what_is_painted_keeps_more(applied: bpy.types.Object, by: str) -> None:
    mesh, plain = applied.data, regions(applied)
    chosen = face_attribute(mesh, "region") == mesh.sacha.regions.find("scalp")
    corners = np.empty(len(mesh.loops), np.int32)
    mesh.loops.foreach_get("vertex_index", corners)
    if by == "GROUP":
        applied.vertex_groups.new(name="painted").add(np.unique(corners[np.repeat(chosen, 3)]).tolist(), 1.0, "REPLACE")
    else:
        colours = mesh.color_attributes.new("painted", "BYTE_COLOR", "CORNER")
        colours.data.foreach_set("color", np.repeat(np.where(chosen, 1.0, 0.0), 12).astype(np.float32))
    asked = mesh.sacha_steering
    asked.paint_by, asked.paint, asked.paint_strength = by, "painted", 50.0
    bpy.ops.sacha.apply_budget()
    assert regions(applied)["scalp"] > plain["scalp"]
    assert sum(regions(applied).values()) == sum(plain.values())
    consistent(applied)


def test_face_sets_become_regions_that_can_be_weighed_and_saved(avatar: bpy.types.Object, tmp_path: Path) -> None:
    mesh = avatar.data
    sets = mesh.attributes.new(".sculpt_face_set", "INT", "FACE")
    odd = np.arange(len(mesh.polygons)) % 2
    sets.data.foreach_set("value", (7 + odd).astype(np.int32))
    bpy.ops.sacha.regions_from(kind="FACE_SETS")
    assert mesh.sacha.regions.keys() == mesh.sacha_steering.regions.keys() == ["set 7", "set 8"]
    assert np.array_equal(face_attribute(mesh, "region"), odd)
    consistent(avatar)
    mesh.sacha_steering.regions["set 8"].weight = 100
    bpy.ops.sacha.apply_budget()
    assert regions(avatar)["set 8"] > 1.2 * regions(avatar)["set 7"]
    consistent(avatar)
    bpy.ops.sacha.save_regions(filepath=str(tmp_path / "mine.scheme.npz"))
    with np.load(tmp_path / "mine.scheme.npz") as saved:
        assert saved["regions"].tolist() == ["set 7", "set 8"]
        assert np.array_equal(saved["labels"], odd)
    for read in (bpy.ops.sacha.refresh, lambda: bpy.ops.sacha.compare(filepath=mesh.sacha.source)):
        read()
        assert mesh.sacha.regions.keys() == mesh.sacha_steering.regions.keys() == ["set 7", "set 8"]
        assert mesh.sacha_steering.regions["set 8"].weight == 100
        assert np.array_equal(face_attribute(mesh, "region"), odd)
    consistent(avatar)
    bpy.ops.sacha.regions_from(kind="AVATAR")
    assert "mouth" in mesh.sacha_steering.regions
    assert not mesh.sacha_steering.custom


def test_the_joints_of_a_head_stand_for_its_avatar(avatar: bpy.types.Object, tmp_path: Path) -> None:
    panels = bpy.types.SACHA_PT_budget, bpy.types.SACHA_PT_look, bpy.types.SACHA_PT_files
    as_mesh = [texts(drawn_by(panel)) for panel in panels]
    bpy.context.view_layer.objects.active = avatar.parent
    assert bpy.types.SACHA_PT_budget.poll(bpy.context)
    assert [texts(drawn_by(panel)) for panel in panels] == as_mesh
    assert bpy.ops.sacha.list_regions() == {"FINISHED"}
    assert bpy.ops.sacha.encode(filepath=str(tmp_path / "a.sacha")) == {"FINISHED"}
    assert (tmp_path / "a.sacha").exists()
    bpy.ops.sacha.apply_budget(filepath=str(tmp_path / "b.sacha"))
    consistent(avatar)
    assert bpy.types.SACHA_PT_outcome.poll(bpy.context)
    assert texts(drawn_by(bpy.types.SACHA_PT_outcome))


def test_materials_become_regions_in_their_colours(avatar: bpy.types.Object) -> None:
    mesh = avatar.data
    for name, colour in (("Skin", (0.2, 0.4, 0.6, 1)), ("-Front=1", (1, 0, 0, 1)), ("unused", (0, 0, 0, 1))):
        material = bpy.data.materials.new(name)
        material.diffuse_color = colour
        mesh.materials.append(material)
    mesh.polygons.foreach_set("material_index", (np.arange(len(mesh.polygons)) < 100).astype(np.int32))
    bpy.ops.sacha.regions_from(kind="MATERIALS")
    assert mesh.sacha.regions.keys() == ["Skin", "Front_1"]
    assert mesh.sacha.regions["Skin"].colour[:] == pytest.approx((0.2, 0.4, 0.6), abs=0.004)  # as bytes have it
    assert mesh.sacha.regions["Front_1"].triangles == 100


def test_it_is_kept_with_the_file_and_shared_by_linked_duplicates(applied: bpy.types.Object) -> None:
    twin = applied.copy()
    bpy.context.collection.objects.link(twin)
    assert regions(twin) == regions(applied)
    assert sum(regions(twin).values()) == sum(row.after for row in twin.data.sacha_steering.outcome) > 0
    assert Path(twin.data.sacha.source) != Path(twin.data.sacha_steering.origin)
    consistent(twin)


def test_what_cannot_be_done_is_said_in_a_sentence_and_changes_nothing(
    avatar: bpy.types.Object, tmp_path: Path
) -> None:
    mesh, asked, before = avatar.data, avatar.data.sacha_steering, regions(avatar)
    target = str(tmp_path / "x.sacha")

    def refused(message: str, **options: object) -> None:
        with pytest.raises(RuntimeError, match=message):
            bpy.ops.sacha.apply_budget(filepath=target, **options)

    refused("No region 'tail'; there are mouth", weights="tail=2")
    refused("A weight 'mouth=much', expected such as mouth=2", weights="mouth=much")
    refused("out of reach", target_kb=0.1)
    asked.limit, asked.paint_by, asked.paint = "SHARE", "GROUP", "nobody's"
    refused('no vertex group "nobody\'s"')
    asked.paint_by, asked.regions["nose"].lowest_share, asked.regions["nose"].highest_share = "NOTHING", 20, 10
    refused("nose shall have at least 20 % and at most 10 %")
    with pytest.raises(RuntimeError, match="no face sets"):
        bpy.ops.sacha.regions_from(kind="FACE_SETS")
    with pytest.raises(RuntimeError, match="no materials"):
        bpy.ops.sacha.regions_from(kind="MATERIALS")
    assert regions(avatar) == before
    bpy.ops.object.mode_set(mode="EDIT")
    refused("is in Edit Mode")
    bpy.ops.mesh.select_all(action="DESELECT")
    bpy.ops.object.mode_set(mode="OBJECT")
    mesh.polygons[0].select = True
    bpy.ops.object.mode_set(mode="EDIT")
    bpy.ops.mesh.delete(type="FACE")
    bpy.ops.object.mode_set(mode="OBJECT")
    refused("faces now and had")
    bpy.context.view_layer.objects.active = None
    refused("No avatar: open one")
    assert not list(tmp_path.iterdir())


def test_the_panels_draw_what_is_asked_and_what_came_of_it(
    avatar: bpy.types.Object, request: pytest.FixtureRequest
) -> None:
    budget, outcome = bpy.types.SACHA_PT_budget, bpy.types.SACHA_PT_outcome
    assert budget.poll(bpy.context)
    assert not outcome.poll(bpy.context)
    asked = avatar.data.sacha_steering
    for asked.limit, asked.paint_by in (("SIZE", "GROUP"), ("SHARE", "COLOUR")):
        assert "sacha.apply_budget" in operators(drawn_by(budget))
    asked.regions.clear()
    assert "sacha.list_regions" in operators(drawn_by(budget))
    asked = request.getfixturevalue("applied").data.sacha_steering
    assert outcome.poll(bpy.context)
    shown = texts(drawn_by(outcome))
    bytes_told = f"Bytes: was {asked.bytes_before:,}, is {asked.bytes_after:,}"
    assert {"mouth", f"{asked.outcome['mouth'].after:,}", bytes_told} <= set(shown)
    assert "dB was" not in shown
    for row in asked.outcome:
        row.known_after, row.psnr_after_db = row.after > 0, 40.0
    shown, known = texts(drawn_by(outcome)), sum(row.known_after for row in asked.outcome)
    assert 0 < known == shown.count("same")  # what was is what decibels are told against
    assert "dB was" in shown
    assert "against the avatar as it was opened" in " ".join(shown)
    for row in asked.outcome:
        row.known_before, row.psnr_before_db = row.known_after, 12.345
    shown = texts(drawn_by(outcome))
    assert (shown.count("same"), shown.count("12.3")) == (0, known)
