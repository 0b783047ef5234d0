"""What the sidebar draws, held against what Blender's layouts really take: nothing is drawn in background."""

from __future__ import annotations

from types import ModuleType, SimpleNamespace
from typing import Any

import bpy
import pytest
from conftest import Material

DRAWING = bpy.types.UILayout.bl_rna
RETURNED = "properties"  # what `operator` gives back is listed among what it takes
ICONS = {item.identifier for item in DRAWING.functions["label"].parameters["icon"].enum_items}


class Layout:
    """Takes what a layout takes, refuses what it refuses, and remembers it."""

    def __init__(self, drawn: list[tuple[str, dict[str, Any]]] | None = None) -> None:
        object.__setattr__(self, "drawn", [] if drawn is None else drawn)

    def __setattr__(self, name: str, value: object) -> None:
        assert name in DRAWING.properties, f"layouts have no {name}"
        assert not DRAWING.properties[name].is_readonly

    def __getattr__(self, name: str) -> Any:
        function = DRAWING.functions[name]
        order = [parameter.identifier for parameter in function.parameters if not parameter.is_output]

        def draw(*positional: Any, **named: Any) -> Any:
            given = dict(zip(order, positional, strict=False)) | named
            assert set(given) <= set(order), f"{name} takes no {set(given) - set(order)}"
            required = {parameter.identifier for parameter in function.parameters if parameter.is_required} - {RETURNED}
            assert required <= set(given), f"{name} needs {required - set(given)}"
            assert given.get("icon", "NONE") in ICONS
            if name == "prop":
                assert given["property"] in given["data"].bl_rna.properties
            self.drawn.append((name, given))
            if name == "operator":
                area, operator = given["operator"].split(".")
                properties = getattr(getattr(bpy.ops, area), operator).get_rna_type().properties
                return SimpleNamespace(**dict.fromkeys(properties.keys()))
            return Layout(self.drawn)

        return draw


@pytest.fixture
def panels(addon: ModuleType) -> SimpleNamespace:
    kinds = bpy.types
    return SimpleNamespace(
        SachaPanel=kinds.SACHA_PT_main, SachaShownPanel=kinds.SACHA_PT_shown, SachaFilesPanel=kinds.SACHA_PT_files
    )


def drawn_by(panel: type) -> list[tuple[str, dict[str, Any]]]:
    layout = Layout()
    panel.draw(SimpleNamespace(layout=layout), bpy.context)
    return layout.drawn


def texts(drawn: list[tuple[str, dict[str, Any]]]) -> list[str]:
    return [given["text"] for name, given in drawn if name == "label"]


def operators(drawn: list[tuple[str, dict[str, Any]]]) -> list[str]:
    return [given["operator"] for name, given in drawn if name == "operator"]


def test_without_an_engine_only_the_way_to_name_one_is_drawn(panels: SimpleNamespace, preferences, monkeypatch) -> None:
    monkeypatch.delenv("SACHA_ENGINE", raising=False)
    preferences.engine_python = ""
    drawn = drawn_by(panels.SachaPanel)
    assert texts(drawn)[0] == "No SACHA engine"
    assert operators(drawn) == ["preferences.addon_show"]


def test_with_an_engine_a_file_can_be_opened(panels: SimpleNamespace) -> None:
    assert operators(drawn_by(panels.SachaPanel)) == ["sacha.open", "sacha.open_folder"]


def test_a_running_job_shows_its_progress_and_cancel(panels: SimpleNamespace, addon: ModuleType, monkeypatch) -> None:
    running = __import__(f"{addon.__name__}.running", fromlist=["now"])
    told = __import__(f"{addon.__name__}.told", fromlist=["Told"])
    job = SimpleNamespace(said=told.Told("fit", 1, 4, 125.0))
    monkeypatch.setattr(running, "now", lambda: SimpleNamespace(work=SimpleNamespace(title="Opening"), job=job))
    drawn = drawn_by(panels.SachaPanel)
    assert ("progress", {"factor": 0.25, "text": "fit, 2 min 05 s left"}) in drawn
    assert operators(drawn) == ["sacha.cancel"]


