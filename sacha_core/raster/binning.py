"""From splats to the list of each tile, front to back: projection, depth sort, and dealing out."""

from __future__ import annotations

from dataclasses import dataclass
from itertools import pairwise

import numpy as np
from jaxtyping import Float, Int

from sacha_core.errors import SachaError
from sacha_core.raster.buffers import Buffers
from sacha_core.raster.camera import Camera
from sacha_core.raster.kernels.batch import LOOK_AHEAD
from sacha_core.raster.kernels.depth_order import BUCKETS, INFINITE, PASSES, sort_by_depth
from sacha_core.raster.kernels.emit import EMIT_SCRATCH, count_up, deal, emit
from sacha_core.raster.kernels.lanes import LANES
from sacha_core.raster.kernels.layout import GAUSSIAN_MASK, R_COLUMNS, R_ROWS, RECORD
from sacha_core.raster.kernels.project import project
from sacha_core.raster.pool import Pool, even_ranges
from sacha_core.raster.splats import Splats
from sacha_core.raster.view import lane_coordinates, tile_grid, view_parameters
from sacha_core.stopwatch import Stopwatch, timed

__all__ = ["Binner", "Bins"]

JOBS_PER_THREAD = 8  # so that threads finish together
TILE_COST = 8  # entries that take as long as a tile's first and last steps
KEYS_PER_GAUSSIAN = 6  # room at first; doubled until it suffices
MIN_ROOM = 4096  # keys of a job
MAX_KEYS = 1 << 26


@dataclass(frozen=True)
class Projection:
    """Splats as a camera sees them; arrays belong to the binner and hold until its next call.

    Args:
        view: camera parameters as the kernels want them.
        inputs: flat means, scales, quaternions, opacities and colours, and the same of the last incomplete block.
        chunks: bounds of the ranges of Gaussians that jobs take.
        records: (n, 16), flat.
        depths: metres along the camera's axis, filled up to whole blocks; infinite for what is not seen.
    """

    view: Float[np.ndarray, " p"]
    inputs: tuple[np.ndarray, ...]
    chunks: list[int]
    records: Float[np.ndarray, " a"]
    depths: Float[np.ndarray, " m"]


@dataclass(frozen=True)
class Bins:
    """Splats dealt out to tiles; arrays belong to the binner and hold until its next call.

    Args:
        projection: of the splats.
        span: (n, 2) position of each Gaussian's first key and the number of its keys, one for each tile that it touches.
        capacity: positions are below this.
        start: (tiles + 1,) first entry of each tile.
        entries: key position << 36 | Gaussian << 10 | first row << 5 | last row.
        ranges: bounds of the ranges of tiles that jobs take, about equal in entries.
        done: (tiles,) where blending stopped; written by the forward kernel.
        x_lanes: pixel coordinates, see `lane_coordinates`.
        y_lanes: likewise.
        serial: number of the call that made them.
    """

    projection: Projection
    span: Int[np.ndarray, "n 2"]
    capacity: int
    start: Int[np.ndarray, " t"]
    entries: Int[np.ndarray, " e"]
    ranges: list[int]
    done: Int[np.ndarray, " u"]
    x_lanes: Float[np.ndarray, " x"]
    y_lanes: Float[np.ndarray, " y"]
    serial: int


