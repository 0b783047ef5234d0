"""Drawing by gsplat, several cameras of one image size at once."""

from __future__ import annotations

import importlib
from collections.abc import Callable
from dataclasses import dataclass
from typing import Protocol, cast

import torch
from jaxtyping import Bool, Float
from torch import Tensor

from sacha_core.raster.kernels.layout import DILATION, RADIUS_MAX
from sacha_core.raster.rasteriser import NEAR

__all__ = ["Cameras", "Drawer", "Drawing", "Gsplat", "World", "load_gsplat"]

TILE = 16  # pixels a side, what gsplat's kernels are tuned for
BACKGROUND = (1.0, 1.0, 1.0, 0.0)  # white, and not sensitive
LARGEST_M = 1e4  # of a standard deviation: what is above is culled, and its covariance is still a finite float32


class Gsplat(Protocol):
    """The functions of gsplat that are used, by its own names, arguments and layouts, so that a stand-in can take its place."""

    @property
    def fully_fused_projection(self) -> Callable[..., tuple[Tensor, ...]]:
        """Project Gaussians."""

    @property
    def isect_tiles(self) -> Callable[..., tuple[Tensor, Tensor, Tensor]]:
        """List the Gaussians of each tile, front to back."""

    @property
    def isect_offset_encode(self) -> Callable[..., Tensor]:
        """Find where each tile's begin."""

    @property
    def rasterize_to_pixels(self) -> Callable[..., tuple[Tensor, Tensor]]:
        """Blend."""


def load_gsplat() -> Gsplat:
    """Give gsplat itself. Its first call compiles its kernels where its wheel brings none."""
    return cast("Gsplat", importlib.import_module("gsplat"))


@dataclass(frozen=True)
class Cameras:
    """c cameras whose images have one size.

    Args:
        world_to_camera: (c, 4, 4).
        intrinsics: (c, 3, 3) pixels.
        centres: (c, 3) where they stand, metres.
        width: pixels.
        height: pixels.
    """

    world_to_camera: Float[Tensor, "c 4 4"]
    intrinsics: Float[Tensor, "c 3 3"]
    centres: Float[Tensor, "c 3"]
    width: int
    height: int


@dataclass(frozen=True)
class World:
    """n Gaussians in the world.

    Args:
        means: (n, 3) metres.
        scales: (n, 3) standard deviations, metres.
        quaternions: (n, 4) wxyz.
        opacities: (n,) 0 to 1.
    """

    means: Float[Tensor, "n 3"]
    scales: Float[Tensor, "n 3"]
    quaternions: Float[Tensor, "n 4"]
    opacities: Float[Tensor, " n"]


@dataclass(frozen=True)
class Drawing:
    """What c cameras see.

    Args:
        image: (c, h, w, k) blended channels over the background.
        means_2d: (c, n, 2) pixels; those of Gaussians that are not visible mean nothing. Where it was asked for, the way back leaves the
            sums of its gradient's absolute values over pixels in the attribute `absgrad`.
        visible: (c, n) whose boxes touch the image.
    """

    image: Float[Tensor, "c h w k"]
    means_2d: Float[Tensor, "c n 2"]
    visible: Bool[Tensor, "c n"]


class Drawer:
    """Draws as our own rasteriser does, near plane, dilation and thresholds included.

    gsplat up to 1.5 cuts alpha off at 0.999 and not at 0.99. A Gaussian counts as visible as soon as its box, rounded up to whole pixels,
    touches the image. Listing the Gaussians of tiles waits for the device once, for the list's length.

    Args:
        gsplat: that, or its stand-in.
        device: where to draw.

    Source: Ye et al., gsplat, JMLR 2025.
    """

    def __init__(self, gsplat: Gsplat, device: torch.device) -> None:
        self._gsplat = gsplat
        self._background = torch.tensor([BACKGROUND], device=device)

    def draw(self, world: World, colours: Float[Tensor, "c n 4"], cameras: Cameras, absolute: bool = False) -> Drawing:
        """Draw some images, differentiable by the world and the colours.

        Args:
            world: the Gaussians.
            colours: (c, n, 4) red, green, blue and sensitivity, as each camera sees them.
            cameras: from where.
            absolute: whether the way back shall also leave `absgrad` (see `Drawing`).
        """
        return self._blend(world, colours, cameras, self._background, absolute)

    def weights(self, world: World, pixel_weights: Float[Tensor, "c h w m"], cameras: Cameras) -> Float[Tensor, "n m"]:
        """Give for each Gaussian the sum over images and pixels of its blending weight times each of m pixel weights.

        That is the gradient by a channel of colour c of sum_p weight_p c_p; none is computed for the geometry's projection.
        """
        shape = (len(pixel_weights), len(world.means), pixel_weights.shape[3])
        colours = torch.zeros(shape, device=pixel_weights.device, requires_grad=True)
        with torch.enable_grad():
            image = self._blend(world, colours, cameras, None, absolute=False).image
        (summed,) = torch.autograd.grad(image, colours, pixel_weights)
        return summed.sum(0)

    def _blend(
        self,
        world: World,
        colours: Float[Tensor, "c n k"],
        cameras: Cameras,
        background: Float[Tensor, "1 k"] | None,
        absolute: bool,
    ) -> Drawing:
        width, height, count = cameras.width, cameras.height, len(colours)
        radii, means_2d, depths, conics, _ = self._gsplat.fully_fused_projection(
            world.means, None, world.quaternions, world.scales.clamp_max(LARGEST_M), cameras.world_to_camera, cameras.intrinsics,
            width, height, eps2d=float(DILATION), near_plane=NEAR, opacities=world.opacities,
        )  # fmt: skip
        visible = ((radii > 0) & (radii < int(RADIUS_MAX))).all(2)
        radii = radii * visible[..., None]
        columns, rows = -(-width // TILE), -(-height // TILE)
        _, keys, order = self._gsplat.isect_tiles(means_2d, radii, depths, TILE, columns, rows)
        offsets = self._gsplat.isect_offset_encode(keys, count, columns, rows).view(count, rows, columns)
        image, _ = self._gsplat.rasterize_to_pixels(
            means_2d, conics, colours, world.opacities.expand(count, -1), width, height, TILE, offsets, order,
            backgrounds=None if background is None else background.expand(count, -1), absgrad=absolute,
        )  # fmt: skip
        return Drawing(image, means_2d, visible)