def test_the_panels_of_an_avatar_appear_with_one(panels: SimpleNamespace) -> None:
    assert not panels.SachaShownPanel.poll(bpy.context)
    mesh = bpy.data.meshes.new("a stranger")
    bpy.context.collection.objects.link(bpy.data.objects.new("a stranger", mesh))
    bpy.context.view_layer.objects.active = bpy.data.objects["a stranger"]
    assert not panels.SachaShownPanel.poll(bpy.context)


def test_the_legend_is_drawn_line_by_line(
    panels: SimpleNamespace, opened: bpy.types.Object, material: Material
) -> None:
    assert panels.SachaShownPanel.poll(bpy.context)
    drawn = texts(drawn_by(panels.SachaShownPanel))
    assert [text for text in drawn if text in material.told["regions"]] == material.told["regions"]
    opened.data.sacha.view = "COUNT"
    assert str(material.truth["count"].max()) in texts(drawn_by(panels.SachaShownPanel))
    opened.data.sacha.by = "REGION"
    drawn = texts(drawn_by(panels.SachaShownPanel))
    for name, count in zip(material.told["regions"], material.told["gaussians"], strict=True):
        assert drawn[drawn.index(name) + 1] == f"{count:,}"


def test_an_avatar_can_be_compressed_and_a_head_cannot(
    panels: SimpleNamespace, opened: bpy.types.Object, material: Material
) -> None:
    folders = ["sacha.encode_folder", "sacha.decode_folder"]
    assert operators(drawn_by(panels.SachaFilesPanel)) == ["sacha.encode", "sacha.decode", *folders]
    bpy.ops.sacha.open(filepath=str(material.folder / "head.npz"))
    assert operators(drawn_by(panels.SachaFilesPanel)) == folders
    names = [name for name, _ in drawn_by(panels.SachaShownPanel)]
    assert "prop" in names  # the swatches
    assert not [
        given for name, given in drawn_by(panels.SachaShownPanel) if given.get("property") == "view"
    ]  # one view only


def test_the_controls_are_drawn_for_a_head_and_for_its_joints(addon: ModuleType, opened: bpy.types.Object) -> None:
    panel = bpy.types.SACHA_PT_controls
    commands = ["sacha.pose_joints", "sacha.rest", "sacha.load_motion"]
    for active in (opened, opened.parent):
        bpy.context.view_layer.objects.active = active
        assert panel.poll(bpy.context)
        drawn = drawn_by(panel)
        assert operators(drawn) == commands
        assert [given["dataptr"] for name, given in drawn if name == "template_list"] == [opened.data.shape_keys]
    other = bpy.data.objects.new("nobody's", bpy.data.armatures.new("nobody's"))
    bpy.context.collection.objects.link(other)
    bpy.context.view_layer.objects.active = other
    assert not panel.poll(bpy.context)
    assert not bpy.ops.sacha.rest.poll()


def test_the_preferences_draw_what_the_check_found(addon: ModuleType, preferences) -> None:
    module = __import__(f"{addon.__name__}.preferences", fromlist=["SachaPreferences"])
    preferences.found = "Python 3.11"
    layout = Layout()
    shown = SimpleNamespace(layout=layout, found=preferences.found, bl_rna=preferences.bl_rna)
    module.SachaPreferences.draw(shown, bpy.context)
    assert operators(layout.drawn) == ["sacha.check_engine"]
    assert "Python 3.11" in texts(layout.drawn)


def test_the_file_menu_offers_to_open(addon: ModuleType) -> None:
    module = __import__(f"{addon.__name__}.opening.menu", fromlist=["attach"])
    layout = Layout()
    module._import_entry(SimpleNamespace(layout=layout), bpy.context)
    assert operators(layout.drawn) == ["sacha.open", "sacha.open_folder"]
