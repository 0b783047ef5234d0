"""The frame round every command: exit statuses, one-line errors, reports, and how quickly it all starts."""

from __future__ import annotations

import errno
import json
import os
import statistics
import subprocess
import sys
import time
from collections.abc import Callable
from dataclasses import dataclass, field, fields
from importlib import import_module
from types import ModuleType
from typing import Any

import numpy as np
import pytest

from sacha_core import __version__
from sacha_core.cli import main, program
from sacha_core.cli.commands import COMMANDS, Command
from sacha_core.cli.common import Common
from sacha_core.cli.protocol import SPEAKS
from sacha_core.errors import DatasetError, FormatError
from sacha_core.progress import Progress

LIGHT_SECONDS = (
    0.3  # the promise of the design for the import; 0.05 s on an idle machine, the interpreter's own start included
)
QUICK_SECONDS = 1.0  # well below 0.2 s on an idle machine; the checks share it with others, so that what is loaded is the sharper test
HEAVY = [
    "numpy", "numba", "torch", "trimesh", "xatlas", "constriction", "PIL", "scipy", "matplotlib", "rich", "av", "jaxtyping",
    "sacha_core.codec", "sacha_core.raster",
]  # fmt: skip
MISSING = {
    "decode": ["nowhere", "--ply", "a.ply"],
    "doctor": ["nowhere"],
    "encode": ["nowhere", "-o", "a.sacha"],
    "evaluate": ["nowhere", "nowhere"],
    "inspect": ["nowhere"],
    "render": ["nowhere", "-o", "a.png"],
    "train": ["nowhere", "-o", "model"],
    "view": ["nowhere"],
}
UNWRITABLE = [
    (("ablate", "given", "-o", "given"), "given: not a directory"),
    (("assemble", "given", "--source", "given", "-o", "given"), "given: not a directory"),
    (("bake", "given", "-o", "folder"), "folder: is a directory"),
    (("batch", "encode", "folder", "-o", "given"), "given: not a directory"),
    (("bench", "stability", "--json", "folder"), "folder: is a directory"),
    (("bench", "raster", "--plot", "folder"), "folder: is a directory"),
    (("bench", "all", "-o", "given"), "given: not a directory"),
    (("bind", "given", "--head", "synthetic:small", "-o", "folder"), "folder: is a directory"),
    (("convert-head", "given", "-o", "folder"), "folder: is a directory"),
    (("decode", "given", "--ply", "folder"), "folder: is a directory"),
    (("decode", "given", "--motion", "given/m.npz"), "{here}/given: not a directory"),
    (("decode", "given", "--model", "given"), "given: not a directory"),
    (("demo", "-o", "given"), "given: not a directory"),
    (("doctor", "folder", "--picture", "folder"), "folder: is a directory"),
    (("encode", "given", "-o", "folder", "--target-psnr", "37"), "folder: is a directory"),
    (("encode", "given", "-o", "given/a.sacha", "--tune"), "{here}/given: not a directory"),
    (("framewise", "folder", "-o", "given"), "given: not a directory"),
    (("prune", "given", "--keep", "0.5", "-o", "folder.ply"), "folder.ply: is a directory"),
    (("prune", "given", "--keep", "0.5", "-o", "file"), "file: not a directory"),
    (("prune", "given", "--keep", "0.5", "-o", "a.ply", "--scene", "given"), "given: not a directory"),
    (("render", "given", "-o", "folder"), "folder: is a directory"),
    (("render", "given", "--video", "folder"), "folder: is a directory"),
    (("render", "given", "-o", "a.png", "--level", "2", "--error", "folder"), "folder: is a directory"),
    (("scene", "given", "--out", "given"), "given: not a directory"),
    (("score", "given", "-o", "folder.npz"), "folder.npz: is a directory"),
    (("splats", "given", "--out", "given"), "given: not a directory"),
    (("synth", "given"), "given: not a directory"),
    (("train", "folder", "-o", "given"), "given: not a directory"),
]  # by every command that writes, with inputs that make no sense, which would be told next


@dataclass(frozen=True)
class Options:
    """Do something."""

    common: Common = field(default_factory=Common)


Fake = Callable[[Callable[..., dict[str, Any]]], None]


