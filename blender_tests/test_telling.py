"""What the user is told when something goes wrong: the report, the sidebar and the diagnostics say the same, and what to do."""

from __future__ import annotations

from pathlib import Path
from types import ModuleType

import bpy
import pytest
from conftest import ENGINE, Material

MAJOR_AT = 8  # byte of the container's major version: FORMAT.md


@pytest.fixture
def problem(addon: ModuleType) -> ModuleType:
    return __import__(f"{addon.__name__}.problem", fromlist=["last"])


@pytest.fixture
def advice(addon: ModuleType) -> dict[str, str]:
    return __import__(f"{addon.__name__}.advice", fromlist=["ADVICE"]).ADVICE


def fake_engine(folder: Path, script: str) -> str:
    """Make a program that stands in for the engine's Python."""
    path = folder / "engine"
    path.write_text(f"#!/bin/sh\n{script}\n")
    path.chmod(0o755)
    return str(path)


def told(problem: ModuleType, kind: str, advice: dict[str, str], **opening: str) -> str:
    """Open something that cannot be opened; hold report and sidebar to the kind's advice; give the message."""
    with pytest.raises(RuntimeError) as raised:
        bpy.ops.sacha.open(**opening)
    wrong = problem.last()
    assert wrong.kind == kind
    assert wrong.advice == advice[kind]
    assert wrong.sentence in str(raised.value)
    assert wrong.sentence.endswith(advice[kind])
    return wrong.message


def test_a_head_that_is_nowhere(problem, advice, material: Material, tmp_path: Path) -> None:
    message = told(problem, "MissingHeadError", advice, filepath=str(material.folder / "stranger.sacha"))
    assert "a stranger" in message
    assert "--head" not in problem.last().sentence  # the command line's words


def test_a_head_that_is_another(problem, advice, material: Material) -> None:
    opening = {"filepath": str(material.folder / "avatar.sacha"), "head": str(material.folder / "stranger.npz")}
    assert "is not the head" in told(problem, "TopologyError", advice, **opening)


def test_a_mesh_of_another_topology(problem, advice, material: Material, tmp_path: Path) -> None:
    mesh = tmp_path / "mesh.obj"
    mesh.write_text("v 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 3\n")
    told(problem, "TopologyError", advice, filepath=str(mesh), head=str(material.folder / "head.npz"))


def test_a_file_of_tomorrow(problem, advice, material: Material, tmp_path: Path) -> None:
    newer = bytearray((material.folder / "avatar.sacha").read_bytes())
    newer[MAJOR_AT] += 1
    (tmp_path / "newer.sacha").write_bytes(newer)
    assert "newer than this decoder" in told(problem, "VersionError", advice, filepath=str(tmp_path / "newer.sacha"))


def test_a_file_that_is_not_ours(problem, advice, tmp_path: Path) -> None:
    (tmp_path / "letter.sacha").write_bytes(b"Dear Sir or Madam")
    assert "not a .sacha file" in told(problem, "FormatError", advice, filepath=str(tmp_path / "letter.sacha"))


def test_what_is_solved_is_off_the_sidebar(problem, material: Material) -> None:
    with pytest.raises(RuntimeError):
        bpy.ops.sacha.open(filepath="/nowhere.sacha")
    assert problem.last().kind == "FileNotFoundError"
    bpy.ops.sacha.open(filepath=str(material.folder / "avatar.sacha"))
    assert problem.last() is None


def test_what_was_read_can_be_dismissed(problem, preferences) -> None:
    assert not bpy.ops.sacha.dismiss.poll()
    preferences.engine_python = "/nowhere/python"
    with pytest.raises(RuntimeError, match="pip install"):
        bpy.ops.sacha.open(filepath="/any.sacha")
    assert problem.last().kind == "NoEngine"
    bpy.ops.sacha.dismiss()
    assert problem.last() is None


@pytest.mark.parametrize(
    ("speaks", "kind"), [("[0, 0]", "EngineTooOld"), ("[7, 9]", "EngineTooNew"), ('"?"', "EngineTooOld")]
)
def test_an_engine_of_another_time_is_stopped_at_its_first_word(
    problem, advice, preferences, tmp_path: Path, speaks: str, kind: str
) -> None:
    hello = f'{{"engine": "9.9.9", "speaks": {speaks}}}'
    preferences.engine_python = fake_engine(tmp_path, f"echo '{hello}'\nexec sleep 60")
    assert "SACHA 9.9.9" in told(problem, kind, advice, filepath="/any.sacha")


