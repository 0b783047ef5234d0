"""gsplat's functions in plain torch, for machines without a GPU: the same arguments, layouts and rules, differentiable by autograd.

Written from gsplat's documentation and the behaviour of its kernels. What those leave uninitialised is filled with numbers that are none.
"""

from __future__ import annotations

import math
from functools import partial

import torch
from torch import Tensor

ALPHA_MIN, ALPHA_MAX, STOP, REACH, SLACK = 1 / 255, 0.999, 1e-4, 3.33, 0.15


def fully_fused_projection(
    means: Tensor,
    covars: Tensor | None,
    quats: Tensor | None,
    scales: Tensor | None,
    viewmats: Tensor,
    Ks: Tensor,
    width: int,
    height: int,
    eps2d: float = 0.3,
    near_plane: float = 0.01,
    far_plane: float = 1e10,
    radius_clip: float = 0.0,
    packed: bool = False,
    sparse_grad: bool = False,
    calc_compensations: bool = False,
    camera_model: str = "pinhole",
    opacities: Tensor | None = None,
) -> tuple[Tensor, Tensor, Tensor, Tensor, Tensor | None]:
    """Project n Gaussians into c images: radii (c, n, 2) int32, means (c, n, 2), depths (c, n), conics (c, n, 3)."""
    assert covars is None
    assert not packed
    assert not calc_compensations
    assert camera_model == "pinhole"
    assert opacities.shape == means.shape[:1]
    camera = torch.einsum("cij,nj->cni", viewmats[:, :3, :3], means) + viewmats[:, None, :3, 3]
    axes = viewmats[:, None, :3, :3] @ (rotations(quats) * scales[:, None, :])
    with torch.no_grad():
        means2d, covariance = perspective(camera, axes, Ks, width, height, eps2d)
        reach = (2 * (opacities / ALPHA_MIN).log()).sqrt().clamp_max(REACH)
        radii = (reach[:, None] * covariance.diagonal(dim1=-2, dim2=-1).sqrt()).ceil()
        size = torch.tensor([width, height])
        inside = ((means2d + radii > 0) & (means2d - radii < size)).all(-1)
        within = (camera[..., 2] >= near_plane) & (camera[..., 2] <= far_plane)
        shown = within & (covariance.det() > 0) & (opacities >= ALPHA_MIN) & inside & (radii > radius_clip).any(-1)
        radii = torch.where(shown[..., None], radii, 0).int()
    # what is not shown passes no gradient on, whatever its numbers are
    camera = torch.where(shown[..., None], camera, torch.tensor([0.0, 0.0, 1.0]))
    means2d, covariance = perspective(camera, axes, Ks, width, height, eps2d)
    xx, xy, yy = covariance[..., 0, 0], covariance[..., 0, 1], covariance[..., 1, 1]
    conics = torch.stack([yy, -xy, xx], -1) / (xx * yy - xy * xy)[..., None]
    means2d, conics = (torch.where(shown[..., None], array, math.nan) for array in (means2d, conics))
    return radii, means2d, torch.where(shown, camera[..., 2], math.nan), conics, None


def perspective(
    camera: Tensor, axes: Tensor, Ks: Tensor, width: int, height: int, eps2d: float
) -> tuple[Tensor, Tensor]:
    """Give means and dilated covariances in the image from means and axes (c, n, 3, 3) in the camera's frame."""
    x, y, z = camera.unbind(-1)
    fx, fy, cx, cy = (Ks[:, i, j, None] for i, j in ((0, 0), (1, 1), (0, 2), (1, 2)))
    slopes = []
    for place, focal, centre, side in ((x, fx, cx, width), (y, fy, cy, height)):
        slack = SLACK * side / focal
        slopes.append(torch.clamp(place / z, -centre / focal - slack, (side - centre) / focal + slack))
    nothing = torch.zeros_like(z)
    jacobian = torch.stack([fx / z, nothing, -fx * slopes[0] / z, nothing, fy / z, -fy * slopes[1] / z], -1)
    flat = jacobian.unflatten(-1, (2, 3)) @ axes
    return torch.stack([fx * x / z + cx, fy * y / z + cy], -1), flat @ flat.mT + eps2d * torch.eye(2)


def rotations(quaternions: Tensor) -> Tensor:
    w, x, y, z = torch.nn.functional.normalize(quaternions, dim=-1).unbind(-1)
    entries = (
        1 - 2 * (y * y + z * z), 2 * (x * y - w * z), 2 * (x * z + w * y),
        2 * (x * y + w * z), 1 - 2 * (x * x + z * z), 2 * (y * z - w * x),
        2 * (x * z - w * y), 2 * (y * z + w * x), 1 - 2 * (x * x + y * y),
    )  # fmt: skip
    return torch.stack(entries, -1).unflatten(-1, (3, 3))


