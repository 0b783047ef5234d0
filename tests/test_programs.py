"""Other people's programs: the oracle are programs made here, whose end is known."""

from __future__ import annotations

import sys
from pathlib import Path

import pytest

from sacha_core.errors import OptionError, ProgramError
from sacha_core.programs import find_program, named_program, run_program

VARIABLE = "SACHA_PROGRAM_OF_A_TEST"


def made(path: Path) -> Path:
    """Put an executable file there."""
    path.parent.mkdir(exist_ok=True)
    path.write_text("#!/bin/sh\n")
    path.chmod(0o755)
    return path


@pytest.mark.skipif(sys.platform == "win32", reason="the stand-in is a shell script")
def test_the_named_program_goes_before_the_one_on_the_path(monkeypatch, tmp_path: Path) -> None:
    on_path, named = made(tmp_path / "bin" / "coder"), made(tmp_path / "mine" / "coder")
    monkeypatch.setenv("PATH", str(on_path.parent))
    monkeypatch.delenv(VARIABLE, raising=False)
    assert (named_program(VARIABLE), find_program(VARIABLE, "coder")) == (None, on_path)
    monkeypatch.setenv(VARIABLE, str(named))
    assert (named_program(VARIABLE), find_program(VARIABLE, "coder")) == (named, named)
    monkeypatch.setenv(VARIABLE, "")  # as good as not set
    assert find_program(VARIABLE, "coder") == on_path
    assert find_program(VARIABLE, "no-such-program") is None


@pytest.mark.skipif(sys.platform == "win32", reason="the stand-in is a shell script")
@pytest.mark.parametrize("named", ["mine/none", "mine"])
def test_what_is_named_and_is_no_file_is_told_and_never_replaced(monkeypatch, tmp_path: Path, named: str) -> None:
    monkeypatch.setenv("PATH", str(made(tmp_path / "bin" / "coder").parent))
    made(tmp_path / "mine" / "coder")
    monkeypatch.setenv(VARIABLE, str(tmp_path / named))
    for find in (lambda: find_program(VARIABLE, "coder"), lambda: named_program(VARIABLE)):
        with pytest.raises(OptionError) as caught:
            find()
        assert VARIABLE in str(caught.value)
        assert str(tmp_path / named) in str(caught.value)


def test_what_a_program_says_is_given_and_where_it_works_is_chosen(tmp_path: Path) -> None:
    code = "import os, sys; print(os.getcwd()); print('aside', file=sys.stderr); sys.exit(len(sys.argv) - 1)"
    assert run_program([sys.executable, "-c", code], tmp_path).split() == [str(tmp_path.resolve()), "aside"]
    assert "aside" in run_program([sys.executable, "-c", code, "more"], tmp_path, check=False)


def test_a_program_that_fails_or_hangs_ends_in_one_line(tmp_path: Path) -> None:
    with pytest.raises(ProgramError, match="ended with status 3: so it is"):
        run_program([sys.executable, "-c", "import sys; sys.stderr.write('a\\nso it is\\n'); sys.exit(3)"], tmp_path)
    with pytest.raises(ProgramError, match="took more than 0 s"):
        run_program([sys.executable, "-c", "import time; time.sleep(60)"], tmp_path, limit_s=0.2)
    with pytest.raises(ProgramError, match="could not be started"):
        run_program([tmp_path / "none"], tmp_path)
