"""The scripts that make Blender's environments and judge its tests: they must not pass what did not run."""

from __future__ import annotations

import importlib
import os
from pathlib import Path
from types import ModuleType

import pytest

TOOLS = Path(__file__).parents[2] / "tools"


@pytest.fixture
def env(monkeypatch: pytest.MonkeyPatch) -> ModuleType:
    monkeypatch.syspath_prepend(str(TOOLS))
    return importlib.import_module("blender_env")


@pytest.fixture
def runner(env: ModuleType) -> ModuleType:
    return importlib.import_module("test_blender")


def junit(folder: Path, **counts: int) -> Path:
    path = folder / "junit.xml"
    numbers = {"tests": 5, "failures": 0, "errors": 0, "skipped": 0} | counts
    attributes = " ".join(f'{name}="{number}"' for name, number in numbers.items())
    path.write_text(f"<testsuites><testsuite {attributes}/></testsuites>")
    return path


def test_only_a_run_in_which_something_passed_passes(runner: ModuleType, tmp_path: Path) -> None:
    assert runner.judge(junit(tmp_path)) is None
    assert "crashed" in runner.judge(tmp_path / "none.xml")
    assert "1 failed" in runner.judge(junit(tmp_path, failures=1))
    assert "2 broke" in runner.judge(junit(tmp_path, errors=2))
    assert runner.judge(junit(tmp_path, tests=0)) == "no test ran"
    assert runner.judge(junit(tmp_path, skipped=5)) == "no test ran"
    assert runner.judge(junit(tmp_path, skipped=4)) is None


def test_a_process_that_writes_half_a_result_fails(runner: ModuleType, tmp_path: Path) -> None:
    path = tmp_path / "junit.xml"
    path.write_text("<testsuites><testsuite tests=")
    assert "no result" in runner.judge(path)


@pytest.mark.parametrize(
    ("variable", "value", "status"),
    [("CI", "", 0), ("CI", "true", 1), ("CI", "0", 0), ("SACHA_REQUIRE_BLENDER", "1", 1)],
)
def test_where_blender_cannot_be_had_one_line_says_so(
    runner: ModuleType,
    env: ModuleType,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
    variable: str,
    value: str,
    status: int,
) -> None:
    def refuse(_releases: object = ()) -> None:
        raise env.UnavailableError("apt-get install libegl1")

    for name in ("CI", "SACHA_REQUIRE_BLENDER"):
        monkeypatch.delenv(name, raising=False)
    monkeypatch.setenv(variable, value)
    monkeypatch.setattr(runner, "install_all", refuse)
    assert runner.main([]) == status
    assert capsys.readouterr().err == "Blender tests left out: apt-get install libegl1\n"
    executable = importlib.import_module("test_executable")
    monkeypatch.setattr(executable, "install_all", refuse)
    assert executable.main() == status
    assert capsys.readouterr().err == "Checks in a Blender executable left out: apt-get install libegl1\n"


