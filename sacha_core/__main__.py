"""`python -m sacha_core`: the same as the shell command `sacha`."""

from __future__ import annotations

import sys

from sacha_core.cli import main

if __name__ == "__main__":
    sys.exit(main())