class Binner:
    """Projects splats and sorts them into tiles.

    Args:
        pool: threads.
        buffers: where arrays are kept from call to call.
        near: what is closer is left out, metres.
        stopwatch: told how long the stages take.
    """

    def __init__(self, pool: Pool, buffers: Buffers, near: float, stopwatch: Stopwatch | None = None) -> None:
        self.serial = 0
        self._pool = pool
        self._space = buffers.space
        self._near = near
        self._watch = stopwatch
        self._keys_per_gaussian = KEYS_PER_GAUSSIAN

    def bin(self, splats: Splats, camera: Camera) -> Bins:
        """Project, sort and deal out.

        Raises:
            OptionError: the camera is unusable.
            SachaError: the splats touch more tiles than memory is given for.
        """
        projection, n, space = self._project(splats, camera), len(splats), self._space
        order, swap = space("order", n, np.int32), space("swap", n, np.int32)
        histogram = space("histogram", PASSES * BUCKETS, np.int64)
        with timed(self._watch, "sort"):
            n_seen = sort_by_depth(projection.depths.view(np.uint32), n, order, swap, histogram)
        columns, rows = tile_grid(camera)
        tiles = columns * rows
        chunks = even_ranges(n_seen, JOBS_PER_THREAD * self._pool.threads)
        cursors = space("cursors", (len(chunks) - 1) * tiles, np.int32).reshape(-1, tiles)
        span = space("span", 2 * n, np.int32)
        span[:] = 0
        with timed(self._watch, "emit"):
            keys, room, used = self._emit(projection, order, chunks, columns, cursors, span)
        start = space("start", tiles + 1, np.int64)
        count_up(cursors, start)
        entries = space("entries", sum(used) + LOOK_AHEAD, np.int64)

        def job(_: int, k: int) -> None:
            deal(keys[k * room :], used[k], k * room, cursors[k], entries)

        with timed(self._watch, "deal"):
            self._pool.run(job, len(used))
        x_lanes, y_lanes = lane_coordinates(camera)
        return Bins(
            projection, span.reshape(n, 2), len(keys), start, entries, self._tile_ranges(start), space("done", tiles, np.int64),
            x_lanes, y_lanes, self.serial,
        )  # fmt: skip

    def touched(self, splats: Splats, camera: Camera) -> tuple[int, int, int, int]:
        """Give left, top, right and bottom of the part of the image that the splats touch, in pixels; all of it where there is none."""
        projection, n = self._project(splats, camera), len(splats)
        seen = projection.depths[:n].view(np.uint32) < INFINITE
        words = projection.records.view(np.int32).reshape(-1, RECORD)[:n][seen]
        if not len(words):
            return 0, 0, camera.width, camera.height
        columns, rows = words[:, R_COLUMNS], words[:, R_ROWS]
        lows, highs = ((a & 0xFFFF).min() for a in (columns, rows)), ((a >> 16).max() + 1 for a in (columns, rows))
        left, top, right, bottom = (int(side) for side in (*lows, *highs))
        return left, top, right, bottom

    def _project(self, splats: Splats, camera: Camera) -> Projection:
        """Project into records."""
        self.serial += 1
        n, view = len(splats), view_parameters(camera, self._near)
        if n > GAUSSIAN_MASK:
            raise SachaError(f"there are {n} Gaussians, expected at most {GAUSSIAN_MASK}")
        arrays = (splats.means, splats.scales, splats.quaternions, splats.opacities, splats.colours)
        inputs = (*(a.ravel() for a in arrays), *(last_block(a) for a in arrays))
        blocks = -(-n // LANES)
        records = self._space("records", blocks * LANES * RECORD, np.float32)
        depths = self._space("depths", blocks * LANES, np.float32)
        chunks = [LANES * b for b in even_ranges(blocks, JOBS_PER_THREAD * self._pool.threads)]

        def job(_: int, k: int) -> None:
            project(*inputs, n, splats.channels, view, chunks[k], chunks[k + 1], records, depths)

        with timed(self._watch, "project"):
            self._pool.run(job, len(chunks) - 1)
        return Projection(view, inputs, chunks, records, depths)

    def _emit(
        self,
        projection: Projection,
        order: Int[np.ndarray, " n"],
        chunks: list[int],
        columns: int,
        histograms: Int[np.ndarray, "j t"],
        span: Int[np.ndarray, " s"],
    ) -> tuple[Int[np.ndarray, " k"], int, list[int]]:
        """Emit keys, with more room until they fit: keys in one slice for each job, the slices' length, and how much of each is used."""
        records, threads = projection.records, self._pool.threads
        words = records.view(np.int32)
        scratch = self._space("emit", threads * EMIT_SCRATCH, np.float32).reshape(threads, EMIT_SCRATCH)
        jobs, largest = len(chunks) - 1, max((b - a for a, b in pairwise(chunks)), default=0)
        while True:
            room = max(self._keys_per_gaussian * largest, MIN_ROOM)
            keys, used = self._space("keys", jobs * room, np.int64), [0] * jobs

            def job(worker: int, k: int, keys: np.ndarray = keys, room: int = room, used: list[int] = used) -> None:
                used[k] = emit(
                    order, chunks[k], chunks[k + 1], records, words, projection.view, columns, k * room,
                    keys[k * room : (k + 1) * room], histograms[k], span, scratch[worker],
                )  # fmt: skip

            self._pool.run(job, jobs)
            if min(used, default=0) >= 0:
                return keys, room, used
            self._keys_per_gaussian = -(-2 * room // largest)
            if 2 * jobs * room > MAX_KEYS:
                self._keys_per_gaussian = KEYS_PER_GAUSSIAN
                raise SachaError(f"the splats touch more than {MAX_KEYS} tiles together; are their scales in metres?")

    def _tile_ranges(self, start: Int[np.ndarray, " t"]) -> list[int]:
        """Give bounds of ranges of tiles with about equal numbers of entries."""
        tiles = len(start) - 1
        load = start + np.arange(tiles + 1) * TILE_COST
        jobs = min(tiles, JOBS_PER_THREAD * self._pool.threads)
        bounds = np.searchsorted(load, np.linspace(0, load[-1], jobs + 1)[1:-1])
        return [0, *bounds.tolist(), tiles]


def last_block(array: Float[np.ndarray, "n ..."]) -> Float[np.ndarray, " b"]:
    """Give the rows beyond the last whole block of lanes, filled up with zeros to a block, flat."""
    block = np.zeros((LANES, *array.shape[1:]), np.float32)
    rest = len(array) % LANES
    block[:rest] = array[len(array) - rest :]
    return block.ravel()
