"""The extension as it is installed: what the zip holds, and that nothing of it stays behind in Blender."""

from __future__ import annotations

import ast
import os
import sys
import tomllib
import zipfile
from pathlib import Path, PurePosixPath
from types import ModuleType

import bpy
import pytest
from traces import traces

ROOT = Path(__file__).parents[1]
TIMES = 10
HEAVY = {"numba", "torch", "jaxtyping", "constriction", "trimesh", "tyro", "sacha_core"}


@pytest.fixture(scope="module")
def archive() -> zipfile.ZipFile:
    with zipfile.ZipFile(os.environ["SACHA_EXTENSION"]) as opened:
        yield opened


def test_register_and_unregister_leave_nothing_however_often(addon: ModuleType) -> None:
    registered = traces()
    addon.unregister()
    try:
        bare = traces()
        gone = {kind: registered[kind] - bare[kind] for kind in registered}
        assert {kind for kind, names in gone.items() if names} >= {"types", "classes", "operators", "menu entries"}
        assert {"Scene.sacha", "Mesh.sacha"} <= gone["properties"]
        assert not [name for names in bare.values() for name in names if "sacha" in name.lower()]
        for _ in range(TIMES):
            addon.register()
            addon.unregister()
        assert traces() == bare
    finally:
        addon.register()
    assert traces() == registered


def test_unregister_can_follow_work(addon: ModuleType, opened: bpy.types.Object) -> None:
    addon.unregister()
    try:
        assert not [name for names in traces().values() for name in names if "sacha" in name.lower()]
        assert opened.data.attributes["count"].domain == "FACE"  # what was made is the artist's and stays
    finally:
        addon.register()
    assert opened.data.sacha.kind == "avatar"


def test_the_add_on_brings_nothing_heavy_into_blender(addon: ModuleType) -> None:
    assert not HEAVY & set(sys.modules)


def test_the_zip_is_the_add_on_and_nothing_else(archive: zipfile.ZipFile) -> None:
    packed = {name for name in archive.namelist() if not name.endswith("/")}
    source = ROOT / "addon"
    expected = {
        path.relative_to(source).as_posix()
        for path in source.rglob("*")
        if path.is_file() and path.suffix in {".py", ".toml", ".md", ""} and "__pycache__" not in path.parts
    }
    assert packed == expected
    assert not archive.testzip()
    for name in packed:
        assert not PurePosixPath(name).is_absolute()
        assert ".." not in PurePosixPath(name).parts


def test_the_manifest_says_what_it_asks_for_and_nothing_is_bundled(archive: zipfile.ZipFile) -> None:
    manifest = tomllib.loads(archive.read("blender_manifest.toml").decode())
    assert manifest["type"] == "add-on"
    assert manifest["license"] == ["SPDX:GPL-3.0-or-later"]
    assert set(manifest["permissions"]) == {"files"}
    assert "wheels" not in manifest
    assert "blender_version_max" not in manifest


def test_every_file_names_its_licence_and_parses_where_the_oldest_python_runs(archive: zipfile.ZipFile) -> None:
    for name in archive.namelist():
        if name.endswith(".py"):
            text = archive.read(name).decode()
            assert text.startswith("# SPDX-License-Identifier: GPL-3.0-or-later\n"), name
            ast.parse(text, feature_version=(3, 10))


def test_the_add_on_talks_to_the_network_nowhere(archive: zipfile.ZipFile) -> None:
    forbidden = {"urllib", "http", "socket", "requests", "threading", "concurrent", "asyncio", "multiprocessing"}
    for name in archive.namelist():
        if not name.endswith(".py"):
            continue
        for node in ast.walk(ast.parse(archive.read(name))):
            names = [one.name for one in node.names] if isinstance(node, ast.Import) else []
            if isinstance(node, ast.ImportFrom) and node.level == 0:
                names = [node.module]
            assert not forbidden & {one.split(".")[0] for one in names}, name
