"""The images trained on: decoded once, kept as bytes, drawn in an order that a seed decides."""

from __future__ import annotations

from collections import deque
from collections.abc import Generator, Iterable
from concurrent.futures import Future, ThreadPoolExecutor
from dataclasses import dataclass
from threading import Lock
from typing import Literal

import numpy as np
from jaxtyping import UInt8

from sacha_core.interchange.capture import Capture, View
from sacha_core.parallel.pool import Pool
from sacha_core.perception.sensitivity_map import resized_sensitivity, sensitivity_map
from sacha_core.progress import Progress, Report, silent
from sacha_core.raster.camera import Camera

__all__ = ["Box", "Step", "Target", "TrainingViews", "decoded_ahead", "epoch_steps", "grouped", "spread_views"]

WHITE = 255
DECODERS = 2  # threads that decode what the cache has no room for
AHEAD = 16  # views that they may be ahead, but for those of one step
Box = tuple[int, int, int, int]  # left, top, right, bottom; pixels, exclusive
Step = tuple[int, ...]  # indices of views of one timestep


@dataclass(frozen=True)
class Target:
    """What a rendering of one view is compared with.

    Args:
        timestep: frame of the motion.
        camera: at the resolution trained at.
        image: (3, h, w) RGB.
        sensitivity: (h, w) reference sensitivity, 255 stands for 1.
        box: outside of which the image is white and nothing is sensitive; empty if it is all so.
    """

    timestep: int
    camera: Camera
    image: UInt8[np.ndarray, "3 h w"]
    sensitivity: UInt8[np.ndarray, "h w"]
    box: Box


class TrainingViews:
    """The training views of a capture, by index.

    Args:
        capture: where images come from.
        width: of the images trained on, pixels; None for each view's own.
        height: likewise.
        pad: see `sensitivity_map`.
        cache_bytes: of decoded images that are kept; what is beyond is decoded each time.
    """

    def __init__(
        self,
        capture: Capture,
        width: int | None = None,
        height: int | None = None,
        pad: Literal["replicate", "zero"] = "replicate",
        cache_bytes: int = 4 << 30,
    ) -> None:
        self._capture, self._width, self._height, self._pad = capture, width, height, pad
        self._room = cache_bytes
        self._kept: dict[int, Target] = {}
        self._lock = Lock()
        self.views: tuple[View, ...] = capture.train

    def __len__(self) -> int:
        """Give the number of views."""
        return len(self.views)

    def keeps(self, index: int) -> bool:
        """Tell whether a view is decoded already."""
        return index in self._kept

    def __getitem__(self, index: int) -> Target:
        """Give one view, decoded.

        Raises:
            DatasetError: its image cannot be decoded.
        """
        if index in self._kept:
            return self._kept[index]
        target = self._load(self.views[index])
        size = target.image.nbytes + target.sensitivity.nbytes
        with self._lock:
            if index not in self._kept and size <= self._room:
                self._room -= size
                self._kept[index] = target
        return target

    def preload(self, pool: Pool, report: Report = silent) -> None:
        """Decode the views that fit into the cache, by several threads."""
        first = self[0]
        fitting = min(len(self), 1 + self._room // (first.image.nbytes + first.sensitivity.nbytes))

        def load(worker: int, index: int) -> None:
            self[index]  # kept
            if worker == 0:  # the calling thread
                report(Progress("read images", len(self._kept), fitting))

        pool.run(load, fitting)

    def _load(self, view: View) -> Target:
        stored = self._capture.image(view)
        width, height = self._width or stored.shape[1], self._height or stored.shape[0]
        sensitivity = resized_sensitivity(sensitivity_map(stored, self._pad), width, height)
        resized = stored.shape[:2] != (height, width)
        image = self._capture.image(view, width, height) if resized else stored
        planar = np.ascontiguousarray(image.transpose(2, 0, 1))
        marked = (planar != WHITE).any(axis=0) | (sensitivity != 0)
        return Target(view.timestep, view.camera.resized(width, height), planar, sensitivity, box_of(marked))


def box_of(marked: np.ndarray) -> Box:
    """Give the smallest box around what is marked; (0, 0, 0, 0) if nothing is."""
    rows, columns = np.flatnonzero(marked.any(axis=1)), np.flatnonzero(marked.any(axis=0))
    if not len(rows):
        return (0, 0, 0, 0)
    return (int(columns[0]), int(rows[0]), int(columns[-1]) + 1, int(rows[-1]) + 1)


def decoded_ahead(views: TrainingViews, steps: Iterable[Step]) -> Generator[tuple[Target, ...]]:
    """Give the views of each step in turn; threads decode those of the next few steps that are not kept.

    Args:
        views: that indices are of.
        steps: may be without end.

    Raises:
        DatasetError: an image cannot be decoded; raised when its step comes.
    """
    waiting: deque[list[Target | Future[Target]]] = deque()
    decoders = ThreadPoolExecutor(DECODERS, "sacha-decode")  # which has no thread before something is to be decoded
    try:
        for step in steps:
            waiting.append([views[i] if views.keeps(i) else decoders.submit(views.__getitem__, i) for i in step])
            if sum(map(len, waiting)) > AHEAD:
                yield arrived(waiting.popleft())
        while waiting:
            yield arrived(waiting.popleft())
    finally:  # perhaps by the garbage collector, which must not wait for threads
        decoders.shutdown(wait=False, cancel_futures=True)


def arrived(targets: list[Target | Future[Target]]) -> tuple[Target, ...]:
    """Wait for those that are being decoded."""
    return tuple(target.result() if isinstance(target, Future) else target for target in targets)


def epoch_steps(views: tuple[View, ...], cameras: int, seed: int, epoch: int) -> list[Step]:
    """Give the steps in which an epoch shows all views: a function of seed and epoch, so that a resumed run needs no state for it.

    Args:
        views: all of them.
        cameras: that a step shows at most.
        seed: of the run.
        epoch: from 0.
    """
    rng = np.random.default_rng([seed, epoch, 1])
    steps = grouped(views, rng.permutation(len(views)).tolist(), cameras)
    return steps if cameras == 1 else [steps[i] for i in rng.permutation(len(steps))]


def grouped(views: tuple[View, ...], indices: Iterable[int], most: int) -> list[Step]:
    """Put views of one timestep together, in the order in which they come, at most so many in a step."""
    steps: list[list[int]] = []
    open_: dict[int, list[int]] = {}
    for index in indices:
        timestep = views[index].timestep
        if timestep not in open_:
            open_[timestep] = []
            steps.append(open_[timestep])
        open_[timestep].append(index)
        if len(open_[timestep]) == most:
            del open_[timestep]
    return [tuple(step) for step in steps]


def spread_views(views: tuple[View, ...], count: int) -> list[int]:
    """Give the indices of about `count` views: all those of evenly spaced timesteps, by timestep and camera.

    Views evenly spaced over (timestep, camera) would go by cameras in step wherever the spacing is near a multiple of their number: each
    camera would then look at a stretch of the motion of its own.
    """
    timesteps = sorted({view.timestep for view in views})
    wanted = min(max(round(count * len(timesteps) / len(views)), 1), len(timesteps))
    chosen = {timesteps[i] for i in np.linspace(0, len(timesteps) - 1, wanted).round().astype(int)}
    order = sorted(range(len(views)), key=lambda i: (views[i].timestep, views[i].camera_index))
    return [i for i in order if views[i].timestep in chosen]
