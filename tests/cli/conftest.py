"""A tiny capture, a hurried model of it and its `.sacha` file, each made once by the commands themselves."""

from __future__ import annotations

import contextlib
import io
import json
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import pytest

from sacha_core.cli import main

ITERATIONS = 100


@dataclass(frozen=True)
class Outcome:
    """What a command left behind."""

    status: int
    out: str
    err: str
    report: dict[str, Any]


Call = Callable[..., Outcome]


@pytest.fixture(scope="session")
def call(tmp_path_factory: pytest.TempPathFactory) -> Call:
    """Give a function that runs a command in this process, with a report."""
    reports = tmp_path_factory.mktemp("reports")

    def run(*arguments: object) -> Outcome:
        path = reports / "report.json"
        path.unlink(missing_ok=True)
        out, err = io.StringIO(), io.StringIO()
        with contextlib.redirect_stdout(out), contextlib.redirect_stderr(err):
            status = main([*map(str, arguments), "--json", str(path)])
        report = json.loads(path.read_text()) if path.exists() else {}
        return Outcome(status, out.getvalue(), err.getvalue(), report)

    return run


@pytest.fixture(scope="session")
def done(call: Call) -> Call:
    """Give a function that runs a command that has to succeed."""

    def run(*arguments: object) -> Outcome:
        outcome = call(*arguments)
        assert outcome.status == 0, outcome.err
        return outcome

    return run


@pytest.fixture(scope="session")
def refused(call: Call) -> Callable[..., str]:
    """Give a function that runs a command that has to refuse its input, and gives its one line."""

    def run(*arguments: object) -> str:
        outcome = call(*arguments)
        assert outcome.status == 2, outcome
        assert outcome.err.count("\n") == 1, outcome.err
        assert outcome.err.startswith(f"sacha {arguments[0]}: ")
        assert not outcome.report
        return outcome.err.strip()

    return run


@pytest.fixture(scope="session")
def synthesised(done: Call, tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, Outcome]:
    """Give a tiny capture of the small synthetic head, and what `synth` said."""
    folder = tmp_path_factory.mktemp("capture")
    return folder, done(
        *("synth", folder, "--head", "synthetic:small", "--width", 64, "--height", 94, "--cameras", 0, 5, 8, 11),
        *("--timesteps", 3, "--test-timesteps", 2, "--sequences", "EMO-1", "--supersample", 1),
    )


@pytest.fixture(scope="session")
def capture(synthesised: tuple[Path, Outcome]) -> Path:
    """Give the tiny capture."""
    return synthesised[0]


@pytest.fixture(scope="session")
def trained(done: Call, capture: Path, tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, Outcome]:
    """Give a model of the capture after a few iterations, and what `train` said."""
    folder = tmp_path_factory.mktemp("trained") / "model"
    return folder, done("train", capture, "-o", folder, "--iterations", ITERATIONS, "--sh-degree", 1)


@pytest.fixture(scope="session")
def model(trained: tuple[Path, Outcome]) -> Path:
    """Give the model's folder."""
    return trained[0]


@pytest.fixture(scope="session")
def encoded(done: Call, model: Path, tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, Outcome]:
    """Give the model as a `.sacha` file of the best level, and what `encode` said."""
    file = tmp_path_factory.mktemp("encoded") / "a.sacha"
    return file, done("encode", model, "--level", 4, "-o", file)


@pytest.fixture(scope="session")
def sacha_file(encoded: tuple[Path, Outcome]) -> Path:
    """Give the `.sacha` file."""
    return encoded[0]
