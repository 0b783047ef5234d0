"""The picture of Gaussians as it is defined, in float64 and differentiable: what the kernels are held to.

Dense, with no tiles and no boxes: every Gaussian at every pixel. `Camera.crop` gives a part of an image that would be too large.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass

import numpy as np
import torch
from jaxtyping import Bool, Float, Int
from torch import Tensor

from sacha_core.raster.camera import Camera
from sacha_core.raster.rasteriser import NEAR
from sacha_core.raster.splats import Splats

__all__ = ["Decisions", "ExactFrame", "Leaves", "draw", "leaves_of", "one_thread", "rotation_matrices"]

Leaves = dict[str, Tensor]

# What an image of Gaussians is (Kerbl et al. 2023; gsplat); written down again, so that the kernels' own are checked
ALPHA_MIN, ALPHA_MAX, STOP = 1 / 255, 0.99, 1e-4
DILATION = 0.3  # square pixels
SLACK = 0.15  # of the image's side: how far outside it the Jacobian still follows the mean
LARGEST_RADIUS = 16384.0  # pixels
LEAST_SQUARE = 1e-16  # of a quaternion's length
NAMES = ("means", "scales", "quaternions", "opacities", "colours")


@dataclass(frozen=True)
class Decisions:
    """All that drawing decides by comparing numbers; kept fixed, a picture is a smooth function of its parameters.

    Args:
        order: (m,) rows of the Gaussians that are drawn, front to back.
        follows: (m, 2) whether the Jacobian's slope follows the mean along x and y, or is held at its limit.
        blended: four times (k,): which of the m is blended, into which pixel (row, column), and how many are before it there. Its alpha
            is at least 1/255 and the pixel still open.
        clamped: (k,) where alpha is held at 0.99.
    """

    order: Int[Tensor, " m"]
    follows: Bool[Tensor, "m 2"]
    blended: tuple[Int[Tensor, " k"], Int[Tensor, " k"], Int[Tensor, " k"], Int[Tensor, " k"]]
    clamped: Bool[Tensor, " k"]


@dataclass(frozen=True)
class ExactFrame:
    """One picture.

    Args:
        image: (c, h, w) blended colours over the background.
        transmittance: (h, w) how much of the background is seen.
        band: (h, w) relative distance of the nearest decision at a threshold, where float32 may decide otherwise; infinite where a picture
            was drawn with decisions that were given.
        decisions: what was decided.
    """

    image: Float[Tensor, "c h w"]
    transmittance: Float[Tensor, "h w"]
    band: Float[np.ndarray, "h w"]
    decisions: Decisions


@dataclass(frozen=True)
class _Ellipses:
    """Projected Gaussians: mean, conic (xx, xy, yy) and dilated covariance's diagonal in pixels, and where slopes follow the mean."""

    mean: Float[Tensor, "m 2"]
    conic: tuple[Tensor, Tensor, Tensor]
    diagonal: Float[Tensor, "m 2"]
    follows: Bool[Tensor, "m 2"]


@contextmanager
def one_thread() -> Iterator[None]:
    """Keep torch on the calling thread: on small arrays more threads only wait for each other, and sums keep their order."""
    before = torch.get_num_threads()
    torch.set_num_threads(1)
    try:
        yield
    finally:
        torch.set_num_threads(before)


def leaves_of(splats: Splats, learn: bool = False) -> Leaves:
    """Give splats as float64 tensors by name, and `means_2d`, a shift of the projected means in pixels, which is 0.

    Args:
        splats: n Gaussians.
        learn: whether gradients are wanted.
    """
    leaves = {name: torch.tensor(np.asarray(getattr(splats, name), np.float64)) for name in NAMES}
    leaves["means_2d"] = torch.zeros(len(splats), 2, dtype=torch.float64)
    for leaf in leaves.values():
        leaf.requires_grad_(learn)
    return leaves