def test_an_executable_is_the_one_named_or_found_and_else_installed(
    env: ModuleType, monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    there: dict[str, str] = {}

    def install(packages: list[str], _by_hand: str) -> None:
        there.update({"blender": f"/usr/bin/{packages[0]}", f"/usr/bin/{packages[0]}": "there"})

    monkeypatch.delenv("SACHA_BLENDER", raising=False)
    monkeypatch.setattr(env.shutil, "which", there.get)
    monkeypatch.setattr(env, "install_packages", install)
    assert env.executable() == "/usr/bin/blender"
    there.update({"blender": "/opt/blender", "/opt/blender": "there"})
    assert env.executable() == "/opt/blender"
    monkeypatch.setenv("SACHA_BLENDER", str(tmp_path / "nowhere"))
    with pytest.raises(env.UnavailableError, match="nowhere"):
        env.executable()


@pytest.mark.parametrize(("arguments", "oldest"), [([], False), (["--all"], True)])
def test_the_oldest_blender_is_tested_when_asked_for(
    runner: ModuleType, env: ModuleType, monkeypatch: pytest.MonkeyPatch, arguments: list[str], oldest: bool
) -> None:
    started: dict[str, list[str]] = {}
    monkeypatch.setattr(runner, "install_all", lambda _: None)
    monkeypatch.setattr(runner, "build", lambda: Path("a.zip"))
    monkeypatch.setattr(runner, "start", lambda release, _zip, _folder, more: started.setdefault(release, more))
    monkeypatch.setattr(runner, "finish", lambda *_: None)
    assert runner.main([*arguments, "-x"]) == 0
    assert set(started) == {*env.BLENDERS, *(env.OLDEST if oldest else ())}
    assert all(more == ["-x"] for more in started.values())


@pytest.mark.parametrize("why", ["not root", "no apt-get"])
def test_missing_libraries_are_named_where_they_may_not_be_installed(
    env: ModuleType, monkeypatch: pytest.MonkeyPatch, why: str
) -> None:
    monkeypatch.setattr(env, "LIBRARIES", {"libnot-here.so.9": "libnot-here9", "libnot-there.so.1": "libnot-there1"})
    monkeypatch.setattr(env.sys, "platform", "linux")
    monkeypatch.setattr(env.shutil, "which", lambda _: None if why == "no apt-get" else "/usr/bin/apt-get")
    monkeypatch.setattr(os, "geteuid", lambda: 1000 if why == "not root" else 0)
    monkeypatch.setattr(env.subprocess, "run", lambda *_, **__: pytest.fail("tried to install"))
    with pytest.raises(env.UnavailableError, match="apt-get install libnot-here9 libnot-there1"):
        env.install_libraries()


def test_root_installs_exactly_what_is_missing(env: ModuleType, monkeypatch: pytest.MonkeyPatch) -> None:
    commands: list[list[str]] = []

    def run(command: list[str], **_: object) -> object:
        commands.append(command)
        env.LIBRARIES.clear()  # as if it had been installed
        return type("Done", (), {"returncode": 0})

    monkeypatch.setattr(env, "LIBRARIES", {"libnot-here.so.9": "libnot-here9", "libc.so.6": "libc6"})
    monkeypatch.setattr(env.sys, "platform", "linux")
    monkeypatch.setattr(env.shutil, "which", lambda _: "/usr/bin/apt-get")
    monkeypatch.setattr(os, "geteuid", lambda: 0)
    monkeypatch.setattr(env.subprocess, "run", run)
    env.install_libraries()
    assert [command[1] for command in commands] == ["update", "install"]
    assert commands[1][-1:] == ["libnot-here9"]
    assert "libc6" not in commands[1]


def test_an_environment_with_the_right_versions_is_left_alone(
    env: ModuleType, monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    monkeypatch.setattr(env, "ROOT", tmp_path)
    monkeypatch.setattr(env.sys, "version_info", (3, 11, 7))
    commands: list[list[object]] = []

    def run(command: list[object], **_: object) -> object:
        commands.append(command)
        env.environment("5.0").mkdir(exist_ok=True)
        return type("Done", (), {"returncode": 0})

    monkeypatch.setattr(env.subprocess, "run", run)
    env.install_blender("5.0")
    assert f"bpy=={env.BLENDERS['5.0']}" in commands[-1]
    env.install_blender("5.0")
    assert len(commands) == 2
    monkeypatch.setitem(env.BLENDERS, "5.0", "5.0.99")
    env.install_blender("5.0")
    assert "bpy==5.0.99" in commands[-1]


def test_another_python_than_blenders_is_refused(
    env: ModuleType, monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    monkeypatch.setattr(env, "ROOT", tmp_path)
    monkeypatch.setattr(env.sys, "version_info", (3, 13, 0))
    with pytest.raises(env.UnavailableError, match=r"needs Python 3\.11"):
        env.install_blender("4.5")
