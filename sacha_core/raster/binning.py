"""From splats to the list of each tile, front to back: projection, depth sort, and dealing out."""

from __future__ import annotations

from dataclasses import dataclass
from itertools import pairwise

import numpy as np
from jaxtyping import Float, Int

from sacha_core.errors import SachaError
from sacha_core.parallel.buffers import Buffers
from sacha_core.parallel.kernels.lanes import LANES
from sacha_core.parallel.pool import Pool, even_ranges
from sacha_core.raster.camera import Camera
from sacha_core.raster.kernels.batch import LOOK_AHEAD
from sacha_core.raster.kernels.deal import count_up, deal, share_out
from sacha_core.raster.kernels.depth_order import BUCKETS, PASSES, sort_by_depth
from sacha_core.raster.kernels.emit import EMIT_SCRATCH
from sacha_core.raster.kernels.grid import place_lanes
from sacha_core.raster.kernels.layout import GAUSSIAN_MASK, RECORD, TILE_HEIGHT, TILE_WIDTH
from sacha_core.raster.kernels.project import project
from sacha_core.raster.splats import Splats
from sacha_core.raster.view import tile_grid, view_parameters
from sacha_core.stopwatch import Timer, timed

__all__ = ["Binner", "Bins"]

JOBS_PER_THREAD = 8  # so that threads finish together
KEYS_PER_GAUSSIAN = 6  # room at first; doubled until it suffices
MIN_ROOM = 4096  # keys of a job
MAX_KEYS = 1 << 26  # room of all jobs together, whatever was learned from scenes before: more do not fit into an entry


@dataclass(frozen=True)
class Projection:
    """Splats as a camera sees them; arrays belong to the binner and hold until its next call.

    Args:
        view: camera parameters as the kernels want them.
        inputs: flat means, scales, quaternions, opacities and colours, and the same of the last incomplete block.
        chunks: bounds of the ranges of Gaussians that jobs take.
        records: (n, 16), flat.
        depths: metres along the camera's axis, filled up to whole blocks; infinite for what is not seen.
        keys: of all Gaussians, see `layout`, with unused room between them.
        span: (n, 2), flat: position of each Gaussian's first key and the number of its keys, one for each tile that it touches.
        histograms: (jobs, tiles) number of keys of each tile.
    """

    view: Float[np.ndarray, " p"]
    inputs: tuple[np.ndarray, ...]
    chunks: list[int]
    records: Float[np.ndarray, " a"]
    depths: Float[np.ndarray, " m"]
    keys: Int[np.ndarray, " k"]
    span: Int[np.ndarray, " s"]
    histograms: Int[np.ndarray, "j t"]


