"""Being asked to stop, and doing so at a moment when nothing is lost."""

from __future__ import annotations

import signal
import threading
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from types import FrameType

__all__ = ["stopping_gently"]


@contextmanager
def stopping_gently() -> Iterator[Callable[[], bool]]:
    """Let the first SIGTERM only ask to stop; the second one does what it did before.

    Yields:
        A function that tells whether somebody asked.
    """
    asked = threading.Event()
    if threading.current_thread() is not threading.main_thread():  # only there can signals be heard
        yield asked.is_set
        return

    def ask(number: int, frame: FrameType | None) -> None:  # noqa: ARG001  (signal's signature)
        asked.set()
        signal.signal(signal.SIGTERM, before)

    before = signal.signal(signal.SIGTERM, ask)
    try:
        yield asked.is_set
    finally:
        signal.signal(signal.SIGTERM, before)
