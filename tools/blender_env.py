"""Make the environments that the Blender tests run in: one for each supported Blender, and the system libraries it needs.

Run by `make`; needs nothing but Python 3.11, the version that these Blenders are built for.
"""

from __future__ import annotations

import ctypes
import os
import shutil
import subprocess
import sys
from pathlib import Path

__all__ = ["BLENDERS", "ROOT", "UnavailableError", "environment", "install_all"]

ROOT = Path(__file__).resolve().parents[1]
BLENDERS = {"4.5": "4.5.15", "5.0": "5.0.1"}  # release: version of the package bpy
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


class UnavailableError(Exception):
    """What Blender needs is not here and may not be installed; the message says what to do by hand."""


def environment(release: str) -> Path:
    """Give the folder of the environment of one Blender release."""
    return ROOT / f".venv-bpy{release.replace('.', '')}"


def missing_packages() -> list[str]:
    """Give the Debian packages of the libraries that cannot be loaded."""
    return sorted({package for library, package in LIBRARIES.items() if not _loads(library)})


def install_libraries() -> None:
    """Install the system libraries that are missing, where that is allowed.

    Raises:
        UnavailableError: it is not, or did not help.
    """
    missing = missing_packages() if sys.platform == "linux" else []
    if not missing:
        return
    by_hand = f"Blender needs system libraries that are missing: apt-get install {' '.join(missing)}"
    apt = shutil.which("apt-get")
    if apt is None or os.geteuid() != 0:
        raise UnavailableError(by_hand)
    print(f"Installing system libraries for Blender: {' '.join(missing)}", flush=True)  # noqa: T201
    quiet = {"env": os.environ | {"DEBIAN_FRONTEND": "noninteractive"}, "stdin": subprocess.DEVNULL}
    for arguments in (["update", "-qq"], ["install", "-qq", "--yes", "--no-install-recommends", *missing]):
        if subprocess.run([apt, *arguments], check=False, **quiet).returncode:  # noqa: S603
            raise UnavailableError(by_hand)
    if missing_packages():
        raise UnavailableError(by_hand)


def install_blender(release: str) -> None:
    """Make the environment of one release, or leave it as it is where it already holds the right versions.

    Raises:
        UnavailableError: this is not Blender's Python, or the installation failed.
    """
    wanted = [f"bpy=={BLENDERS[release]}", f"pytest=={PYTEST}"]
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


def _loads(library: str) -> bool:
    try:
        ctypes.CDLL(library)
    except OSError:
        return False
    return True


def install_all() -> None:
    """Install everything that building and testing the add-on needs.

    Raises:
        UnavailableError: something is missing that may not be installed.
    """
    install_libraries()
    for release in BLENDERS:
        install_blender(release)


if __name__ == "__main__":
    try:
        install_all()
    except UnavailableError as error:
        sys.exit(str(error))