@pytest.fixture
def fake(monkeypatch: pytest.MonkeyPatch) -> Fake:
    """Install a command `fake` that does what a test says."""

    def install(work: Callable[..., dict[str, Any]]) -> None:
        module = ModuleType("sacha_core.cli.fake")
        module.Options = Options
        module.run = lambda _, console: work(console)
        monkeypatch.setitem(sys.modules, "sacha_core.cli.fake", module)
        monkeypatch.setitem(COMMANDS, "fake", Command("fake", "Do something."))

    return install


def raising(error: BaseException) -> Callable[..., dict[str, Any]]:
    def work(console: object) -> dict[str, Any]:
        raise error

    return work


@pytest.mark.parametrize(
    ("error", "line"),
    [
        (FormatError("not a\n  SACHA file", offset=7), "not a SACHA file (at byte 7)"),
        (DatasetError("x.png is missing"), "x.png is missing"),
        (FileNotFoundError(errno.ENOENT, os.strerror(errno.ENOENT), "a.sacha"), "a.sacha: no such file or directory"),
        (PermissionError(errno.EACCES, os.strerror(errno.EACCES), "b"), "b: permission denied"),
        (OSError(errno.ENOSPC, os.strerror(errno.ENOSPC)), "no space left on device"),
        (ModuleNotFoundError("No module", name="torch"), "needs the package torch: pip install 'sacha[bench]'"),
    ],
)
def test_what_a_user_can_put_right_is_one_line_and_exit_2(
    fake: Fake, capsys: pytest.CaptureFixture[str], error: Exception, line: str
) -> None:
    fake(raising(error))
    assert main(["fake"]) == 2
    captured = capsys.readouterr()
    assert captured.err == f"sacha fake: {line}\n"
    assert not captured.out


def test_a_bug_is_not_hidden(fake: Fake) -> None:
    fake(raising(ZeroDivisionError("oops")))
    with pytest.raises(ZeroDivisionError):
        main(["fake"])
    fake(raising(ModuleNotFoundError("No module", name="sacha_core.nowhere")))
    with pytest.raises(ModuleNotFoundError):
        main(["fake"])


def test_interruption_is_130(fake: Fake, capsys: pytest.CaptureFixture[str]) -> None:
    fake(raising(KeyboardInterrupt()))
    assert main(["fake"]) == 130
    assert capsys.readouterr().err == "sacha fake: interrupted\n"


@pytest.mark.parametrize(
    ("arguments", "program_name", "culprit"),
    [
        (["fake", "--nonsense"], "sacha fake", "--nonsense"),
        (["fake", "--progress", "loud"], "sacha fake", "'loud' for argument '--progress'"),
        (["fake", "--json"], "sacha fake", "'--json'"),
        (["fake", "--json", "."], "sacha fake", ".: is a directory"),
        (["encode"], "sacha encode", "--output FILE.sacha"),
        (
            ["render", "a", "-o", "b", "--frame", "x"],
            "sacha render",
            "--frame: invalid literal for int() with base 10: 'x'",
        ),
        (["nonsense"], "sacha", "nonsense"),
    ],
)
def test_wrong_arguments_are_one_line_and_exit_2(
    fake: Fake, capsys: pytest.CaptureFixture[str], arguments: list[str], program_name: str, culprit: str
) -> None:
    fake(raising(AssertionError("must not run")))
    assert main(arguments) == 2
    captured = capsys.readouterr()
    assert captured.err.startswith(f"{program_name}: ")
    assert captured.err.count("\n") == 1
    assert culprit in captured.err
    assert not set("─│╭╮╰╯") & set(captured.err)
    assert not captured.out


def test_boxes_are_read_with_and_without_lines_drawn() -> None:
    drawn = "╭─ Value error ─╮\n│ Error parsing │\n│ --frame: x.   │\n│ ───────────── │\n│ Helptext      │\n╰──────╯\n"
    plain = " Value error \n -------------\n  Error parsing \n --frame: x.   \n ------------- \n Helptext\n"
    assert program.boxed(drawn) == program.boxed(plain) == "--frame: x"


def test_help_lists_every_public_command(capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["--help"]) == 0
    text = capsys.readouterr().out
    for name, command in COMMANDS.items():
        if command.summary:
            assert f"\n  {name} " in text
            assert " ".join(command.summary.split()[:3]) in text
    assert "scene" not in text
    assert main([]) == main(["-h"]) == 0
    assert capsys.readouterr().out == 2 * text


