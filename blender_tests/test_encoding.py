"""How files are made from Blender: what the engine is told, a size that is kept, and whole folders.

Where only the engine's options matter a small script stands in for it.
"""

from __future__ import annotations

import json
import shutil
import sys
from pathlib import Path

import bpy
import pytest
from conftest import Material

STAND_IN = """#!{python}
import json, sys
arguments = sys.argv[1:]
json.dump(arguments, open({told!r}, "w"))
report = {{"bytes": {{"total": 5}}}}
json.dump({report}, open(arguments[arguments.index("--json") + 1], "w"))
"""


@pytest.fixture
def told(preferences, tmp_path: Path):
    """Give a function that says what the engine was told last; it makes nothing."""
    path = tmp_path / "told.json"
    engine = tmp_path / "engine"
    engine.write_text(STAND_IN.format(python=sys.executable, told=str(path), report="report"))
    engine.chmod(0o755)
    preferences.engine_python = str(engine)

    def read() -> str:
        return " ".join(json.loads(path.read_text()))

    return read


def encode(tmp_path: Path, **given: object) -> None:
    bpy.ops.sacha.encode(source=str(tmp_path / "a.sacha"), filepath=str(tmp_path / "out.sacha"), **given)


def test_the_scene_decides_where_nothing_is_given(told, tmp_path: Path) -> None:
    scene, setup = bpy.context.scene.sacha, bpy.context.scene.sacha_making
    scene.level = 3
    encode(tmp_path)
    assert " --level 3 --profile sacha -o " in told()
    setup.size_by, setup.target_kb, setup.tune, setup.embed_head = "SIZE", 64.5, True, True
    scene.motion = str(tmp_path / "motion.npz")
    encode(tmp_path)
    assert f" --target-size 64.5KB --profile sacha --tune --embed-head --motion {tmp_path}/motion.npz -o " in told()
    setup.size_by, setup.tune, setup.embed_head = "ARCHIVE", False, False
    encode(tmp_path)
    assert " --level archive --profile sacha --motion " in told()


def test_what_is_given_comes_before_the_scene(told, tmp_path: Path) -> None:
    setup = bpy.context.scene.sacha_making
    setup.size_by, setup.target_kb, setup.tune = "SIZE", 64.5, True
    encode(tmp_path, level="4", profile="paper", tune=False)
    assert " --level 4 --profile paper -o " in told()
    setup.size_by = "LEVEL"
    encode(tmp_path, target_kb=20.0, embed_head=True)
    assert " --target-size 20KB --profile sacha --tune --embed-head -o " in told()


def test_what_an_operator_was_given_is_not_remembered(told, tmp_path: Path) -> None:
    encode(tmp_path, level="1")
    encode(tmp_path)
    assert " --level 2 " in told()


def test_a_worker_that_writes_garbage_is_one_sentence(preferences, tmp_path: Path) -> None:
    for report, complaint in (
        ("5", "left a report.json that is no report, but int"),
        ('{"bytes": []}', "does not understand"),
        ('{"bytes": {}}', "does not understand"),
        ("[]", "that is no report, but list"),
    ):
        engine = tmp_path / "engine"
        engine.write_text(
            STAND_IN.format(python=sys.executable, told=str(tmp_path / "told"), report=f"json.loads({report!r})")
        )
        engine.chmod(0o755)
        preferences.engine_python = str(engine)
        with pytest.raises(RuntimeError, match=complaint):
            encode(tmp_path)


def test_contradictions_are_refused_in_the_engines_words(preferences, material: Material, tmp_path: Path) -> None:
    source, target = str(material.folder / "avatar.sacha"), str(tmp_path / "out.sacha")
    with pytest.raises(RuntimeError, match="the paper's profile has no level archive"):
        bpy.ops.sacha.encode(source=source, filepath=target, level="archive", profile="paper")
    assert not Path(target).exists()


def test_a_folder_is_done_as_far_as_it_can_be(preferences, material: Material, tmp_path: Path) -> None:
    shutil.copyfile(material.folder / "avatar.sacha", tmp_path / "good.sacha")
    (tmp_path / "bad.sacha").write_text("no avatar")
    with pytest.raises(RuntimeError, match=r"Decoded 1 of 2 avatars to .*/decoded, but not bad\.sacha: "):
        bpy.ops.sacha.decode_folder(directory=str(tmp_path))
    made = sorted(path.name for path in (tmp_path / "decoded").iterdir())
    assert made == ["good.npz", "good.ply"]
    (tmp_path / "bad.sacha").unlink()
    assert bpy.ops.sacha.decode_folder(directory=str(tmp_path), output=str(tmp_path / "plys")) == {"FINISHED"}
    bpy.ops.sacha.encode_folder(directory=str(tmp_path), output=str(tmp_path / "files"), level="archive")
    assert [path.name for path in (tmp_path / "files").iterdir()] == ["good.sacha"]
    with pytest.raises(RuntimeError, match="No folder: name the one that holds the avatars"):
        bpy.ops.sacha.encode_folder()
