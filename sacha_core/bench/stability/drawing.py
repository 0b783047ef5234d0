"""Splats drawn by the shipped rasteriser, and held to the exact picture."""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import lru_cache

import numpy as np
import torch
from jaxtyping import Bool, Float

from sacha_core.bench.exact import draw, leaves_of
from sacha_core.bench.stability.case import Findings
from sacha_core.raster.camera import Camera
from sacha_core.raster.rasteriser import Rasteriser
from sacha_core.raster.splats import Splats

__all__ = [
    "BACKGROUND",
    "Drawn",
    "drawn",
    "good_splats",
    "hold_to_exact",
    "joined",
    "slanted_camera",
    "straight_camera",
    "watch",
]

# Limits, each with its reason
PIXEL = 2e-5  # float32 rounding of some tens of blended terms, and 1e-6 relative of the exponential
BAND = 2e-5  # relative distance from a threshold within which float32 may decide otherwise
# What one decision may change in a colour of at most 1, and a little: 1/255 at the first threshold, and where blending stops, a weight of
# 0.99 on 1 % of the light
FLIP = 1.2 * 0.0099
GRADIENT = 2e-4  # relative to the largest gradient of its kind: float32 sums over a few thousand pixels
# Of the largest gradient of any kind; a kind below it is judged by it, as the rotation of a round splat, which has none but rounding
SMALL_KIND = 0.01

BACKGROUND = np.array([1, 1, 1, 0], np.float32)  # as in training
FIELDS = ("means", "scales", "quaternions", "opacities", "colours")


@dataclass(frozen=True)
class Drawn:
    """A picture and its gradients, by the shipped rasteriser.

    Args:
        arrays: image, transmittance, and the gradients by each attribute and by the projected mean (`means_2d`).
        visible: (n,) which Gaussians touch a tile.
        depths: (n,) float32, by which they were sorted.
    """

    arrays: dict[str, Float[np.ndarray, "..."]]
    visible: Bool[np.ndarray, " n"]
    depths: Float[np.ndarray, " n"]

    def of(self, rows: np.ndarray) -> dict[str, Float[np.ndarray, "..."]]:
        """Give the picture, and the gradients of some Gaussians."""
        whole = ("image", "transmittance")
        return {name: array if name in whole else array[rows] for name, array in self.arrays.items()}


@lru_cache(maxsize=2)
def rasteriser(threads: int) -> Rasteriser:
    """Give one that is kept: its buffers hold what earlier cases left, as a program's would."""
    return Rasteriser(threads)


def drawn(
    splats: Splats, camera: Camera, upstream: Float[np.ndarray, "c h w"] | None = None, threads: int = 1
) -> Drawn:
    """Draw forward and backward.

    Args:
        splats: n Gaussians with four channels.
        camera: from where.
        upstream: (4, h, w) gradient of a loss by the image; by default the same random numbers each time.
        threads: how many.
    """
    shipped = rasteriser(threads)
    frame = shipped.forward(splats, camera, BACKGROUND)
    image = {"image": frame.image.copy(), "transmittance": frame.transmittance.copy()}
    visible, depths = frame.visible.copy(), frame.bins.projection.depths[: len(splats)].copy()
    gradients = shipped.backward(frame, noise(camera) if upstream is None else upstream)
    return Drawn(image | {name: array.copy() for name, array in vars(gradients).items()}, visible, depths)


def noise(camera: Camera) -> Float[np.ndarray, "4 h w"]:
    """Give an upstream gradient without any pattern."""
    return np.random.default_rng(5).normal(size=(4, camera.height, camera.width)).astype(np.float32)


def watch(findings: Findings, splats: Splats, camera: Camera) -> Drawn:
    """Draw, and require what must always be: every number finite, nothing from what is not seen, the same for 1 and 2 threads."""
    one, two = drawn(splats, camera), drawn(splats, camera, threads=2)
    findings.finite("all", one.arrays)
    findings.same_bits("1 and 2 threads", two.arrays, one.arrays)
    unseen = one.of(~one.visible)
    if any(unseen[name].any() for name in (*FIELDS, "means_2d")):
        findings.require(holds=False, statement="gradients only where a Gaussian is seen")
    return one