@pytest.mark.parametrize("columns", [20, 60, 200])
def test_the_list_of_commands_fits_its_terminal(columns: int) -> None:
    listed = program.listed_commands(columns).split("\n\n")[-1]
    assert all(len(line) < max(columns, 40) for line in listed.splitlines())
    words = " ".join(listed.split())
    assert all(f"{name} {command.summary}" in words for name, command in COMMANDS.items() if command.summary)


@pytest.mark.parametrize(
    ("arguments", "line"),
    [
        (["encod", "a"], "there is no command encod; did you mean encode?"),
        (["zzz"], "there is no command zzz"),
        (["--json", "a"], "expected a command before --json"),
    ],
)
def test_what_is_no_command_is_told(capsys: pytest.CaptureFixture[str], arguments: list[str], line: str) -> None:
    assert main(arguments) == 2
    assert capsys.readouterr().err == f"sacha: {line}; see sacha --help\n"


def test_report_is_written_whole_with_nulls_for_what_json_cannot_say(
    fake: Fake, tmp_path: Any, capsys: pytest.CaptureFixture[str]
) -> None:
    fake(lambda _: {"psnr": float("inf"), "counts": np.arange(3), "where": tmp_path, "mean": np.float32(0.5)})
    report = tmp_path / "reports" / "r.json"
    assert main(["fake", "--json", str(report)]) == 0
    found = json.loads(report.read_text())
    assert found.pop("seconds") >= 0
    assert found == {"command": "fake", "psnr": None, "counts": [0, 1, 2], "where": str(tmp_path), "mean": 0.5}
    assert [path.name for path in report.parent.iterdir()] == ["r.json"]
    assert str(report) in capsys.readouterr().out


def test_a_report_that_cannot_be_written_is_exit_2(
    fake: Fake, tmp_path: Any, capsys: pytest.CaptureFixture[str]
) -> None:
    fake(lambda _: {})
    (tmp_path / "file").write_text("")
    assert main(["fake", "--json", str(tmp_path / "file" / "r.json")]) == 2
    assert capsys.readouterr().err.count("\n") == 1


@pytest.mark.parametrize(("arguments", "culprit"), UNWRITABLE)
def test_what_cannot_be_written_is_told_before_anything_is_read(
    tmp_path: Any, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str], arguments: Any, culprit: str
) -> None:
    monkeypatch.chdir(tmp_path)
    for name in ("given", "file"):
        (tmp_path / name).write_text("no avatar, no head, no motion")
    for name in ("folder", "folder.ply", "folder.npz"):
        (tmp_path / name).mkdir()
    before = sorted(tmp_path.rglob("*"))
    assert main([*arguments]) == 2
    assert capsys.readouterr().err == f"sacha {arguments[0]}: {culprit.format(here=tmp_path.resolve())}\n"
    assert sorted(tmp_path.rglob("*")) == before


def test_no_command_that_writes_is_left_out() -> None:
    """Export reads the avatar before it knows what it is to write."""
    writing = {
        name
        for name, command in COMMANDS.items()
        if {"output", "out"} & {f.name for f in fields(import_module(f"sacha_core.cli.{command.module}").Options)}
    }
    assert writing - {arguments[0] for arguments, _ in UNWRITABLE} == {"export"}


def test_json_progress_leaves_stdout_to_objects(fake: Fake, capsys: pytest.CaptureFixture[str]) -> None:
    def work(console: Any) -> dict[str, Any]:
        for done in range(1, 4):
            console.report(Progress("count", done, 3, {"loss": float("nan"), "n": 2.0}))
        console.say("a result for people")
        return {}

    fake(work)
    assert main(["fake", "--progress", "json"]) == 0
    hello, *lines = [json.loads(line) for line in capsys.readouterr().out.splitlines()]
    assert hello == {"engine": __version__, "speaks": list(SPEAKS)}
    assert lines[0] == {
        "stage": "count",
        "done": 1,
        "total": 3,
        "seconds_left": None,
        "values": {"loss": None, "n": 2.0},
    }
    assert lines[-1]["done"] == 3
    assert lines[-1]["seconds_left"] == 0


def test_version(capsys: pytest.CaptureFixture[str]) -> None:

    assert main(["--version"]) == 0
    assert capsys.readouterr().out == f"sacha {__version__}\n"


