"""The stand-in for `tmc3` and GeS-TM (`fake_tmc3.py`) as a program on disk."""

from __future__ import annotations

import sys
from pathlib import Path

FAKE = Path(__file__).parent / "fake_tmc3.py"


def executable(path: Path) -> Path:
    """Write the stand-in as an executable file, under a name by which it knows which program to be."""
    path.write_text(
        f'#!/bin/sh\nexec "{sys.executable}" -c "import sys; sys.argv[0] = \\"$0\\"; exec(open(\\"{FAKE}\\").read())" "$@"\n'
    )
    path.chmod(0o755)
    return path
