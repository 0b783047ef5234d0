"""Kept machine code: what runs is what the sources say, whoever else compiles, edits or fails meanwhile."""

from __future__ import annotations

import ast
import os
import shutil
import subprocess
import sys
import textwrap
from pathlib import Path

import numpy as np
import pytest

import sacha_core
from sacha_core.parallel.kernels import kernel as kernel_module
from sacha_core.parallel.kernels.kernel import CodeFiles, kernel
from sacha_core.parallel.kernels.sources import source_files, sources_key

PACKAGE = Path(sacha_core.__file__).parent
KERNELS = sorted(PACKAGE.glob("*/kernels/*.py"))


def program(folder: Path, text: str) -> subprocess.Popen[str]:
    """Begin a Python program that finds the package in a folder, and keeps machine code beside its sources."""
    environment = {name: value for name, value in os.environ.items() if not name.startswith("NUMBA_")}
    environment["PYTHONPATH"] = str(folder)
    command = [sys.executable, "-c", textwrap.dedent(text)]
    return subprocess.Popen(
        command, cwd=folder, env=environment, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True
    )


def output(process: subprocess.Popen[str]) -> str:
    out, error = process.communicate()
    assert process.returncode == 0, error
    return out.strip()


@pytest.fixture
def copied(tmp_path: Path) -> Path:
    """Give a folder with a copy of the package, never compiled."""
    shutil.copytree(PACKAGE, tmp_path / PACKAGE.name, ignore=shutil.ignore_patterns("__pycache__"))
    return tmp_path


def replace(file: Path, old: str, new: str) -> None:
    text = file.read_text()
    assert text.count(old) == 1
    file.write_text(text.replace(old, new))


def test_an_edit_of_an_imported_constant_is_seen(copied: Path) -> None:
    """`rotate` takes the smallest angle from another package's file, which Numba's own cache does not look at."""
    text = """
        import numpy as np
        from sacha_core.animation.kernels.posing import rotate
        found = np.zeros((1, 3, 3))
        rotate(np.ones((1, 3)), found)
        print(len(rotate.stats.cache_hits), found[0, 1, 0] > 0.5)
    """
    assert output(program(copied, text)) == "0 True"
    assert output(program(copied, text)) == "1 True", "an unchanged source is not compiled again"
    # a "smallest angle" of 1e9 makes every rotation the identity to 1e-9
    replace(copied / "sacha_core/geometry/rotation.py", "SMALLEST_ANGLE_RAD = 1e-15", "SMALLEST_ANGLE_RAD = 1e9")
    assert output(program(copied, text)) == "0 False"
    assert output(program(copied, text)) == "1 False"


def test_an_edit_of_an_imported_inlined_function_is_seen(copied: Path) -> None:
    """`entropy_band` writes its slopes by a function of another file, which is part of its machine code."""
    text = """
        import numpy as np
        from sacha_core.perception.kernels.entropy import entropy_band
        image, target, slope, nats = np.full(32, 0.5, np.float32), np.full(32, 255, np.uint8), np.zeros(32, np.float32), np.zeros(1, np.float32)
        entropy_band(image, 0, target, 0, 32, 0, 1, 32, np.float32(1), slope, nats)
        print(len(entropy_band.stats.cache_hits), slope[0])
    """  # fmt: skip  # noqa: E501
    assert output(program(copied, text)) == "0 -2.0"
    replace(
        copied / "sacha_core/perception/kernels/pixels.py",
        "        store(gradient, at, value)",
        "        store(gradient, at, value + value)",
    )
    assert output(program(copied, text)) == "0 -4.0"


def test_processes_that_compile_for_different_types_at_once(copied: Path) -> None:
    """From nothing, side by side: each runs its own code, and later processes find all of it."""
    text = """
        import numpy as np
        from sacha_core.animation.kernels.posing import place_joints
        kind = np.{kind}
        given = np.arange(6, dtype=kind).reshape(2, 3), np.ones((2, 3, 2), kind), np.array([0.5, 0.25], kind)
        found, wanted = np.zeros((2, 3), kind), np.zeros((2, 3), kind)
        place_joints(*given, found)
        place_joints.py_func(*given, wanted)
        print(len(place_joints.stats.cache_hits), np.array_equal(found, wanted))
    """
    kinds = ["float32", "float64", "float32", "float64"]
    at_once = [program(copied, text.format(kind=kind)) for kind in kinds]
    assert all(output(one).endswith("True") for one in at_once)
    assert [output(program(copied, text.format(kind=kind))) for kind in kinds[:2]] == ["1 True", "1 True"]