def test_one_line_of_a_system_error_without_a_message() -> None:
    assert program.one_line(OSError("plain words")) == "plain words"


def python(code: str) -> subprocess.CompletedProcess[str]:
    return subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True, timeout=60)


def loaded(code: str, *names: str) -> list[str]:
    """Give which of some modules a fresh interpreter has loaded after running `code`."""
    told = python(f"{code}\nimport sys; sys.stderr.write(' '.join(m for m in {names!r} if m in sys.modules))")
    return told.stderr.split()


def quickest(code: str) -> float:
    """Give the median of five fresh interpreters' wall seconds."""
    seconds = []
    for _ in range(5):
        start = time.perf_counter()
        python(code)
        seconds.append(time.perf_counter() - start)
    return statistics.median(seconds)


def test_importing_the_front_door_is_light_and_quick() -> None:
    assert loaded("import sacha_core", *HEAVY, "tyro", "dataclasses") == []
    assert quickest("import sacha_core") < LIGHT_SECONDS


def test_the_front_page_needs_no_package_and_is_quick() -> None:
    code = "from sacha_core.cli import main; "
    pages = "; ".join(f"assert main({arguments}) == 0" for arguments in ([], ["--help"], ["--version"]))
    assert loaded(code + pages, *HEAVY, "tyro", "dataclasses") == []
    assert quickest(code + "main(['--help'])") < LIGHT_SECONDS


def test_help_of_a_command_loads_nothing_that_works_and_is_quick() -> None:
    code = "from sacha_core.cli import main; "
    pages = "; ".join(f"assert main([{name!r}, '--help']) == 0" for name in COMMANDS)
    assert loaded(code + pages, *HEAVY) == []
    assert loaded(code + "assert main(['encode', '--help']) == 0", "typeguard", "asyncio") == []
    assert quickest(code + "main(['encode', '--help'])") < QUICK_SECONDS


def test_a_wrong_name_of_a_file_is_told_before_anything_is_loaded() -> None:
    for name, arguments in MISSING.items():
        told = python(
            f"import sys; from sacha_core.cli import main; assert main({[name, *arguments]}) == 2; "
            f"sys.stderr.write(' '.join(m for m in {HEAVY!r} if m in sys.modules))"
        ).stderr
        assert told == f"sacha {name}: nowhere: no such file or directory\n"


def test_a_reader_that_leaves_gets_no_traceback() -> None:
    command = f"{sys.executable} -m sacha_core --help | true; exit ${{PIPESTATUS[0]}}"
    found = subprocess.run(["/bin/bash", "-c", command], capture_output=True, text=True, check=False, timeout=60)
    assert "Traceback" not in found.stderr


def test_termination_unwinds(tmp_path: Any) -> None:
    """SIGTERM removes what `write_aside` holds, as Ctrl-C does."""
    code = (
        "import os, signal, sys; from types import ModuleType, SimpleNamespace\n"
        "from sacha_core.cli import main; from sacha_core.cli.commands import COMMANDS, Command\n"
        "from sacha_core.files import write_aside; import tests_fake\n"
        "COMMANDS['fake'] = Command('fake', None); sys.modules['sacha_core.cli.fake'] = tests_fake\n"
        "sys.argv = ['sacha', 'fake']; sys.exit(main())\n"
    )
    (tmp_path / "tests_fake.py").write_text(
        "from __future__ import annotations\n"
        "import os, signal, time\nfrom dataclasses import dataclass, field\n"
        "from sacha_core.cli.common import Common\nfrom sacha_core.files import write_aside\n"
        "@dataclass(frozen=True)\nclass Options:\n    common: Common = field(default_factory=Common)\n"
        "def run(options, console):\n"
        "    with write_aside('half.bin') as aside:\n"
        "        aside.write_bytes(b'half')\n"
        "        os.kill(os.getpid(), signal.SIGTERM)\n"
        "        time.sleep(10)\n"
    )
    found = subprocess.run(
        [sys.executable, "-c", code], cwd=tmp_path, capture_output=True, text=True, check=False, timeout=60,
        env={**os.environ, "PYTHONPATH": str(tmp_path)},
    )  # fmt: skip
    assert found.returncode == 130, found.stderr
    assert found.stderr == "sacha fake: interrupted\n"
    assert [path.name for path in tmp_path.iterdir() if "half" in path.name] == []
