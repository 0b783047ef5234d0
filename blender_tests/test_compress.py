"""Encoding and decoding by operators: the files are the engine's own, byte by byte, and a failure leaves none."""

from __future__ import annotations

import json
import os
import subprocess
from pathlib import Path
from types import ModuleType

import bpy
import pytest
from conftest import ENGINE, Material, face_attribute

COMMAND_LIMIT_S = 60


def engine(*arguments: str | Path) -> None:
    """Run the engine as a user of a shell would."""
    subprocess.run([ENGINE, "-m", "sacha_core", *arguments], check=True, timeout=COMMAND_LIMIT_S, capture_output=True)


def test_encoding_gives_the_same_bytes_as_the_shell(addon: ModuleType, material: Material, tmp_path: Path) -> None:
    chosen = bpy.context.scene.sacha
    chosen.head, chosen.level = str(material.folder / "head.npz"), 3
    ply = material.folder / "avatar.ply"
    bpy.ops.sacha.encode(source=str(ply), filepath=str(tmp_path / "ours.sacha"))
    engine("encode", "--ply", ply, "--head", chosen.head, "--level", "3", "-o", tmp_path / "shell.sacha")
    assert (tmp_path / "ours.sacha").read_bytes() == (tmp_path / "shell.sacha").read_bytes()


def test_the_level_of_the_scene_decides_the_size(addon: ModuleType, material: Material, tmp_path: Path) -> None:
    bpy.context.scene.sacha.head = str(material.folder / "head.npz")
    sizes = []
    for level in (1, 4):
        bpy.context.scene.sacha.level = level
        target = tmp_path / f"{level}.sacha"
        bpy.ops.sacha.encode(source=str(material.folder / "avatar.ply"), filepath=str(target))
        sizes.append(target.stat().st_size)
    assert sizes[0] < sizes[1]


def test_decoding_the_active_avatar_gives_the_same_ply_as_the_shell(
    opened: bpy.types.Object, material: Material, tmp_path: Path
) -> None:
    bpy.ops.sacha.decode(filepath=str(tmp_path / "ours.ply"), motion=str(tmp_path / "ours.npz"))
    engine(
        "decode", material.folder / "avatar.sacha", "--ply", tmp_path / "shell.ply", "--motion", tmp_path / "shell.npz"
    )
    for name in ("ply", "npz"):
        assert (tmp_path / f"ours.{name}").read_bytes() == (tmp_path / f"shell.{name}").read_bytes()


def test_decoding_takes_the_head_of_the_scene(addon: ModuleType, material: Material, tmp_path: Path) -> None:
    target = tmp_path / "stranger.ply"
    bpy.context.scene.sacha.head = str(material.folder / "head.npz")
    with pytest.raises(RuntimeError, match="is not the head that the avatar is bound to"):
        bpy.ops.sacha.decode(source=str(material.folder / "stranger.sacha"), filepath=str(target))
    assert not target.exists()
    bpy.context.scene.sacha.head = str(material.folder / "stranger.npz")
    bpy.ops.sacha.decode(source=str(material.folder / "stranger.sacha"), filepath=str(target))
    assert target.stat().st_size > 0


def test_there_and_back_every_gaussian_of_the_file_is_on_the_triangle_it_had(
    opened: bpy.types.Object, material: Material, tmp_path: Path
) -> None:
    bpy.context.scene.sacha.level = 1
    bpy.ops.sacha.encode(filepath=str(tmp_path / "again.sacha"))  # the avatar that is open, at another level
    bpy.ops.sacha.open(filepath=str(tmp_path / "again.sacha"))
    engine("inspect", tmp_path / "again.sacha", "--json", tmp_path / "report.json")
    counts = face_attribute(bpy.context.object.data, "count")
    assert counts.sum() == json.loads((tmp_path / "report.json").read_text())["n_gaussians"] > 0
    assert (counts <= material.truth["count"]).all()  # what is not worth its bits at this level is left out


def test_without_an_avatar_there_is_nothing_to_compress(addon: ModuleType, tmp_path: Path) -> None:
    for operator in (bpy.ops.sacha.encode, bpy.ops.sacha.decode):
        with pytest.raises(RuntimeError, match="No avatar: open one, or select the mesh of one that is open"):
            operator(filepath=str(tmp_path / "nothing"))


def test_a_broken_avatar_leaves_the_target_as_it_was(addon: ModuleType, tmp_path: Path) -> None:
    broken = tmp_path / "broken.sacha"
    broken.write_bytes(os.urandom(300))
    old = tmp_path / "out.ply"
    old.write_text("what was there")
    with pytest.raises(RuntimeError, match=r"broken\.sacha"):
        bpy.ops.sacha.decode(source=str(broken), filepath=str(old), check_existing=False)
    assert old.read_text() == "what was there"
    assert sorted(path.name for path in tmp_path.iterdir()) == ["broken.sacha", "out.ply"]


def test_a_broken_ply_writes_nothing(addon: ModuleType, material: Material, tmp_path: Path) -> None:
    broken = tmp_path / "broken.ply"
    broken.write_bytes((material.folder / "avatar.ply").read_bytes()[:-7])
    bpy.context.scene.sacha.head = str(material.folder / "head.npz")
    with pytest.raises(RuntimeError, match=r"broken\.ply"):
        bpy.ops.sacha.encode(source=str(broken), filepath=str(tmp_path / "out.sacha"))
    assert [path.name for path in tmp_path.iterdir()] == ["broken.ply"]
