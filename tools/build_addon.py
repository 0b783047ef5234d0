"""Build the add-on as an extension that Blender installs, and let Blender's own tool judge it."""

from __future__ import annotations

import subprocess
import sys
import tomllib
from pathlib import Path

from blender_env import BLENDERS, ROOT, environment

__all__ = ["build", "built_path"]

SOURCE = ROOT / "addon"
TIME_LIMIT_S = 60


def built_path() -> Path:
    """Give where the extension lies once it is built; its name carries the version of the manifest."""
    manifest = tomllib.loads((SOURCE / "blender_manifest.toml").read_text())
    return ROOT / "dist" / f"{manifest['id']}-blender-{manifest['version']}.zip"


def build() -> Path:
    """Build and validate the extension, with the tool of the newest Blender that is installed here.

    Raises:
        SystemExit: the tool refuses the manifest or the files; it says why.
    """
    folder = environment(max(BLENDERS))
    tool = next(folder.glob("lib/python*/site-packages/bpy/*/scripts/addons_core/bl_pkg/cli/blender_ext.py"))
    target = built_path()
    target.parent.mkdir(exist_ok=True)
    aside = target.with_suffix(".part.zip")
    for arguments in (["build", "--source-dir", SOURCE, "--output-filepath", aside], ["validate", aside]):
        command = [folder / "bin" / "python", tool, *arguments]
        done = subprocess.run(command, check=False, capture_output=True, text=True, timeout=TIME_LIMIT_S)  # noqa: S603
        if done.returncode:
            aside.unlink(missing_ok=True)
            sys.exit(f"The add-on did not pass {arguments[0]}:\n{done.stdout}{done.stderr}")
    return aside.replace(target)


if __name__ == "__main__":
    print(build())  # noqa: T201