def test_an_engine_from_before_the_agreement_is_too_old(problem, advice, preferences, tmp_path: Path) -> None:
    preferences.engine_python = fake_engine(tmp_path, "echo 'sacha: there is no command scene' >&2\nexit 2")
    told(problem, "EngineTooOld", advice, filepath="/any.sacha")


def test_an_engine_that_the_system_ends(problem, advice, preferences, tmp_path: Path) -> None:
    preferences.engine_python = fake_engine(tmp_path, "kill -9 $$")
    told(problem, "EngineKilled", advice, filepath="/any.sacha")


def test_a_fault_of_ours_is_called_so(problem, advice, preferences, tmp_path: Path) -> None:
    script = "echo 'Traceback (most recent call last):' >&2\necho 'KeyError: 3' >&2\nexit 1"
    preferences.engine_python = fake_engine(tmp_path, script)
    assert told(problem, "EngineBroken", advice, filepath="/any.sacha") == "KeyError: 3"


def test_an_engine_that_leaves_nothing(problem, advice, preferences, tmp_path: Path) -> None:
    preferences.engine_python = fake_engine(tmp_path, "exit 0")
    with pytest.raises(RuntimeError, match=r"scene\.json"):
        bpy.ops.sacha.open(filepath="/any.sacha")
    assert not bpy.data.meshes


def test_no_advice_is_a_stub(advice) -> None:
    for sentence in advice.values():
        assert sentence[0].isupper()
        assert not sentence.endswith(".")
        assert len(sentence) < 160


@pytest.fixture
def copied(tmp_path: Path):
    """Copy diagnostics, and give them as sections."""

    def copy() -> dict[str, str]:
        path = tmp_path / "diagnostics.txt"
        assert bpy.ops.sacha.copy_diagnostics(filepath=str(path)) == {"FINISHED"}
        parts = path.read_text().split("\n\n")[1:]
        return {title: lines for title, _, lines in (part.partition("\n") for part in parts)}

    return copy


def test_diagnostics_hold_versions_settings_and_the_last_problem(copied, problem, material: Material) -> None:
    bpy.context.scene.sacha.level = 3
    stranger = material.folder / "stranger.sacha"
    with pytest.raises(RuntimeError):
        bpy.ops.sacha.open(filepath=str(stranger))
    sections = copied()
    assert bpy.app.version_string in sections["Blender"]
    assert f"named: {ENGINE}" in sections["Engine"]
    assert "SACHA 0." in sections["Engine"]
    assert "level: 3" in sections["Scene"]
    assert "SACHA_HEADS=" in sections["Environment"]
    assert "kind: MissingHeadError" in sections["Last problem"]
    assert "exit code 2" in sections["Last problem"]
    assert str(stranger) in sections["Last problem"]  # how the engine was called
    assert problem.last() is not None  # to copy it does not solve it


def test_diagnostics_can_be_copied_without_an_engine_and_with_a_broken_one(
    copied, preferences, monkeypatch: pytest.MonkeyPatch
) -> None:
    preferences.engine_python = "/bin/false"
    assert "ended with code 1" in copied()["Engine"]
    monkeypatch.delenv("SACHA_ENGINE")
    preferences.engine_python = ""
    assert "No SACHA engine" in copied()["Engine"]


def test_diagnostics_describe_what_is_active(copied, opened: bpy.types.Object) -> None:
    section = copied()["Active object"]
    assert f"{len(opened.data.polygons)} faces" in section
    assert "kind: avatar" in section
    assert "region (FACE" in section


def test_diagnostics_do_not_tell_the_users_name(copied, monkeypatch: pytest.MonkeyPatch) -> None:
    home = str(Path(ENGINE).parent)
    monkeypatch.setenv("HOME", home)
    sections = copied()
    assert f"named: ~/{Path(ENGINE).name}" in sections["Engine"]
    assert home not in "".join(sections.values())
