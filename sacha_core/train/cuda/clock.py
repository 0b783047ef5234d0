"""Times of stages on a device, taken without waiting for it."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager

import torch

from sacha_core.stopwatch import Stopwatch, timed

__all__ = ["DeviceClock"]


class DeviceClock:
    """Marks where stages begin and end in the device's queue; `settle` adds up the times between.

    Args:
        device: whose queue; on the CPU stages are timed as they run.
    """

    def __init__(self, device: torch.device) -> None:
        self._queued = device.type == "cuda"
        self._marks: list[tuple[str, torch.cuda.Event, torch.cuda.Event]] = []

    @contextmanager
    def __call__(self, watch: Stopwatch | None, stage: str) -> Iterator[None]:
        """Time what is queued inside, where somebody wants to know."""
        if watch is None or not self._queued:
            with timed(watch, stage):
                yield
            return
        begin, end = (torch.cuda.Event(enable_timing=True) for _ in range(2))  # type: ignore[no-untyped-call]
        begin.record()
        yield
        end.record()
        self._marks.append((stage, begin, end))

    def settle(self, watch: Stopwatch | None) -> None:
        """Tell the stopwatch the times marked since the last call; waits for the device."""
        marks, self._marks = self._marks, []
        for stage, begin, end in marks:
            end.synchronize()
            if watch is not None:
                watch.tell(stage, begin.elapsed_time(end) / 1000)
