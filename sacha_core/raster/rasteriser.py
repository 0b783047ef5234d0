"""Draws Gaussians on the CPU, forward and backward."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from jaxtyping import Bool, Float

from sacha_core.errors import OptionError
from sacha_core.parallel.buffers import Buffers
from sacha_core.parallel.pool import Pool
from sacha_core.raster.binning import Binner, Bins
from sacha_core.raster.camera import Camera
from sacha_core.raster.kernels.blend import BLEND_SCRATCH, blend
from sacha_core.raster.kernels.blend_backward import BACKWARD_SCRATCH, blend_backward
from sacha_core.raster.kernels.blend_cover import blend_cover
from sacha_core.raster.kernels.blend_peaks import blend_peaks, gather_peaks
from sacha_core.raster.kernels.blend_removal import IMAGES, KINDS, REMOVAL_SCRATCH, blend_removal
from sacha_core.raster.kernels.blend_weights import blend_weights
from sacha_core.raster.kernels.layout import RECORD
from sacha_core.raster.kernels.project_backward import GATHER_SCRATCH, gather_weights, project_backward
from sacha_core.raster.removal import RemovalChanges
from sacha_core.raster.splats import MAX_CHANNELS, SplatGradients, Splats
from sacha_core.stopwatch import Timer, timed

__all__ = ["NEAR", "Frame", "HalfWay", "Rasteriser", "Splats"]

NEAR = 0.1  # metres; closer, a few splats would cover the image
SCRATCH = max(BLEND_SCRATCH, BACKWARD_SCRATCH, REMOVAL_SCRATCH, GATHER_SCRATCH)


@dataclass(frozen=True)
class Frame:
    """One drawn image and what the backward pass needs.

    `image` and `transmittance` belong to the rasteriser and hold until its next call of `forward`: copy what is to be
    kept, and do not write to them before `backward`.

    Args:
        image: (c, h, w) blended colours over the background.
        transmittance: (h, w) how much of the background is seen, 0 to 1.
        visible: (n,) which Gaussians touch a tile of the image with an alpha of at least 1/255.
        splats: what was drawn.
        camera: from where.
        background: c numbers.
        bins: the splats of each tile.
    """

    image: Float[np.ndarray, "c h w"]
    transmittance: Float[np.ndarray, "h w"]
    visible: Bool[np.ndarray, " n"]
    splats: Splats
    camera: Camera
    background: tuple[np.float32, ...]
    bins: Bins


@dataclass(frozen=True)
class HalfWay:
    """Gradients that have come back to the entries of the tiles, and not through the projection yet.

    Args:
        slopes: where `project_backward` will write them; hold until the rasteriser's next pass.
        chunks: bounds of ranges of Gaussians that jobs take, multiples of 16 but for the last.
        arguments: what `project_backward` wants after the range and the space to work in.
        scratch: (threads, s) that space.
    """

    slopes: SplatGradients
    chunks: list[int]
    arguments: tuple[Any, ...]
    scratch: Float[np.ndarray, "t s"]


class Rasteriser:
    """Draws splats as 3D Gaussian Splatting does, on some threads; owns their pool and its buffers, so one call at a time.

    The result does not depend on the number of threads, to the bit.

    Args:
        threads: how many threads; None for one on each processor, or those of `pool`.
        near: what is closer to the camera's plane than this is not drawn, metres.
        pool: threads that others use too, never at the same time; None for threads of its own.
        stopwatch: told how long the stages take: project, sort, deal, blend, blend backward, project backward.

    Raises:
        OptionError: `threads` is below 1, or differs from the pool's.

    Source: Kerbl et al., 3D Gaussian Splatting, SIGGRAPH 2023; thresholds and the clamped Jacobian as gsplat has them.
    """

    def __init__(
        self,
        threads: int | None = None,
        near: float = NEAR,
        pool: Pool | None = None,
        stopwatch: Timer | None = None,
    ) -> None:
        self._pool = pool or Pool(threads)
        if threads not in (None, self._pool.threads):
            raise OptionError(f"{threads} threads were asked for, but the pool given has {self._pool.threads}")
        self._buffers = Buffers()
        self._watch = stopwatch
        self._binner = Binner(self._pool, self._buffers, near, stopwatch)
        self.near = near

    @property
    def threads(self) -> int:
        """Number of threads."""
        return self._pool.threads

    @property
    def pool(self) -> Pool:
        """The threads, for others' use between calls."""
        return self._pool

    def forward(
        self, splats: Splats, camera: Camera, background: Float[np.ndarray, " c"], checked: bool = False
    ) -> Frame:
        """Draw.

        Args:
            splats: n Gaussians with c channels.
            camera: up to 16384 pixels a side.
            background: (c,) what lies behind.
            checked: whether the splats are known to be what `Splats.prepared` gives, which takes longer to look at than to make sure of
                where colours are made.

        Raises:
            OptionError: shapes disagree or the camera is unusable.
            SachaError: a colour is not finite, or the splats touch more tiles than memory is given for.
        """
        splats = splats if checked else splats.prepared()
        behind = np.asarray(background, np.float32)
        if behind.shape != (splats.channels,) or not np.isfinite(behind).all():
            raise OptionError(f"background is {behind.tolist()}, expected {splats.channels} finite numbers")
        bins = self._binner.bin(splats, camera)
        shape = (splats.channels, camera.height, camera.width)
        image = self._buffers.space("image", int(np.prod(shape)), np.float32).reshape(shape)
        transmittance = self._buffers.space("transmittance", shape[1] * shape[2], np.float32).reshape(shape[1:])
        constants = tuple(behind)
        scratch, ranges, records = self._scratch(), bins.ranges, bins.projection.records

        def job(worker: int, k: int) -> None:
            blend(
                ranges[k], ranges[k + 1], bins.start, bins.entries, records, bins.x_lanes, bins.y_lanes, constants,
                image.ravel(), transmittance.ravel(), camera.width, camera.height, bins.done, scratch[worker],
            )  # fmt: skip

        with timed(self._watch, "blend"):
            self._pool.run(job, len(ranges) - 1)
        return Frame(image, transmittance, bins.span[:, 1] > 0, splats, camera, constants, bins)

    def backward(
        self,
        frame: Frame,
        image_gradient: Float[np.ndarray, "c h w"],
        transmittance_gradient: Float[np.ndarray, "h w"] | None = None,
    ) -> SplatGradients:
        """Give the gradients of a loss by the splats of the frame drawn last.

        Args:
            frame: what the last `forward` gave.
            image_gradient: (c, h, w) gradient of the loss by `frame.image`.
            transmittance_gradient: (h, w) gradient by `frame.transmittance`; None for zero.

        Returns:
            Gradients whose arrays hold until the next `backward`.

        Raises:
            OptionError: the frame is not of the last `forward`, or a shape is wrong.
        """
        half_way = self.backward_to_entries(frame, image_gradient, transmittance_gradient)
        chunks, scratch = half_way.chunks, half_way.scratch

        def job(worker: int, k: int) -> None:
            project_backward(chunks[k], chunks[k + 1], scratch[worker], *half_way.arguments)

        with timed(self._watch, "project backward"):
            self._pool.run(job, len(chunks) - 1)
        return half_way.slopes

    def backward_to_entries(
        self,
        frame: Frame,
        image_gradient: Float[np.ndarray, "c h w"],
        transmittance_gradient: Float[np.ndarray, "h w"] | None = None,
    ) -> HalfWay:
        """Do the first part of `backward`, for who lets the second join what follows, Gaussian by Gaussian; see there."""
        upstream = self._checked(frame, image_gradient, frame.image.shape).ravel()
        upstream_t = np.zeros(0, np.float32)
        if transmittance_gradient is not None:
            upstream_t = self._checked(frame, transmittance_gradient, frame.transmittance.shape).ravel()
        bins, ranges, scratch = frame.bins, frame.bins.ranges, self._scratch()
        sums = self._entry_sums(bins)

        def job(worker: int, k: int) -> None:
            blend_backward(
                ranges[k], ranges[k + 1], bins.start, bins.done, bins.entries, bins.projection.records, bins.x_lanes, bins.y_lanes,
                frame.background, frame.image.ravel(), frame.transmittance.ravel(), frame.camera.width, frame.camera.height,
                upstream, upstream_t, sums, scratch[worker],
            )  # fmt: skip

        with timed(self._watch, "blend backward"):
            self._pool.run(job, len(ranges) - 1)
        return self._half_way(frame, sums)

    def colour_weights(self, frame: Frame, pixel_weights: Float[np.ndarray, "m h w"]) -> Float[np.ndarray, "n m"]:
        """Give for each Gaussian the sum over pixels of its blending weight times each image of pixel weights.

        That is the gradient by a colour channel of sum_p weight_p C_p, without the geometry's: the importance pass.

        Args:
            frame: what the last `forward` gave.
            pixel_weights: (m, h, w), finite.

        Returns:
            (n, m) float64.

        Raises:
            OptionError: the frame is not of the last `forward`, or a shape is wrong.
        """
        weights = self._checked(frame, pixel_weights, (len(pixel_weights), *frame.transmittance.shape))
        bins, ranges, scratch = frame.bins, frame.bins.ranges, self._scratch()
        sums = self._entry_sums(bins)
        found = list[np.ndarray]()
        for first in range(0, len(weights), MAX_CHANNELS):
            part = weights[first : first + MAX_CHANNELS].ravel()

            def job(worker: int, k: int, part: np.ndarray = part) -> None:
                blend_weights(
                    ranges[k], ranges[k + 1], bins.start, bins.done, bins.entries, bins.projection.records, bins.x_lanes,
                    bins.y_lanes, part, frame.camera.width, frame.camera.height, sums, scratch[worker],
                )  # fmt: skip

            self._pool.run(job, len(ranges) - 1)
            found.append(self._gathered(bins, sums, min(MAX_CHANNELS, len(weights) - first)))
        return found[0] if len(found) == 1 else np.concatenate([np.zeros((len(frame.splats), 0)), *found], axis=1)

    def cover(self, splats: Splats, camera: Camera) -> Float[np.ndarray, " n"]:
        """Give how much of a picture each Gaussian makes up, pixels: `colour_weights` of ones, without drawing; colours do not matter.

        Frames drawn before are stale then.

        Args:
            splats: n Gaussians.
            camera: up to 16384 pixels a side.

        Returns:
            (n,) float64.

        Raises:
            OptionError: shapes disagree or the camera is unusable.
            SachaError: the splats touch more tiles than memory is given for.
        """
        bins = self._binner.bin(splats.prepared(), camera)
        ranges, scratch, sums = bins.ranges, self._scratch(), self._entry_sums(bins)

        def job(worker: int, k: int) -> None:
            blend_cover(
                ranges[k], ranges[k + 1], bins.start, bins.entries, bins.projection.records, bins.x_lanes, bins.y_lanes,
                camera.width, camera.height, sums, scratch[worker],
            )  # fmt: skip

        self._pool.run(job, len(ranges) - 1)
        return self._gathered(bins, sums, 1)[:, 0]

    def largest_weights(self, frame: Frame) -> Float[np.ndarray, " n"]:
        """Give for each Gaussian the largest blending weight that it has in any pixel, 0 to 1, float32.

        Args:
            frame: what the last `forward` gave.

        Raises:
            OptionError: the frame is not of the last `forward`.
        """
        self._checked(frame, frame.transmittance, frame.transmittance.shape)
        bins, ranges, scratch = frame.bins, frame.bins.ranges, self._scratch()
        peaks, result = self._entry_sums(bins), np.zeros(len(frame.splats), np.float32)

        def job(worker: int, k: int) -> None:
            blend_peaks(
                ranges[k], ranges[k + 1], bins.start, bins.done, bins.entries, bins.projection.records, bins.x_lanes, bins.y_lanes,
                frame.camera.width, frame.camera.height, peaks, scratch[worker],
            )  # fmt: skip

        self._pool.run(job, len(ranges) - 1)
        gather_peaks(0, len(result), bins.span.ravel(), peaks, result)
        return result

    def removal_changes(
        self, frame: Frame, pixel_weights: Float[np.ndarray, "m h w"], channels: int | None = None
    ) -> RemovalChanges:
        """Give for each Gaussian by how much the picture would change if it alone were not drawn.

        Exact to float32's rounding but where a pixel is closed, its transmittance near 1e-4: there up to 1e-4 / (1 - alpha) of the
        pixel's light is taken to come from the background instead of from what was not drawn, and what closed it counts as unseen.

        Args:
            frame: what the last `forward` gave.
            pixel_weights: (m, h, w), finite.
            channels: how many of the first ones count; None for all.

        Raises:
            OptionError: the frame is not of the last `forward`, a shape is wrong, or there are fewer channels.

        Source: own.
        """
        size, background = frame.transmittance.shape, frame.background[:channels]
        if channels is not None and not 1 <= channels <= len(frame.background):
            raise OptionError(
                f"{channels} channels were asked for, expected 1 to {len(frame.background)} as the frame has"
            )
        weights = self._checked(frame, pixel_weights, (len(pixel_weights), *size))
        bins, ranges, scratch = frame.bins, frame.bins.ranges, self._scratch()
        sums = self._entry_sums(bins)
        result = np.zeros((KINDS, len(frame.splats), len(weights)))
        for first in range(0, len(weights), IMAGES):
            part = weights[first : first + IMAGES].ravel()

            def job(worker: int, k: int, part: np.ndarray = part) -> None:
                blend_removal(
                    ranges[k], ranges[k + 1], bins.start, bins.done, bins.entries, bins.projection.records, bins.x_lanes, bins.y_lanes,
                    background, frame.image.ravel(), frame.transmittance.ravel(), frame.camera.width,
                    frame.camera.height, part, sums, scratch[worker],
                )  # fmt: skip

            self._pool.run(job, len(ranges) - 1)
            gathered = self._gathered(bins, sums, KINDS * IMAGES)
            there = min(IMAGES, len(weights) - first)
            for kind, values in enumerate(result):
                values[:, first : first + there] = gathered[:, kind * IMAGES : kind * IMAGES + there]
        return RemovalChanges(*result)

    def _half_way(self, frame: Frame, sums: np.ndarray) -> HalfWay:
        splats, bins, projection = frame.splats, frame.bins, frame.bins.projection
        n, channels = len(splats), splats.channels
        widths = {"means": 3, "scales": 3, "quaternions": 4, "opacities": 1, "means_2d": 2, "colours": channels}
        rows = len(projection.depths)  # whole blocks of lanes
        out = {name: self._buffers.space("g_" + name, rows * width, np.float32) for name, width in widths.items()}
        arguments = (
            *projection.inputs[:4], *projection.inputs[5:9], n, channels, projection.view, bins.span.ravel(), sums, *out.values()
        )  # fmt: skip
        shapes = {name: (n, width) if name != "opacities" else (n,) for name, width in widths.items()}
        slopes = SplatGradients(**{name: out[name][: n * widths[name]].reshape(shapes[name]) for name in out})
        return HalfWay(slopes, projection.chunks, arguments, self._scratch())

    def _checked(self, frame: Frame, array: np.ndarray, shape: tuple[int, ...]) -> np.ndarray:
        """Give a contiguous float32 array of this shape that belongs to a frame still valid."""
        if frame.bins.serial != self._binner.serial:
            raise OptionError("the frame is stale: the rasteriser has drawn another since")
        if np.shape(array) != shape:
            raise OptionError(f"an array for the frame has shape {np.shape(array)}, expected {shape}")
        return np.ascontiguousarray(array, np.float32)

    def _entry_sums(self, bins: Bins) -> np.ndarray:
        return self._buffers.space("entry_sums", bins.capacity * RECORD, np.float32)

    def _gathered(self, bins: Bins, sums: np.ndarray, width: int) -> Float[np.ndarray, "n k"]:
        """Sum the first numbers of the entries of each Gaussian."""
        n, span, chunks = len(bins.span), bins.span.ravel(), bins.projection.chunks
        gathered = np.empty((n, width))

        def job(_: int, k: int) -> None:
            gather_weights(chunks[k], min(chunks[k + 1], n), span, sums, gathered)  # the last block may be part of one

        self._pool.run(job, len(chunks) - 1)
        return gathered

    def _scratch(self) -> np.ndarray:
        return self._buffers.space("scratch", self.threads * SCRATCH, np.float32).reshape(self.threads, SCRATCH)
