"""Screenshots of the add-on in a window that nobody sees: a Blender executable under a virtual display.

Usage: screenshots.py FOLDER [AVATAR [HEAD [MASKS]]]; without an avatar it shows one that the engine makes of the synthetic head.

Run by hand, to be looked at; what the panels draw is tested in `blender_tests/test_panels.py`. Needs Xvfb, which is installed where that is
allowed. Blenders before 4.2 get the add-on in their folder of add-ons.
"""

from __future__ import annotations

import os
import shutil
import subprocess
import sys
import tempfile
from pathlib import Path

from blender_env import ROOT, UnavailableError, executable, install_all, install_packages
from build_addon import build
from test_executable import clean_variables

__all__ = ["main"]

TIME_LIMIT_S = 300
DISPLAY = ("xvfb", "xauth", "xdotool", "imagemagick")
SIZE = (1600, 1200)


def main(arguments: list[str]) -> int:
    """Take them; give the exit status."""
    target, *given = [str(Path(one).resolve()) for one in arguments]
    Path(target).mkdir(parents=True, exist_ok=True)
    try:
        install_all()
        blender, extension = executable(), build()
        if None in map(shutil.which, ("xvfb-run", "xdotool", "import")):
            install_packages(list(DISPLAY), f"no virtual display: apt-get install {' '.join(DISPLAY)}")
    except UnavailableError as error:
        sys.exit(f"No screenshots: {error}")
    width, height = map(str, SIZE)
    with tempfile.TemporaryDirectory(prefix="sacha-blender-") as folder:
        command = ["xvfb-run", "-a", "-s", f"-screen 0 {width}x{height}x24", blender, "--factory-startup"]
        command += ["--window-geometry", "0", "0", width, height, "--python", str(ROOT / "blender_tests" / "window.py")]
        variables = os.environ | clean_variables(blender, extension, folder)
        done = subprocess.run(  # noqa: S603
            [*command, "--", target, *given], check=False, env=variables, stdin=subprocess.DEVNULL, timeout=TIME_LIMIT_S
        )
    return done.returncode


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
