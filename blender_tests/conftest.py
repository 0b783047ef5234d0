"""A clean Blender with the installed add-on for every test, and material that the engine made."""

from __future__ import annotations

import json
import os
import subprocess
from dataclasses import dataclass
from pathlib import Path
from types import ModuleType

import bpy
import numpy as np
import pytest

ENGINE = os.environ.get("SACHA_ENGINE", str(Path(__file__).parents[1] / ".venv" / "bin" / "python"))
EXTENSION = "bl_ext.user_default.sacha"
MATERIAL_TIME_LIMIT_S = 120


@dataclass(frozen=True)
class Material:
    """What the engine's own functions say, for the add-on to be compared with.

    Args:
        folder: holds avatar.sacha, avatar.ply, head.npz, head.obj, head.ply, and stranger.sacha with stranger.npz.
        truth: arrays of `make_material.py`, which see.
        told: what cannot be said by arrays.
    """

    folder: Path
    truth: dict[str, np.ndarray]
    told: dict


@pytest.fixture(scope="session")
def material(tmp_path_factory: pytest.TempPathFactory) -> Material:
    """Let the engine make a small avatar of the synthetic head."""
    folder = tmp_path_factory.mktemp("material")
    script = Path(__file__).with_name("make_material.py")
    subprocess.run([ENGINE, script, folder], check=True, timeout=MATERIAL_TIME_LIMIT_S, stdin=subprocess.DEVNULL)
    with np.load(folder / "truth.npz") as truth:
        return Material(folder, dict(truth), json.loads((folder / "told.json").read_text()))


@pytest.fixture(scope="session")
def installed() -> str:
    """Install the built extension as a user does, and give its module's name."""
    extension = os.environ.get("SACHA_EXTENSION")
    if extension is None:
        pytest.fail("SACHA_EXTENSION names no built add-on: run `make test-blender`")
    bpy.ops.extensions.package_install_files(filepath=extension, repo="user_default", enable_on_install=True)
    assert EXTENSION in bpy.context.preferences.addons
    return EXTENSION


@pytest.fixture
def preferences(
    installed: str, tmp_path_factory: pytest.TempPathFactory, monkeypatch: pytest.MonkeyPatch
) -> bpy.types.AddonPreferences:
    """The add-on's preferences with the engine named and all else untouched, in an empty scene, before any head was used."""
    monkeypatch.setenv("SACHA_HEADS", str(tmp_path_factory.mktemp("heads")))
    bpy.ops.wm.read_homefile(use_empty=True)
    __import__(f"{installed}.problem", fromlist=["forget"]).forget()
    chosen = bpy.context.preferences.addons[installed].preferences
    chosen.engine_python = ENGINE
    chosen.property_unset("time_limit_s")
    return chosen


@pytest.fixture
def addon(preferences: bpy.types.AddonPreferences) -> ModuleType:
    """The installed add-on's module."""
    return __import__(EXTENSION, fromlist=["bridge"])


@pytest.fixture(scope="session")
def opened_blend(installed: str, material: Material, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A .blend of nothing but the material's avatar, opened from its .sacha file."""
    bpy.ops.wm.read_homefile(use_empty=True)
    bpy.context.preferences.addons[installed].preferences.engine_python = ENGINE
    bpy.ops.sacha.open(filepath=str(material.folder / "avatar.sacha"))
    path = tmp_path_factory.mktemp("opened") / "avatar.blend"
    bpy.ops.wm.save_as_mainfile(filepath=str(path), check_existing=False)
    return path


@pytest.fixture(scope="session")
def seen_blend(installed: str, material: Material, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A .blend of the material's avatar with scores, compared with another one: every view that there can be."""
    bpy.ops.wm.read_homefile(use_empty=True)
    bpy.context.preferences.addons[installed].preferences.engine_python = ENGINE
    bpy.ops.sacha.open(filepath=str(material.folder / "scored.sacha"))
    bpy.ops.sacha.compare(filepath=str(material.folder / "other.sacha"))
    path = tmp_path_factory.mktemp("seen") / "seen.blend"
    bpy.ops.wm.save_as_mainfile(filepath=str(path), check_existing=False)
    return path


@pytest.fixture
def seen(addon: ModuleType, seen_blend: Path) -> bpy.types.Object:
    """The avatar with scores, compared with another one, as the active object of the scene."""
    bpy.ops.wm.open_mainfile(filepath=str(seen_blend))
    return bpy.context.object


@pytest.fixture
def opened(addon: ModuleType, opened_blend: Path) -> bpy.types.Object:
    """The avatar of the material as the active object of the scene."""
    bpy.ops.wm.open_mainfile(filepath=str(opened_blend))
    return bpy.context.object


def face_attribute(mesh: bpy.types.Mesh, name: str, kind: str = "INT") -> np.ndarray:
    """Give a number a triangle: a whole one, or (FLOAT) any."""
    attribute = mesh.attributes[name]
    assert (attribute.domain, attribute.data_type) == ("FACE", kind)
    values = np.empty(len(attribute.data), np.int32 if kind == "INT" else np.float32)
    attribute.data.foreach_get("value", values)
    return values


def corner_colours(mesh: bpy.types.Mesh, name: str) -> np.ndarray:
    """Give (f, 3, 4) linear colours of the corners of triangles."""
    attribute = mesh.attributes[name]
    assert (attribute.domain, attribute.data_type) == ("CORNER", "FLOAT_COLOR")
    values = np.empty(4 * len(attribute.data), np.float32)
    attribute.data.foreach_get("color", values)
    return values.reshape(-1, 3, 4)


def positions(mesh: bpy.types.Mesh) -> np.ndarray:
    """Give (v, 3) vertices in Blender's axes."""
    values = np.empty(3 * len(mesh.vertices), np.float32)
    mesh.vertices.foreach_get("co", values)
    return values.reshape(-1, 3)


def triangles(mesh: bpy.types.Mesh) -> np.ndarray:
    """Give (f, 3) vertex indices."""
    values = np.empty(len(mesh.loops), np.int32)
    mesh.loops.foreach_get("vertex_index", values)
    return values.reshape(-1, 3)


def in_blenders_axes(vertices: np.ndarray) -> np.ndarray:
    """Turn (v, 3) points from the engine's axes to Blender's, written down once more."""
    return np.stack([vertices[:, 0], -vertices[:, 2], vertices[:, 1]], axis=1)
