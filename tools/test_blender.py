"""Run the tests in blender_tests inside each supported Blender, one process each, and judge them by what they wrote.

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
from pathlib import Path

from blender_env import BLENDERS, ROOT, UnavailableError, environment, install_all
from build_addon import build

__all__ = ["run"]

TIME_LIMIT_S = 240  # a run takes about 20 s
TESTS = ROOT / "blender_tests"


def run(release: str, extension: Path, arguments: list[str]) -> str | None:
    """Run the tests in one Blender.

    Args:
        release: which.
        extension: the built add-on.
        arguments: more of them for pytest.

    Returns:
        None where all is well, else what is not.
    """
    python = environment(release) / "bin" / "python"
    with tempfile.TemporaryDirectory(prefix="sacha-blender-") as user:
        junit = Path(user) / "junit.xml"
        variables = {
            "BLENDER_USER_RESOURCES": f"{user}/resources",
            "SACHA_ENGINE": str(ROOT / ".venv" / "bin" / "python"),
            "SACHA_EXTENSION": str(extension),
            "SACHA_HEADS": f"{user}/heads",
            "PYTHONDONTWRITEBYTECODE": "1",
        }
        command = [python, "-m", "pytest", "-c", TESTS / "pytest.ini", TESTS, f"--junitxml={junit}", *arguments]
        process = subprocess.Popen(  # noqa: S603
            command, stdin=subprocess.DEVNULL, env=os.environ | variables, cwd=ROOT, start_new_session=True
        )
        try:
            process.wait(TIME_LIMIT_S)
        except subprocess.TimeoutExpired:
            os.killpg(process.pid, signal.SIGKILL)
            process.wait()
            if not junit.exists():
                return f"no result within {TIME_LIMIT_S} s"
        return judge(junit)


def judge(junit: Path) -> str | None:
    """Say what a JUnit file holds against a run; None where it holds nothing."""
    if not junit.exists():
        return "no result was written: the process crashed"
    suite = ET.parse(junit).getroot().find("testsuite")
    counts = {name: int(suite.get(name)) for name in ("tests", "failures", "errors", "skipped")}
    if counts["tests"] - counts["skipped"] <= 0:
        return "no test ran"
    if counts["failures"] or counts["errors"]:
        return f"{counts['failures']} failed and {counts['errors']} broke of {counts['tests']}"
    return None


def main(arguments: list[str]) -> int:
    """Test in every Blender; give the exit status.

    Where Blender cannot be had, one line says why and the tests are left out; with CI or SACHA_REQUIRE_BLENDER set that is a failure.
    """
    try:
        install_all()
    except UnavailableError as error:
        print(f"Blender tests left out: {error}", file=sys.stderr)  # noqa: T201
        return int(any(os.environ.get(name, "") not in {"", "0"} for name in ("CI", "SACHA_REQUIRE_BLENDER")))
    built = build()
    faults = {release: run(release, built, arguments) for release in BLENDERS}
    for release, fault in faults.items():
        print(f"Blender {release}: {fault or 'passed'}")  # noqa: T201
    return int(any(faults.values()))


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