@dataclass(frozen=True)
class Bins:
    """Splats dealt out to tiles; arrays belong to the binner and hold until its next call.

    Args:
        projection: of the splats.
        span: (n, 2) the projection's.
        capacity: positions are below this.
        start: (tiles + 1,) first entry of each tile.
        entries: key position << 36 | Gaussian << 10 | first row << 5 | last row.
        ranges: bounds of the ranges of tiles that jobs take, about equal in entries.
        done: (tiles,) where blending stopped; written by the forward kernel.
        x_lanes: pixel coordinates, see `place_lanes`.
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

    def __init__(self, pool: Pool, buffers: Buffers, near: float, stopwatch: Timer | None = None) -> None:
        self.serial = 0
        self._pool = pool
        self._space = buffers.space
        self._near = near
        self._watch = stopwatch
        self._room = MIN_ROOM  # of a job, as much as any scene so far has needed

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
        with timed(self._watch, "deal"):
            start, entries = self._deal(projection, order[:n_seen])
        columns, rows = tile_grid(camera)
        x_lanes = space("x_lanes", columns * LANES, np.float32)
        y_lanes = space("y_lanes", rows * TILE_HEIGHT * TILE_WIDTH, np.float32)
        place_lanes(float(camera.cx), float(camera.cy), x_lanes, y_lanes)
        jobs = min(columns * rows, JOBS_PER_THREAD * self._pool.threads)
        ranges = space("ranges", jobs + 1, np.int64)
        share_out(start, jobs, ranges)
        return Bins(
            projection, projection.span[: 2 * n].reshape(n, 2), len(projection.keys), start, entries, ranges.tolist(),
            space("done", len(start) - 1, np.int64), x_lanes, y_lanes, self.serial,
        )  # fmt: skip

    def _project(self, splats: Splats, camera: Camera) -> Projection:
        """Project into records, and emit keys, with more room until they fit."""
        self.serial += 1
        n, view = len(splats), view_parameters(camera, self._near)
        if n > GAUSSIAN_MASK:
            raise SachaError(f"there are {n} Gaussians, expected at most {GAUSSIAN_MASK}")
        arrays = (splats.means, splats.scales, splats.quaternions, splats.opacities, splats.colours)
        inputs = (*(a.ravel() for a in arrays), *(last_block(a) for a in arrays))
        blocks = -(-n // LANES)
        chunks = [LANES * b for b in even_ranges(blocks, JOBS_PER_THREAD * self._pool.threads)]
        jobs, largest = len(chunks) - 1, max((b - a for a, b in pairwise(chunks)), default=0)
        columns, rows = tile_grid(camera)
        records = self._space("records", blocks * LANES * RECORD, np.float32)
        depths = self._space("depths", blocks * LANES, np.float32)
        span = self._space("span", blocks * LANES * 2, np.int32)
        histograms = self._space("histograms", jobs * columns * rows, np.int32).reshape(jobs, columns * rows)
        scratch = self._space("emit", self._pool.threads * EMIT_SCRATCH, np.int32).reshape(-1, EMIT_SCRATCH)
        most = MAX_KEYS // max(jobs, 1)
        while True:
            room = min(max(KEYS_PER_GAUSSIAN * largest, self._room), most)
            keys, used = self._space("keys", jobs * room, np.int32), [0] * jobs

            def job(worker: int, k: int, keys: np.ndarray = keys, room: int = room, used: list[int] = used) -> None:
                used[k] = project(
                    *inputs, n, splats.channels, view, columns, chunks[k], chunks[k + 1], records, depths,
                    k * room, keys[k * room : (k + 1) * room], span, histograms[k], scratch[worker],
                )  # fmt: skip

            with timed(self._watch, "project"):
                self._pool.run(job, jobs)
            if min(used, default=0) >= 0:
                return Projection(view, inputs, chunks, records, depths, keys, span, histograms)
            self._room = 2 * room
            if room == most:
                self._room = MIN_ROOM
                raise SachaError(f"the splats touch more than {MAX_KEYS} tiles together; are their scales in metres?")

    def _deal(
        self, projection: Projection, order: Int[np.ndarray, " s"]
    ) -> tuple[Int[np.ndarray, " t"], Int[np.ndarray, " e"]]:
        """Deal the keys of Gaussians in this order out to the tiles: where each tile's entries start, and all entries."""
        tiles, threads = projection.histograms.shape[1], self._pool.threads
        start, cursors = (
            self._space("start", tiles + 1, np.int64),
            self._space("cursors", 2 * tiles, np.int64).reshape(2, tiles),
        )
        total = count_up(projection.histograms, start, *cursors)
        entries = self._space("entries", total + LOOK_AHEAD, np.int64)
        middle = len(order) if threads == 1 else len(order) // 2
        sides = ((0, middle, 1), (len(order) - 1, middle - 1, -1))
        bands = [0, *np.searchsorted(start, even_ranges(total, max(threads // 2, 1))[1:-1]).tolist(), tiles]

        def job(_: int, k: int) -> None:
            side, band = k % 2, k // 2
            deal(order, *sides[side], projection.span, projection.keys, *bands[band : band + 2], cursors[side], entries)

        self._pool.run(job, 2 * (len(bands) - 1))
        return start, entries


def last_block(array: Float[np.ndarray, "n ..."]) -> Float[np.ndarray, " b"]:
    """Give the rows beyond the last whole block of lanes, filled up with zeros to a block, flat."""
    block = np.zeros((LANES, *array.shape[1:]), np.float32)
    rest = len(array) % LANES
    block[:rest] = array[len(array) - rest :]
    return block.ravel()