def draw(
    leaves: Leaves,
    camera: Camera,
    background: Float[np.ndarray, " c"],
    depths: Float[np.ndarray, " n"],
    near: float = NEAR,
    decisions: Decisions | None = None,
) -> ExactFrame:
    """Draw.

    Args:
        leaves: n Gaussians as `leaves_of` gives them; `means_2d` may be missing.
        camera: from where.
        background: (c,) what lies behind.
        depths: (n,) by which Gaussians are sorted, ties by row. Float32 depth order is part of the definition: give the kernel's own.
        near: what is closer is not drawn, metres.
        decisions: what to decide; None for what the definition says.

    Source: Kerbl et al., 3D Gaussian Splatting, SIGGRAPH 2023; thresholds and the clamped Jacobian as gsplat has them.
    """
    band = np.full((camera.height, camera.width), np.inf)
    if decisions is None:
        with torch.no_grad():
            decisions, band = _decide(leaves, camera, depths, near)
    drawn = {name: leaf[decisions.order] for name, leaf in leaves.items()}
    ellipses = _project(drawn, camera, decisions.follows)
    g, row, column, before = decisions.blended
    x, y = column + 0.5 - ellipses.mean[g, 0], row + 0.5 - ellipses.mean[g, 1]
    alpha = torch.where(
        decisions.clamped, ALPHA_MAX, _alpha(drawn["opacities"][g], [entry[g] for entry in ellipses.conic], x, y)
    )
    # one layer of the picture for each place in a pixel's row of Gaussians: far fewer than there are Gaussians
    layers = torch.zeros(int(before.max()) + 1 if len(before) else 0, camera.height, camera.width, dtype=torch.float64)
    layers = layers.index_put((before, row, column), alpha)
    open_ = torch.cat([torch.ones(1, camera.height, camera.width, dtype=torch.float64), torch.cumprod(1 - layers, 0)])
    weight = alpha * open_[before, row, column]
    behind = torch.tensor(np.asarray(background, np.float64))
    image = (behind[:, None, None] * open_[-1]).index_put(
        (torch.arange(len(behind))[:, None], row, column), drawn["colours"][g].T * weight, accumulate=True
    )
    return ExactFrame(image, open_[-1], band, decisions)


def rotation_matrices(quaternions: Float[Tensor, "n 4"]) -> Float[Tensor, "n 3 3"]:
    """Give the rotation of each quaternion wxyz, of any length."""
    w, x, y, z = (quaternions / quaternions.norm(dim=1, keepdim=True)).unbind(1)
    rows = [
        torch.stack([1 - 2 * (y * y + z * z), 2 * (x * y - w * z), 2 * (x * z + w * y)], 1),
        torch.stack([2 * (x * y + w * z), 1 - 2 * (x * x + z * z), 2 * (y * z - w * x)], 1),
        torch.stack([2 * (x * z - w * y), 2 * (y * z + w * x), 1 - 2 * (x * x + y * y)], 1),
    ]
    return torch.stack(rows, 1)


def _drawable(leaves: Leaves, camera: Camera, depths: Float[np.ndarray, " n"], near: float) -> Int[Tensor, " m"]:
    """Give the rows of the Gaussians that are drawn, front to back: those with numbers that make a splat of a size that belongs here."""
    order = torch.from_numpy(np.argsort(depths, kind="stable"))
    plain = {name: leaf.detach()[order] for name, leaf in leaves.items()}
    finite = torch.stack([torch.isfinite(leaf[:, None]).flatten(1).all(1) for leaf in plain.values()]).all(0)
    order = order[finite & (plain["quaternions"].square().sum(1) > LEAST_SQUARE) & (plain["opacities"] >= ALPHA_MIN)]
    rotation, translation = (torch.tensor(np.asarray(a, np.float64)) for a in (camera.rotation, camera.translation))
    order = order[leaves["means"].detach()[order] @ rotation[2] + translation[2] > near]
    plain = {name: leaf.detach()[order] for name, leaf in leaves.items()}
    reach = (2 * torch.log(plain["opacities"] / ALPHA_MIN))[:, None] * _project(plain, camera, None).diagonal
    return order[(reach < LARGEST_RADIUS**2).all(1)]