@torch.no_grad()
def isect_tiles(
    means2d: Tensor,
    radii: Tensor,
    depths: Tensor,
    tile_size: int,
    tile_width: int,
    tile_height: int,
    sort: bool = True,
    segmented: bool = False,
    packed: bool = False,
    n_images: int | None = None,
    image_ids: Tensor | None = None,
    gaussian_ids: Tensor | None = None,
) -> tuple[Tensor, Tensor, Tensor]:
    """List (image, tile, depth) of each Gaussian's box, in this order: tiles (c, n) a Gaussian, keys (i,) int64, rows (i,) of c n."""
    assert sort
    assert not packed
    count, n = depths.shape
    low = ((means2d - radii) / tile_size).floor().nan_to_num()
    high = ((means2d + radii) / tile_size).ceil().nan_to_num()
    limit = torch.tensor([tile_width, tile_height])
    low, high = (torch.minimum(edge.clamp_min(0), limit).long() for edge in (low, high))
    shown = (radii > 0).all(-1)
    tiles = torch.where(shown, (high - low).prod(-1), 0)
    rows = torch.repeat_interleave(torch.arange(count * n), tiles.flatten())
    within = torch.arange(len(rows)) - (tiles.flatten().cumsum(0) - tiles.flatten())[rows]
    across = (high - low).view(-1, 2)[rows, 0]
    corner = low.view(-1, 2)[rows]
    tile = (corner[:, 1] + within // across) * tile_width + corner[:, 0] + within % across
    depth = depths.flatten()[rows].contiguous().view(torch.int32).long() & 0xFFFFFFFF
    keys = ((rows // n) << (32 + bits(tile_width * tile_height))) | (tile << 32) | depth
    keys, order = keys.sort(stable=True)
    return tiles.int(), keys, rows[order].int()


def bits(count: int) -> int:
    return math.floor(math.log2(count)) + 1


@torch.no_grad()
def isect_offset_encode(isect_ids: Tensor, n_images: int, tile_width: int, tile_height: int) -> Tensor:
    """Give where the list of each tile begins: (c, tile rows, tile columns) int32."""
    tiles = tile_width * tile_height
    shift = bits(tiles)
    place = isect_ids >> 32
    flat = (place >> shift) * tiles + (place & ((1 << shift) - 1))
    starts = torch.searchsorted(flat, torch.arange(n_images * tiles))
    return starts.int().view(n_images, tile_height, tile_width)


def add_absolute(total: Tensor, ids: Tensor, gradient: Tensor) -> None:
    """Add the absolute values of gradients by pixels and Gaussians, summed over pixels."""
    total.index_add_(0, ids, gradient.abs().sum(0))


def rasterize_to_pixels(
    means2d: Tensor,
    conics: Tensor,
    colors: Tensor,
    opacities: Tensor,
    image_width: int,
    image_height: int,
    tile_size: int,
    isect_offsets: Tensor,
    flatten_ids: Tensor,
    backgrounds: Tensor | None = None,
    masks: Tensor | None = None,
    packed: bool = False,
    absgrad: bool = False,
) -> tuple[Tensor, Tensor]:
    """Blend front to back: images (c, h, w, k) and opacities (c, h, w, 1)."""
    assert masks is None
    assert not packed
    count, rows, columns = isect_offsets.shape
    assert colors.shape[:2] == means2d.shape[:2] == opacities.shape == conics.shape[:2]
    ends = torch.cat([isect_offsets.flatten()[1:], torch.tensor([len(flatten_ids)])]).tolist()
    starts = isect_offsets.flatten().tolist()
    absolute = torch.zeros_like(means2d)
    if absgrad:
        means2d.absgrad = absolute
    offsets = torch.arange(tile_size) + 0.5
    y, x = torch.meshgrid(offsets, offsets, indexing="ij")
    pixels = torch.stack([x.flatten(), y.flatten()], 1)
    tiles = []
    for place, (start, end) in enumerate(zip(starts, ends, strict=True)):
        image, tile = divmod(place, rows * columns)
        corner = torch.tensor([tile % columns, tile // columns]) * tile_size
        ids = flatten_ids[start:end].long()
        centres = means2d.flatten(0, 1)[ids].expand(len(pixels), -1, -1) + 0
        if absgrad and centres.requires_grad:
            centres.register_hook(partial(add_absolute, absolute.view(-1, 2), ids))
        dx, dy = (centres - (pixels + corner)[:, None]).unbind(-1)
        a, b, c = conics.flatten(0, 1)[ids].unbind(-1)
        sigma = 0.5 * (a * dx * dx + c * dy * dy) + b * dx * dy
        alpha = (opacities.flatten()[ids] * torch.exp(-sigma)).clamp_max(ALPHA_MAX)
        alpha = torch.where((sigma >= 0) & (alpha >= ALPHA_MIN), alpha, 0)
        after = torch.cumprod(1 - alpha, 1)
        blended = after > STOP  # the Gaussian that would close a pixel is left out, and so are all behind it
        before = torch.cat([torch.ones_like(after[:, :1]), after[:, :-1]], 1)
        colour = torch.where(blended, alpha * before, 0) @ colors.flatten(0, 1)[ids]
        left = torch.where(blended, 1 - alpha, 1).prod(1, keepdim=True)
        behind = 0 if backgrounds is None else backgrounds[image] * left
        tiles.append(torch.cat([colour + behind, 1 - left], 1))
    grid = torch.stack(tiles).view(count, rows, columns, tile_size, tile_size, -1)
    whole = grid.transpose(2, 3).reshape(count, rows * tile_size, columns * tile_size, -1)
    whole = whole[:, :image_height, :image_width]
    return whole[..., :-1], whole[..., -1:]
