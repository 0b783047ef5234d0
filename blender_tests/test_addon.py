"""The add-on as Blender sees it: registered, unregistered, described the same way everywhere, and plain about what is missing."""

from __future__ import annotations

import ast
import tomllib
from pathlib import Path
from types import ModuleType

import bpy
import pytest

ROOT = Path(__file__).parents[1]
OPERATORS = ("open", "encode", "decode", "check_engine", "cancel")


def our_types() -> set[str]:
    return {name for name in dir(bpy.types) if name.lower().startswith("sacha")}


def declared_bl_info() -> dict:
    """Read `bl_info` as Blender does, from the source: of an installed extension Blender takes it away."""
    module = ast.parse((ROOT / "addon" / "__init__.py").read_text())
    assigned = {node.targets[0].id: node.value for node in module.body if isinstance(node, ast.Assign)}
    return ast.literal_eval(assigned["bl_info"])


def test_every_operator_and_setting_is_there(addon: ModuleType) -> None:
    assert {f"SACHA_OT_{name}" for name in OPERATORS} <= our_types()
    for name in OPERATORS:
        assert getattr(bpy.ops.sacha, name).get_rna_type().description.strip()
    assert bpy.context.scene.sacha.level == 2
    assert bpy.data.meshes.new("empty").sacha.kind == ""


def test_the_file_opened_last_is_not_opened_again_unasked(addon: ModuleType) -> None:
    properties = bpy.ops.sacha.open.get_rna_type().properties
    assert all(properties[name].is_skip_save for name in ("filepath", "head", "wait"))


def test_unregister_takes_everything_away_and_register_brings_it_back(addon: ModuleType) -> None:
    before = our_types()
    addon.unregister()
    try:
        assert not our_types()
        assert not hasattr(bpy.types.Scene, "sacha")
        assert not hasattr(bpy.types.Mesh, "sacha")
    finally:
        addon.register()
    assert our_types() == before


def test_disabling_and_enabling_in_the_preferences_works(addon: ModuleType, preferences) -> None:
    import addon_utils  # noqa: PLC0415  (exists only inside Blender)

    addon_utils.disable(addon.__name__)
    assert not our_types()
    assert addon_utils.enable(addon.__name__) is not None
    assert {f"SACHA_OT_{name}" for name in OPERATORS} <= our_types()


def test_one_version_and_one_minimum_everywhere(addon: ModuleType) -> None:
    manifest = tomllib.loads((ROOT / "addon" / "blender_manifest.toml").read_text())
    project = tomllib.loads((ROOT / "pyproject.toml").read_text())["project"]
    bl_info = declared_bl_info()
    assert ".".join(map(str, bl_info["version"])) == manifest["version"] == project["version"]
    assert ".".join(map(str, bl_info["blender"])) == manifest["blender_version_min"]
    assert "blender_version_max" not in manifest


def test_without_an_engine_the_message_says_where_to_name_one(preferences, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.delenv("SACHA_ENGINE", raising=False)
    preferences.engine_python = ""
    with pytest.raises(RuntimeError, match="No SACHA engine: name the Python that has it in the add-on's preferences"):
        bpy.ops.sacha.open(filepath="/any.sacha")
    preferences.engine_python = "/nowhere/python"
    with pytest.raises(RuntimeError, match="No SACHA engine at /nowhere/python"):
        bpy.ops.sacha.open(filepath="/any.sacha")


def test_a_python_without_the_engine_is_told_from_one_that_fails(preferences) -> None:
    import sys  # noqa: PLC0415

    preferences.engine_python = sys.executable  # Blender's own environment: has Python, has no SACHA
    with pytest.raises(RuntimeError, match="has no SACHA engine: install it there with pip"):
        bpy.ops.sacha.open(filepath="/any.sacha")
    with pytest.raises(RuntimeError, match="without SACHA"):
        bpy.ops.sacha.check_engine()
    assert "without SACHA" in preferences.found


def test_the_check_button_shows_what_it_found(preferences) -> None:
    assert bpy.ops.sacha.check_engine() == {"FINISHED"}
    project = tomllib.loads((ROOT / "pyproject.toml").read_text())["project"]
    assert f"SACHA {project['version']}" in preferences.found
    assert "Python 3." in preferences.found


def test_a_program_that_is_no_python_is_one_line(preferences) -> None:
    preferences.engine_python = "/bin/false"
    with pytest.raises(RuntimeError, match="ended with code 1"):
        bpy.ops.sacha.open(filepath="/any.sacha")


def test_the_time_limit_of_the_preferences_holds(preferences, tmp_path: Path) -> None:
    slow = tmp_path / "slow"
    slow.write_text("#!/bin/sh\nsleep 60\n")
    slow.chmod(0o755)
    preferences.engine_python, preferences.time_limit_s = str(slow), 1.0
    with pytest.raises(RuntimeError, match="longer than 1 s"):
        bpy.ops.sacha.open(filepath="/any.sacha")
