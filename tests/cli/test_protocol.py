"""What a program that drives the command line is told: who speaks, and which kind of failure ended a command."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest

from sacha_core import __version__
from sacha_core.cli import main
from sacha_core.cli.protocol import SPEAKS, wanted
from sacha_core.errors import MissingMasksError
from sacha_core.flame.synthetic import synthetic_head
from sacha_core.regions.labels import label_triangles

WATCHED = ("--progress", "json")
MAJOR_AT = 8  # byte of the container's major version: FORMAT.md


@pytest.fixture
def watch(capsys: pytest.CaptureFixture[str]) -> Any:
    """Run a command as a program that watches it; give its exit status, the objects on stdout and the text on stderr."""

    def run(*arguments: object) -> tuple[int, list[dict[str, Any]], str]:
        status = main([*map(str, arguments), *WATCHED])
        written = capsys.readouterr()
        return status, [json.loads(line) for line in written.out.splitlines()], written.err

    return run


def test_the_caller_is_known_before_the_arguments_are_understood() -> None:
    assert wanted(["scene", "--progress", "json"])
    assert wanted(["scene", "--progress=json"])
    assert not wanted(["scene", "json", "--progress"])
    assert not wanted(["scene", "--progress", "none", "json"])


def test_the_first_line_says_who_speaks_even_to_a_caller_of_another_version(watch: Any) -> None:
    for arguments in (["scene", "nowhere.sacha", "--an-option-of-tomorrow"], ["a-command-of-tomorrow"]):
        status, told, _ = watch(*arguments)
        assert status == 2
        assert told[0] == {"engine": __version__, "speaks": list(SPEAKS)}
        assert told[-1]["error"]["kind"] == "OptionError"


def test_without_a_watcher_stdout_stays_empty(capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["inspect", "nowhere.sacha"]) == 2
    assert capsys.readouterr().out == ""


def test_the_message_is_that_of_stderr(watch: Any, tmp_path: Path) -> None:
    _, told, complaint = watch("scene", tmp_path / "nowhere.sacha", "--out", tmp_path / "scene")
    error = told[-1]["error"]
    assert error["kind"] == "FileNotFoundError"
    assert complaint == f"sacha scene: {error['message']}\n"


def kind_of(watch: Any, *arguments: object) -> str:
    status, told, _ = watch(*arguments)
    assert status == 2
    kind: str = told[-1]["error"]["kind"]
    return kind


def test_a_file_of_tomorrow(watch: Any, sacha_file: Path, tmp_path: Path) -> None:
    newer = bytearray(sacha_file.read_bytes())
    newer[MAJOR_AT] += 1
    (tmp_path / "newer.sacha").write_bytes(newer)
    assert kind_of(watch, "scene", tmp_path / "newer.sacha", "--out", tmp_path / "scene") == "VersionError"


def test_a_head_that_is_missing_and_one_that_is_another(
    watch: Any, sacha_file: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("SACHA_HEADS", str(tmp_path / "none"))
    out = ("--out", tmp_path / "scene")
    assert kind_of(watch, "scene", sacha_file, "--head", tmp_path / "nowhere.npz", *out) == "MissingHeadError"
    assert kind_of(watch, "scene", sacha_file, "--head", "synthetic", *out) == "TopologyError"


def test_a_mesh_with_other_triangles(watch: Any, tmp_path: Path) -> None:
    mesh = tmp_path / "mesh.obj"
    mesh.write_text("v 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 3\n")
    out = ("--out", tmp_path / "scene")
    assert kind_of(watch, "scene", mesh, "--head", "synthetic:small", *out) == "TopologyError"


def test_masks_that_a_head_lacks() -> None:
    with pytest.raises(MissingMasksError, match="FLAME_masks"):
        label_triangles(replace(synthetic_head("small"), masks={}))
