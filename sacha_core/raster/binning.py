"""From splats to the sorted list of each tile: projection, depth sort, and dealing out."""

from __future__ import annotations

from dataclasses import dataclass
from itertools import pairwise

import numpy as np
from jaxtyping import Float, Int

from sacha_core.errors import SachaError
from sacha_core.raster.buffers import Buffers
from sacha_core.raster.camera import Camera
from sacha_core.raster.kernels.bins import BUCKETS, PASSES, deal, key_bounds, sort_by_depth
from sacha_core.raster.kernels.lanes import LANES
from sacha_core.raster.kernels.layout import RECORD
from sacha_core.raster.kernels.project import PROJECT_SCRATCH, project
from sacha_core.raster.pool import Pool, even_ranges
from sacha_core.raster.splats import Splats
from sacha_core.raster.view import lane_coordinates, tile_grid, view_parameters

__all__ = ["Binner", "Bins"]

JOBS_PER_THREAD = 8  # so that threads finish together
KEYS_PER_GAUSSIAN = 4  # room at first; doubled until it suffices
MIN_ROOM = 4096  # keys of a job
MAX_KEYS = 1 << 26


@dataclass(frozen=True)
class Bins:
    """Splats projected and dealt out to tiles; arrays belong to the binner and hold until its next call.

    Args:
        view: camera parameters as the kernels want them.
        inputs: flat means, scales, quaternions and opacities, and the same of the last incomplete block.
        chunks: bounds of the ranges of Gaussians that jobs take.
        ranges: bounds of the ranges of tiles that jobs take, about equal in entries.
        records: (n, 16), flat.
        depth: (n,) metres along the camera's axis, filled up to whole blocks.
        first: (n,) position of each Gaussian's first key.
        count: (n,) number of its keys, one for each tile that it touches.
        capacity: positions are below this.
        start: (tiles + 1,) first entry of each tile.
        owner: of each entry: Gaussian << 10 | first row << 5 | last row.
        origin: of each entry: position of its key.
        done: (tiles,) where blending stopped; written by the forward kernel.
        x_lanes, y_lanes: pixel coordinates, see `lane_coordinates`.
        serial: number of the call that made them.
    """

    view: Float[np.ndarray, " p"]
    inputs: tuple[np.ndarray, ...]
    chunks: list[int]
    ranges: list[int]
    records: Float[np.ndarray, " a"]
    depth: Float[np.ndarray, " m"]
    first: Int[np.ndarray, " n"]
    count: Int[np.ndarray, " n"]
    capacity: int
    start: Int[np.ndarray, " t"]
    owner: Int[np.ndarray, " e"]
    origin: Int[np.ndarray, " e"]
    done: Int[np.ndarray, " u"]
    x_lanes: Float[np.ndarray, " x"]
    y_lanes: Float[np.ndarray, " y"]
    serial: int


@dataclass(frozen=True)
class Projection:
    """What the first stage gives; fields as in `Bins`, and `keys` in one slice of `room` for each job, of which `used` are filled."""

    view: Float[np.ndarray, " p"]
    inputs: tuple[np.ndarray, ...]
    chunks: list[int]
    records: Float[np.ndarray, " a"]
    depth: Float[np.ndarray, " m"]
    first: Int[np.ndarray, " n"]
    count: Int[np.ndarray, " n"]
    keys: Int[np.ndarray, " k"]
    room: int
    used: list[int]