def hold_to_exact(
    findings: Findings,
    splats: Splats,
    camera: Camera,
    pixel: float = PIXEL,
    gradient: float = GRADIENT,
    band: float = BAND,
) -> None:
    """Compare picture and gradients with the exact ones, outside the boundary band but for single flips.

    Args:
        findings: where to note it.
        splats: n Gaussians with four channels.
        camera: from where.
        pixel: by how much a pixel outside the band may differ, for colours up to 1.
        gradient: by how much a gradient may, relative to the largest of its kind.
        band: relative distance from a threshold within which float32 may decide otherwise.
    """
    depths = drawn(splats, camera).depths
    leaves = leaves_of(splats, learn=True)
    exact = draw(leaves, camera, BACKGROUND, depths)
    calm = exact.band > band
    upstream = noise(camera) * calm  # a pixel that may flip has no gradient worth comparing
    shipped = drawn(splats, camera, upstream)
    error = np.abs(shipped.arrays["image"] - exact.image.detach().numpy()).max(axis=0)
    error = np.maximum(error, np.abs(shipped.arrays["transmittance"] - exact.transmittance.detach().numpy()))
    largest = float(np.abs(splats.colours[shipped.visible]).max(initial=1))
    findings.below("pixels off by", error[calm].max(initial=0), pixel * largest)
    if not calm.all():
        findings.below("in the boundary band", error[~calm].max(initial=0), FLIP * largest)
    (exact.image * torch.from_numpy(upstream)).sum().backward()  # type: ignore[no-untyped-call]
    expected = {name: np.zeros(leaf.shape) if leaf.grad is None else leaf.grad.numpy() for name, leaf in leaves.items()}
    findings.below("gradients off by", _gradient_error(shipped, expected, camera), gradient)


def _gradient_error(shipped: Drawn, expected: dict[str, np.ndarray], camera: Camera) -> float:
    """Give the largest error relative to its kind, with lengths in pixels at the nearest splat, so that kinds compare."""
    pixel_m = float(shipped.depths[shipped.visible].min(initial=1)) / camera.fx
    units = {name: pixel_m if name in {"means", "scales"} else 1.0 for name in expected}
    sizes = {name: units[name] * float(np.abs(array).max(initial=0)) for name, array in expected.items()}
    least = SMALL_KIND * max(sizes.values())
    errors = [
        units[name] * float(np.abs(shipped.arrays[name] - array).max(initial=0)) / max(sizes[name], least)
        for name, array in expected.items()
        if max(sizes[name], least) > 0
    ]
    return max(errors, default=0.0)


def good_splats(n: int = 37, seed: int = 1, size_m: float = 0.03, spread_m: float = 0.15) -> Splats:
    """Give n ordinary Gaussians around the origin, with four channels, the last like a sensitivity."""
    rng = np.random.default_rng(seed)
    arrays = (
        rng.normal(size=(n, 3)) * spread_m,
        size_m * np.exp(rng.normal(size=(n, 3)) * 0.6),
        rng.normal(size=(n, 4)),
        rng.uniform(0.02, 1, n),
        rng.uniform(0, 1, (n, 4)),
    )
    return Splats(*(a.astype(np.float32) for a in arrays))


def joined(splats: Splats, others: Splats, places: np.ndarray) -> Splats:
    """Give splats with others put in between, so that these become the rows `places`."""
    total = len(splats) + len(others)
    mine = np.setdiff1d(np.arange(total), places)
    made = {}
    for name in FIELDS:
        array = np.empty((total, *getattr(splats, name).shape[1:]), np.float32)
        array[mine], array[places] = getattr(splats, name), getattr(others, name)
        made[name] = array
    return Splats(**made)


def slanted_camera(width: int = 45, height: int = 70, focal: float = 75.0) -> Camera:
    """Give a camera a metre away, off the axes, its principal point off the centre."""
    looking = Camera.look_at(np.array([0.3, 0.2, 0.95]), np.array([0.01, -0.02, 0.0]), width, height, focal)
    return replace(looking, fy=1.1 * focal, cx=width / 2 + 1.3, cy=height / 2 - 0.7)


def straight_camera(width: int = 64, height: int = 64, focal: float = 64.0) -> Camera:
    """Give a camera at the origin that looks along z, in which numbers that are exact in binary stay so."""
    return Camera(width, height, focal, focal, width / 2, height / 2, np.eye(3), np.zeros(3))
