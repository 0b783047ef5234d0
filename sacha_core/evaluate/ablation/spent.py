"""How long a training took in all, however often it was interrupted."""

from __future__ import annotations

import json
import time
from pathlib import Path

from sacha_core.files import write_aside
from sacha_core.progress import Progress, Report

__all__ = ["SpentTime", "spent_seconds"]

SPENT = "seconds.json"
SECONDS_BETWEEN = 5.0


class SpentTime:
    """Counts seconds and keeps them in a folder; what an interrupt undid is counted, too.

    Args:
        folder: where earlier ones may lie.
    """

    def __init__(self, folder: Path) -> None:
        self._path = folder / SPENT
        self._before, self._since = spent_seconds(folder), time.monotonic()
        self._kept = self._since

    def while_telling(self, report: Report) -> Report:
        """Give a report that also keeps the seconds now and then."""

        def tell(progress: Progress) -> None:
            report(progress)
            if time.monotonic() - self._kept > SECONDS_BETWEEN:
                self.keep()

        return tell

    def keep(self) -> float:
        """Write the seconds down; give them.

        Raises:
            OSError: they cannot be written.
        """
        self._kept = time.monotonic()
        seconds = self._before + self._kept - self._since
        with write_aside(self._path) as aside:
            aside.write_text(json.dumps({"seconds": round(seconds, 2)}) + "\n", encoding="utf-8")
        return seconds


def spent_seconds(folder: Path) -> float:
    """Give the seconds that a folder's training took so far; 0 where nobody counted."""
    try:
        return float(json.loads((folder / SPENT).read_bytes())["seconds"])
    except (OSError, ValueError, KeyError, TypeError):
        return 0.0