def _project(drawn: Leaves, camera: Camera, follows: Bool[Tensor, "m 2"] | None) -> _Ellipses:
    """Project Gaussians that lie before the camera; `follows` is decided where it is not given."""
    rotation, translation = (torch.tensor(np.asarray(a, np.float64)) for a in (camera.rotation, camera.translation))
    x, y, z = (drawn["means"] @ rotation.T + translation).unbind(1)
    left, right, top, bottom = camera.edges
    slack_x, slack_y = SLACK * (right - left), SLACK * (bottom - top)
    slopes = torch.stack([x / z, y / z], 1)
    limits = torch.tensor([[left - slack_x, top - slack_y], [right + slack_x, bottom + slack_y]], dtype=torch.float64)
    held = slopes.detach().clamp(limits[0], limits[1])
    if follows is None:
        follows = slopes.detach() == held
    slope_x, slope_y = torch.where(follows, slopes, held).unbind(1)
    zero = torch.zeros_like(z)
    jacobian = torch.stack(
        [
            torch.stack([camera.fx / z, zero, -camera.fx * slope_x / z], 1),
            torch.stack([zero, camera.fy / z, -camera.fy * slope_y / z], 1),
        ],
        1,
    )
    axes = jacobian @ rotation @ (rotation_matrices(drawn["quaternions"]) * drawn["scales"][:, None, :])
    covariance = axes @ axes.transpose(1, 2) + DILATION * torch.eye(2, dtype=torch.float64)
    (a, b), (_, d) = ((row[:, 0], row[:, 1]) for row in covariance.unbind(1))
    # |u x v|^2 + 0.3 (|u|^2 + |v|^2) + 0.09, which does not cancel for needles as a d - b^2 does
    area = torch.linalg.cross(axes[:, 0], axes[:, 1]).square().sum(1)
    determinant = area + DILATION * (a + d - DILATION)
    mean = torch.stack([camera.fx * x / z + camera.cx, camera.fy * y / z + camera.cy], 1)
    if "means_2d" in drawn:
        mean = mean + drawn["means_2d"]
    return _Ellipses(mean, (d / determinant, -b / determinant, a / determinant), torch.stack([a, d], 1), follows)


def _decide(
    leaves: Leaves, camera: Camera, depths: Float[np.ndarray, " n"], near: float
) -> tuple[Decisions, Float[np.ndarray, "h w"]]:
    """Compare with the thresholds, and tell how close each pixel's decisions were."""
    order = _drawable(leaves, camera, depths, near)
    drawn = {name: leaf[order] for name, leaf in leaves.items()}
    ellipses = _project(drawn, camera, None)
    x = torch.arange(camera.width, dtype=torch.float64)[None, None, :] + 0.5 - ellipses.mean[:, 0, None, None]
    y = torch.arange(camera.height, dtype=torch.float64)[None, :, None] + 0.5 - ellipses.mean[:, 1, None, None]
    alpha = _alpha(drawn["opacities"][:, None, None], [entry[:, None, None] for entry in ellipses.conic], x, y)
    shown = alpha >= ALPHA_MIN
    after = torch.cumprod(1 - torch.where(shown, alpha.clamp(max=ALPHA_MAX), 0.0), 0)
    # a pixel closes at the first Gaussian that would bring it to the limit, and that one is not blended
    closed = torch.cumsum(shown & ~(after > STOP), 0) > 0
    open_before = torch.cat([torch.ones_like(closed[:1]), ~closed[:-1]]) if len(order) else ~closed
    blended = shown & ~closed
    g, row, column = blended.nonzero(as_tuple=True)
    before = (torch.cumsum(blended, 0) - 1)[g, row, column]
    return Decisions(order, ellipses.follows, (g, row, column, before), alpha[g, row, column] > ALPHA_MAX), _band(
        alpha, after, shown, open_before
    )


def _band(
    alpha: Float[Tensor, "m h w"],
    after: Float[Tensor, "m h w"],
    shown: Bool[Tensor, "m h w"],
    open_before: Bool[Tensor, "m h w"],
) -> Float[np.ndarray, "h w"]:
    """Give the relative distance of each pixel's nearest decision: to blend, to hold alpha, or to stop."""
    if not len(alpha):
        return np.full(alpha.shape[1:], np.inf)
    cut = torch.where(open_before, (alpha / ALPHA_MIN - 1).abs(), torch.inf)
    stop = torch.minimum((after / STOP - 1).abs(), (alpha / ALPHA_MAX - 1).abs())
    nearest: np.ndarray = torch.minimum(cut, torch.where(open_before & shown, stop, torch.inf)).amin(0).numpy()
    return nearest


def _alpha(opacity: Tensor, conic: Sequence[Tensor], x: Tensor, y: Tensor) -> Tensor:
    """Give opacity exp(-d^T conic d / 2) at (x, y) from the mean."""
    xx, xy, yy = conic
    return opacity * torch.exp(-0.5 * (xx * x * x + 2 * xy * x * y + yy * y * y))
