"""Install the built add-on in a Blender executable and check it there (`blender_tests/run.py`).

It is the one that SACHA_BLENDER names, the one on the path, or Debian's. Debian's is 3.4, older than what the add-on is made for: that
it works there too, without what that Blender lacks, is a smoke test and no promise.
"""

from __future__ import annotations

import os
import subprocess
import sys
import tempfile
from pathlib import Path

from blender_env import ROOT, UnavailableError, executable, install_all, required
from build_addon import build

__all__ = ["clean_variables", "main"]

TIME_LIMIT_S = 240  # it takes about 15 s
NO_NUMPY = "has no NumPy, which every Blender of blender.org brings: apt-get install python3-numpy"


def check(blender: str, extension: Path) -> int:
    """Run the checks in a Blender that nobody used before; give the exit status.

    Raises:
        UnavailableError: this Blender cannot run add-ons.
    """
    with tempfile.TemporaryDirectory(prefix="sacha-blender-") as folder:
        fresh = clean_variables(blender, extension, folder)
        if _run(blender, fresh, "--python-expr", "import numpy"):
            raise UnavailableError(f"{blender} {NO_NUMPY}")
        return _run(blender, fresh, "--python", str(ROOT / "blender_tests" / "run.py"))


def clean_variables(blender: str, extension: Path, folder: str) -> dict[str, str]:
    """Give the environment of a Blender that nobody used before.

    Args:
        blender: the executable.
        extension: the built add-on.
        folder: where its settings go.
    """
    return {
        "BLENDER_USER_RESOURCES": f"{folder}/resources",
        "BLENDER_USER_SCRIPTS": f"{folder}/resources/scripts",
        "BLENDER_USER_CONFIG": f"{folder}/resources/config",
        "SACHA_ENGINE": os.environ.get("SACHA_ENGINE", str(ROOT / ".venv" / "bin" / "python")),
        "SACHA_EXTENSION": str(extension),
        "SACHA_HEADS": f"{folder}/heads",
        "PYTHONDONTWRITEBYTECODE": "1",
        # Debian's Blender takes the standard library of the first Python on the path, which is not always Debian's
        "PATH": os.pathsep.join([str(Path(blender).parent), "/usr/bin", "/bin"]),
    }


def _run(blender: str, variables: dict[str, str], *arguments: str) -> int:
    """Run a Blender without a window and without a user's settings; give its exit status."""
    command = [blender, "--background", "--factory-startup", "--python-exit-code", "1", *arguments]
    done = subprocess.run(  # noqa: S603
        command, check=False, env=os.environ | variables, stdin=subprocess.DEVNULL, timeout=TIME_LIMIT_S
    )
    return done.returncode


def main() -> int:
    """Check in a Blender executable; give the exit status.

    Where there is none, one line says why and the checks are left out; with CI or SACHA_REQUIRE_BLENDER set that is a failure.
    """
    try:
        install_all()
        return check(executable(), build())
    except UnavailableError as error:
        print(f"Checks in a Blender executable left out: {error}", file=sys.stderr)  # noqa: T201
        return int(required())


if __name__ == "__main__":
    sys.exit(main())