@pytest.fixture
def files(tmp_path: Path) -> CodeFiles:
    source = tmp_path / "source.py"
    source.write_text("a = 1\n")
    return CodeFiles(tmp_path / "kept", "source.function", source)


def test_what_is_kept_comes_back_under_its_key_alone(files: CodeFiles) -> None:
    files.save(("float32", "cpu"), b"one")
    files.save(("float64", "cpu"), b"two")
    assert files.load(("float32", "cpu")) == b"one"
    assert files.load(("float64", "cpu")) == b"two"
    assert files.load(("float32", "another")) is None


@pytest.mark.parametrize("damage", ["cut", "empty", "flipped"])
def test_damaged_code_is_not_run(files: CodeFiles, damage: str, tmp_path: Path) -> None:
    files.save("key", b"code" * 50)
    (path,) = (tmp_path / "kept").iterdir()
    whole = bytearray(path.read_bytes())
    whole[len(whole) // 2] ^= 1
    path.write_bytes({"cut": bytes(whole[:90]), "empty": b"", "flipped": bytes(whole)}[damage])
    assert files.load("key") is None


def test_code_of_sources_that_changed_meanwhile_is_not_kept(files: CodeFiles, tmp_path: Path) -> None:
    """A process with old sources in memory must not leave its code under the name of the new ones, nor the other way round."""
    (tmp_path / "source.py").write_text("a = 2\n")
    files.save("key", b"code")
    assert not (tmp_path / "kept").exists()


def test_old_code_of_other_sources_goes(files: CodeFiles, tmp_path: Path) -> None:
    folder = tmp_path / "kept"
    folder.mkdir()
    old, recent = folder / "source.function-0123456789ab-0.nbc", folder / "source.function-ba9876543210-0.nbc"
    old.touch()
    recent.touch()
    os.utime(old, (0, 0))
    files.save("key", b"code")
    os.utime(next(folder.glob(f"*{sources_key(tmp_path / 'source.py')[:12]}*")), (0, 0))
    files.save("another", b"code")
    assert not old.exists()
    assert recent.exists()
    assert files.load("key") == b"code", "the same sources' code stays, however old"


def test_nowhere_to_write(monkeypatch: pytest.MonkeyPatch) -> None:
    """Numba raises RuntimeError where it finds no folder: the kernel is then compiled by each process anew."""

    def refuse(*args: object) -> None:
        raise RuntimeError("cannot cache function")

    monkeypatch.setattr(kernel_module.FunctionCache, "__init__", refuse)
    assert kernel(doubled)(np.float32(2)) == 4


def doubled(x: float) -> float:
    return x + x


@pytest.mark.parametrize("file", KERNELS, ids=lambda file: f"{file.parents[1].name}/{file.stem}")
def test_the_sources_of_a_kernel_are_all_found(file: Path) -> None:
    """Against the imports that Python's own parser finds."""
    wanted, open_ends = set[Path](), [file]
    while open_ends:
        one = open_ends.pop()
        if one not in wanted:
            wanted.add(one)
            open_ends += parsed_imports(one)
    assert set(source_files(file)) >= wanted


def parsed_imports(file: Path) -> list[Path]:
    found: list[str] = []
    for node in ast.walk(ast.parse(file.read_text())):
        if isinstance(node, ast.Import):
            found += [alias.name for alias in node.names]
        elif isinstance(node, ast.ImportFrom):
            assert node.level == 0, "imports here name the whole path"
            found += [str(node.module), *(f"{node.module}.{alias.name}" for alias in node.names)]
    places = [PACKAGE.parent.joinpath(*name.split(".")) for name in found if name.split(".")[0] == PACKAGE.name]
    return [path for place in places for path in (place.with_suffix(".py"), place / "__init__.py") if path.is_file()]


@pytest.mark.parametrize("file", KERNELS, ids=lambda file: f"{file.parents[1].name}/{file.stem}")
def test_no_kernel_is_kept_by_numba_itself(file: Path) -> None:
    calls = [node for node in ast.walk(ast.parse(file.read_text())) if isinstance(node, ast.Call)]
    assert not [call for call in calls if any(keyword.arg == "cache" for keyword in call.keywords)]