class Binner:
    """Projects splats and sorts them into tiles.

    Args:
        pool: threads.
        buffers: where arrays are kept from call to call.
        near: what is closer is left out, metres.
    """

    def __init__(self, pool: Pool, buffers: Buffers, near: float) -> None:
        self.serial = 0
        self._pool = pool
        self._buffers = buffers
        self._near = near
        self._keys_per_gaussian = KEYS_PER_GAUSSIAN

    def bin(self, splats: Splats, camera: Camera) -> Bins:
        """Project, sort and deal out.

        Raises:
            OptionError: the camera is unusable.
            SachaError: the splats touch more tiles than memory is given for.
        """
        p = self._project(splats, camera)
        space, n = self._buffers.space, len(splats)
        order, swap = space("order", n, np.int32), space("swap", n, np.int32)
        histogram = space("histogram", PASSES * BUCKETS, np.int64)
        visible = sort_by_depth(p.depth.view(np.uint32), p.count, order, swap, histogram)
        columns, rows = tile_grid(camera)
        entries, tiles = sum(p.used), columns * rows
        start, cursor = space("start", tiles + 1, np.int64), space("cursor", tiles, np.int64)
        owner, origin = space("owner", entries, np.int64), space("origin", entries, np.int32)
        deal(order, visible, p.first, p.count, p.keys, tiles, start, cursor, owner, origin)
        x_lanes, y_lanes = lane_coordinates(camera)
        return Bins(
            p.view, p.inputs, p.chunks, self._tile_ranges(start), p.records, p.depth, p.first, p.count, len(p.keys),
            start, owner, origin, space("done", tiles, np.int64), x_lanes, y_lanes, self.serial,
        )  # fmt: skip

    def touched(self, splats: Splats, camera: Camera) -> tuple[int, int, int, int]:
        """Give left, top, right and bottom of the part of the image that the splats touch, in pixels, or of all where there is none."""
        p = self._project(splats, camera)
        columns, _ = tile_grid(camera)
        slices = [p.keys[k * p.room : k * p.room + used] for k, used in enumerate(p.used) if used > 0]
        if not slices:
            return 0, 0, camera.width, camera.height
        bounds = np.array([key_bounds(keys, columns) for keys in slices])
        left, top = bounds[:, :2].min(axis=0)
        right, bottom = bounds[:, 2:].max(axis=0)
        return int(left), int(top), min(int(right), camera.width), int(bottom)

    def _project(self, splats: Splats, camera: Camera) -> Projection:
        """Project and emit keys, with more room until they fit."""
        self.serial += 1
        n, view, columns = len(splats), view_parameters(camera, self._near), tile_grid(camera)[0]
        arrays = (splats.means, splats.scales, splats.quaternions, splats.opacities)
        inputs = (*(a.ravel() for a in arrays), *(last_block(a) for a in arrays))
        space, blocks = self._buffers.space, -(-n // LANES)
        records, depth = (
            space("records", blocks * LANES * RECORD, np.float32),
            space("depth", blocks * LANES, np.float32),
        )
        first, count = space("first", n, np.int64), space("count", n, np.int32)
        scratch = space("project", self._pool.threads * PROJECT_SCRATCH, np.float32).reshape(self._pool.threads, -1)
        chunks = [LANES * b for b in even_ranges(blocks, JOBS_PER_THREAD * self._pool.threads)]
        jobs, largest = len(chunks) - 1, max((b - a for a, b in pairwise(chunks)), default=0)
        while True:
            room = max(self._keys_per_gaussian * largest, MIN_ROOM)
            keys, used = space("keys", jobs * room, np.int32), [0] * jobs

            def job(worker: int, k: int, keys: np.ndarray = keys, room: int = room, used: list[int] = used) -> None:
                used[k] = project(
                    *inputs, splats.colours.ravel(), n, splats.channels, view, chunks[k], chunks[k + 1], k * room, columns,
                    records, depth, keys[k * room : (k + 1) * room], first, count, scratch[worker],
                )  # fmt: skip

            self._pool.run(job, jobs)
            if min(used, default=0) >= 0:
                return Projection(view, inputs, chunks, records, depth, first, count, keys, room, used)
            self._keys_per_gaussian = 2 * room // largest
            if 2 * jobs * room > MAX_KEYS:
                self._keys_per_gaussian = KEYS_PER_GAUSSIAN
                raise SachaError(f"the splats touch more than {MAX_KEYS} tiles together; are their scales in metres?")

    def _tile_ranges(self, start: np.ndarray) -> list[int]:
        """Give bounds of ranges of tiles with about equal numbers of entries."""
        tiles = len(start) - 1
        load = start + np.arange(tiles + 1) * TILE_COST
        jobs = min(tiles, JOBS_PER_THREAD * self._pool.threads)
        bounds = np.searchsorted(load, np.linspace(0, load[-1], jobs + 1)[1:-1])
        return [0, *bounds.tolist(), tiles]


TILE_COST = 8  # entries that take as long as a tile's first and last steps


def last_block(array: np.ndarray) -> np.ndarray:
    """Give the rows beyond the last whole block of lanes, filled up with zeros to a block, flat."""
    block = np.zeros((LANES, *array.shape[1:]), np.float32)
    rest = len(array) % LANES
    block[:rest] = array[len(array) - rest :]
    return block.ravel()
