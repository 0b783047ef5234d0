"""Make the environments that the Blender tests run in: one for each supported Blender, and the system libraries it needs.

Run by `make`; needs nothing but Python 3.11, the version that these Blenders are built for.
"""

from __future__ import annotations

import ctypes
import os
import shutil
import subprocess
import sys
from collections.abc import Iterable
from pathlib import Path

__all__ = ["BLENDERS", "OLDEST", "ROOT", "UnavailableError", "environment", "executable", "install_all", "required"]

ROOT = Path(__file__).resolve().parents[1]
BLENDERS = {"4.5": "4.5.15", "5.0": "5.0.1"}  # release: version of the package bpy
OLDEST = {"4.2": "4.2.23"}  # the oldest that the manifest allows: tested by `make test-all`
PYTEST = "9.2.0"
PYTHON_OF_BLENDER = (3, 11)

# What bpy loads, and libEGL, without which a Workbench render ends the process: library -> Debian package.
LIBRARIES = {
    "libX11.so.6": "libx11-6",
    "libXrender.so.1": "libxrender1",
    "libXfixes.so.3": "libxfixes3",
    "libXi.so.6": "libxi6",
    "libxkbcommon.so.0": "libxkbcommon0",
    "libSM.so.6": "libsm6",
    "libGL.so.1": "libgl1",
    "libgomp.so.1": "libgomp1",
    "libEGL.so.1": "libegl1",
}

EXECUTABLE = ("blender", "python3-numpy")  # Debian's 3.4, and what it needs to run add-ons; for the smoke test


class UnavailableError(Exception):
    """What Blender needs is not here and may not be installed; the message says what to do by hand."""


def environment(release: str) -> Path:
    """Give the folder of the environment of one Blender release."""
    return ROOT / f".venv-bpy{release.replace('.', '')}"


def missing_packages() -> list[str]:
    """Give the Debian packages of the libraries that cannot be loaded."""
    return sorted({package for library, package in LIBRARIES.items() if not _loads(library)})


def executable() -> str:
    """Give a Blender executable: the one that SACHA_BLENDER names, the one on the path, or Debian's, which is installed.

    Raises:
        UnavailableError: there is none and none may be installed.
    """
    named = os.environ.get("SACHA_BLENDER") or shutil.which("blender")
    if named is None:
        install_packages(list(EXECUTABLE), f"no Blender executable: apt-get install {' '.join(EXECUTABLE)}")
        named = shutil.which("blender")
    if named is None or shutil.which(named) is None:
        raise UnavailableError(f"no Blender executable at {named}" if named else "no Blender executable")
    return named


def install_libraries() -> None:
    """Install the system libraries that are missing, where that is allowed.

    Raises:
        UnavailableError: it is not, or did not help.
    """
    missing = missing_packages() if sys.platform == "linux" else []
    if not missing:
        return
    install_packages(missing, f"Blender needs system libraries that are missing: apt-get install {' '.join(missing)}")
    if missing_packages():
        raise UnavailableError(f"installed, but not loadable: {' '.join(missing_packages())}")


def install_packages(packages: list[str], by_hand: str) -> None:
    """Install Debian packages, where that is allowed.

    Raises:
        UnavailableError: it is not, or fails; it says `by_hand`.
    """
    apt = shutil.which("apt-get")
    if apt is None or os.geteuid() != 0:
        raise UnavailableError(by_hand)
    print(f"Installing for the Blender tests: {' '.join(packages)}", flush=True)  # noqa: T201
    quiet = {"env": os.environ | {"DEBIAN_FRONTEND": "noninteractive"}, "stdin": subprocess.DEVNULL}
    for arguments in (["update", "-qq"], ["install", "-qq", "--yes", "--no-install-recommends", *packages]):
        if subprocess.run([apt, *arguments], check=False, **quiet).returncode:  # noqa: S603
            raise UnavailableError(by_hand)


def install_blender(release: str) -> None:
    """Make the environment of one release, or leave it as it is where it already holds the right versions.

    Raises:
        UnavailableError: this is not Blender's Python, or the installation failed.
    """
    wanted = [f"bpy=={(BLENDERS | OLDEST)[release]}", f"pytest=={PYTEST}"]
    folder = environment(release)
    stamp = folder / "installed.txt"
    if stamp.exists() and stamp.read_text().split() == wanted:
        return
    if sys.version_info[:2] != PYTHON_OF_BLENDER:
        version = ".".join(map(str, PYTHON_OF_BLENDER))
        raise UnavailableError(
            f"Blender {release} needs Python {version}; name one with: make BLENDER_PYTHON=/path/to/python{version}"
        )
    print(f"Installing Blender {release} as a Python module into {folder.name} (about 1 GB)", flush=True)  # noqa: T201
    shutil.rmtree(folder, ignore_errors=True)
    for command in (
        [sys.executable, "-m", "venv", folder],
        [folder / "bin" / "python", "-m", "pip", "install", "--quiet", "--disable-pip-version-check", *wanted],
    ):
        if subprocess.run(command, check=False, stdin=subprocess.DEVNULL).returncode:  # noqa: S603
            raise UnavailableError(f"could not install {' and '.join(wanted)} into {folder.name}")
    stamp.write_text("\n".join(wanted) + "\n")


def required() -> bool:
    """Tell whether a Blender that cannot be had is a failure: with CI or SACHA_REQUIRE_BLENDER set."""
    return any(os.environ.get(name, "") not in {"", "0"} for name in ("CI", "SACHA_REQUIRE_BLENDER"))


def _loads(library: str) -> bool:
    try:
        ctypes.CDLL(library)
    except OSError:
        return False
    return True


def install_all(releases: Iterable[str] = BLENDERS) -> None:
    """Install everything that building and testing the add-on needs.

    Args:
        releases: the Blenders to test in; those that the add-on is built with are always there.

    Raises:
        UnavailableError: something is missing that may not be installed.
    """
    install_libraries()
    for release in {**BLENDERS, **dict.fromkeys(releases)}:
        install_blender(release)


if __name__ == "__main__":
    try:
        install_all()
    except UnavailableError as error:
        sys.exit(str(error))
