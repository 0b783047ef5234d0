"""Telling how far work is only as often as somebody wants to hear it."""

from __future__ import annotations

import math
import time
from threading import Lock

from sacha_core.progress import Progress, Report

__all__ = ["SECONDS_BETWEEN", "paced"]

SECONDS_BETWEEN = 0.2


def paced(report: Report, seconds: float = SECONDS_BETWEEN) -> Report:
    """Give a report that leaves out what comes sooner after the last of the same stage; ends of stages never.

    Args:
        report: who is told; called by one thread at a time.
        seconds: between two of the same stage.
    """
    lock, told = Lock(), dict[str, float]()

    def tell(progress: Progress) -> None:
        now = time.monotonic()
        with lock:
            if progress.done < progress.total and now - told.get(progress.stage, -math.inf) < seconds:
                return
            told[progress.stage] = now
            report(progress)

    return tell
