"""Run the tests in blender_tests inside each supported Blender, side by side, and judge them by what they wrote.

A Blender process may hang or crash at its end after every test has passed, or fail and still exit with 0: the judge is the JUnit file,
and each process has a time limit.
"""

from __future__ import annotations

import os
import signal
import subprocess
import sys
import tempfile
import xml.etree.ElementTree as ET
from dataclasses import dataclass
from pathlib import Path

from blender_env import BLENDERS, OLDEST, ROOT, UnavailableError, environment, install_all, required
from build_addon import build

__all__ = ["main"]

TIME_LIMIT_S = 1800  # 4.5 minutes of processor time, which took 17 on a crowded machine
TESTS = ROOT / "blender_tests"


@dataclass(frozen=True)
class Run:
    """The tests running in one Blender.

    Args:
        process: pytest, leader of a session of its own.
        folder: what it writes: `junit.xml`, `output.txt`, and the user's files of a Blender that nobody used before.
    """

    process: subprocess.Popen[bytes]
    folder: Path


def start(release: str, extension: Path, folder: Path, arguments: list[str]) -> Run:
    """Start the tests in one Blender.

    Args:
        release: which.
        extension: the built add-on.
        folder: an empty one.
        arguments: more of them for pytest.
    """
    python = environment(release) / "bin" / "python"
    variables = {
        "BLENDER_USER_RESOURCES": f"{folder}/resources",
        "SACHA_ENGINE": str(ROOT / ".venv" / "bin" / "python"),
        "SACHA_EXTENSION": str(extension),
        "SACHA_HEADS": f"{folder}/heads",
        "PYTHONDONTWRITEBYTECODE": "1",
    }
    options = [f"--junitxml={folder}/junit.xml", f"--basetemp={folder}/tests", *arguments]
    with (folder / "output.txt").open("wb") as output:
        process = subprocess.Popen(  # noqa: S603
            [python, "-m", "pytest", "-c", TESTS / "pytest.ini", TESTS, *options],
            stdin=subprocess.DEVNULL,
            stdout=output,
            stderr=subprocess.STDOUT,
            env=os.environ | variables,
            cwd=ROOT,
            start_new_session=True,
        )
    return Run(process, folder)


def finish(run: Run, time_limit_s: float) -> str | None:
    """Wait for a run, end it if it takes too long, show what it printed, and give what is wrong; None where all is well."""
    try:
        run.process.wait(time_limit_s)
    except subprocess.TimeoutExpired:
        os.killpg(run.process.pid, signal.SIGKILL)
        run.process.wait()
    print((run.folder / "output.txt").read_text(errors="replace"), flush=True)  # noqa: T201
    return judge(run.folder / "junit.xml")


def judge(junit: Path) -> str | None:
    """Say what a JUnit file holds against a run; None where it holds nothing."""
    try:
        suite = ET.parse(junit).getroot().find("testsuite")
    except (FileNotFoundError, ET.ParseError):
        return f"no result was written: it crashed, or took longer than {TIME_LIMIT_S} s"
    counts = {name: int(suite.get(name)) for name in ("tests", "failures", "errors", "skipped")}
    if counts["tests"] - counts["skipped"] <= 0:
        return "no test ran"
    if counts["failures"] or counts["errors"]:
        return f"{counts['failures']} failed and {counts['errors']} broke of {counts['tests']}"
    return None


def main(arguments: list[str]) -> int:
    """Test in every Blender, with the argument --all in the oldest as well; give the exit status. Other arguments are pytest's.

    Where Blender cannot be had, one line says why and the tests are left out; with CI or SACHA_REQUIRE_BLENDER set that is a failure.
    """
    releases = {**BLENDERS, **(OLDEST if "--all" in arguments else {})}
    arguments = [argument for argument in arguments if argument != "--all"]
    try:
        install_all(releases)
    except UnavailableError as error:
        print(f"Blender tests left out: {error}", file=sys.stderr)  # noqa: T201
        return int(required())
    extension = build()
    with tempfile.TemporaryDirectory(prefix="sacha-blender-") as name:
        runs = {}
        for release in releases:
            folder = Path(name) / release
            folder.mkdir()
            runs[release] = start(release, extension, folder, arguments)
        faults = {release: finish(run, TIME_LIMIT_S) for release, run in runs.items()}
    for release, fault in faults.items():
        print(f"Blender {release}: {fault or 'passed'}")  # noqa: T201
    return int(any(faults.values()))


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
