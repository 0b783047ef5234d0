"""One view's loss as the method defines it, from parameters to a number, in float64 and differentiable.

Written from the formulas alone, in torch, so that it can be held against the shipped kernels and against finite differences. Whatever the
method decides by comparing numbers is recorded, and can be kept fixed: the loss is then a smooth function of all parameters.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache

import numpy as np
import torch
from jaxtyping import Bool, Float, Int
from torch import Tensor

from sacha_core.bench.exact import Decisions, ExactFrame, Leaves, draw, rotation_matrices
from sacha_core.bench.stability.exact_head import ExactHead
from sacha_core.raster.camera import Camera
from sacha_core.train.options import LossOptions
from sacha_core.train.state import ATTRIBUTES, FITTED_MOTION, TrainState
from sacha_core.train.views import Target

__all__ = ["ExactLoss", "Seen", "StepDecisions", "exact_loss", "step_leaves", "world_leaves"]

BACKGROUND = np.array([1.0, 1.0, 1.0, 0.0])  # white, and not sensitive
CLAMP = 1e-6  # of the sensitivity channel, before its logarithm
C1, C2, SIGMA, RADIUS = 0.01**2, 0.03**2, 1.5, 5  # of SSIM (Wang et al. 2004)


@dataclass(frozen=True)
class StepDecisions:
    """What one view's loss decides by comparing.

    Args:
        picture: of the compositor.
        lit: (n, 3) which colours are above 0.
        brighter: (3, h, w) sign of image minus target, which the absolute difference turns at.
        unclamped: (h, w) where the sensitivity channel lies inside its bounds.
        strayed: (n,) Gaussians penalised for their place: in view, and beyond the limit.
        swollen: (n, 3) axes penalised for their size, likewise.
        n_visible: how many Gaussians are in view.
    """

    picture: Decisions
    lit: Bool[Tensor, "n 3"]
    brighter: Float[Tensor, "3 h w"]
    unclamped: Bool[Tensor, "h w"]
    strayed: Bool[Tensor, " n"]
    swollen: Bool[Tensor, "n 3"]
    n_visible: int


@dataclass(frozen=True)
class Seen:
    """A view, and what the kernel finds in it that is part of the definition of its loss.

    Args:
        target: what its picture is compared with.
        depths: (n,) float32, by which Gaussians are sorted.
        visible: (n,) which touch a tile, whose penalties count.
    """

    target: Target
    depths: Float[np.ndarray, " n"]
    visible: Bool[np.ndarray, " n"]


@dataclass(frozen=True)
class ExactLoss:
    """What one view costs.

    Args:
        parts: `total`, and its parts before their weights but for the penalties, as training reports them.
        frame: the picture.
        decisions: that were taken.
    """

    parts: dict[str, Tensor]
    frame: ExactFrame
    decisions: StepDecisions


def step_leaves(state: TrainState, timestep: int, learn: bool = False) -> Leaves:
    """Give the parameters that one view depends on as float64 tensors: all of the Gaussians', and a timestep's of the motion.

    Args:
        state: of a run.
        timestep: whose motion.
        learn: whether gradients are wanted.
    """
    arrays = {name: state.values[name] for name in ATTRIBUTES} | {
        name: state.values[name][timestep] for name in FITTED_MOTION
    }
    leaves = {name: torch.tensor(array.astype(np.float64)) for name, array in arrays.items()}
    for leaf in leaves.values():
        leaf.requires_grad_(learn)
    return leaves


def world_leaves(
    leaves: Leaves,
    head: ExactHead,
    binding: Int[np.ndarray, " n"],
    camera: Camera,
    degree: int,
    lit: Bool[Tensor, "n 3"] | None = None,
) -> tuple[Leaves, Bool[Tensor, "n 3"]]:
    """Carry Gaussians to the world and colour them: what the compositor draws, and which colours are above 0.

    Source: Qian et al., GaussianAvatars, CVPR 2024, equations 2 to 4; Kerbl et al., 3D Gaussian Splatting, SIGGRAPH 2023 (harmonics).
    """
    rotation, scale, origin = head.frames(head.vertices(leaves))
    face = torch.from_numpy(binding.astype(np.int64))
    means = scale[face, None] * torch.einsum("nij,nj->ni", rotation[face], leaves["position"]) + origin[face]
    turned = rotation[face] @ rotation_matrices(leaves["quaternion"])
    towards = means - torch.from_numpy(np.asarray(camera.centre, np.float64))
    basis = harmonics(towards / towards.norm(dim=1, keepdim=True), degree)
    series = torch.cat([leaves["sh_dc"][:, None], leaves["sh_rest"][:, : (degree + 1) ** 2 - 1]], 1)
    colours = torch.einsum("nk,nkc->nc", basis, series) + 0.5
    lit = colours.detach() > 0 if lit is None else lit
    sensitivity = torch.sigmoid(leaves["sensitivity_logit"])[:, None]
    world = {
        "means": means,
        "scales": scale[face, None] * torch.exp(leaves["log_scale"]),
        "quaternions": quaternions(turned),
        "opacities": torch.sigmoid(leaves["opacity_logit"]),
        "colours": torch.cat([torch.where(lit, colours, 0.0), sensitivity], 1),
    }
    return world, lit


def exact_loss(
    leaves: Leaves,
    head: ExactHead,
    binding: Int[np.ndarray, " n"],
    view: Seen,
    degree: int,
    weights: LossOptions,
    decisions: StepDecisions | None = None,
    shift: Float[Tensor, "n 2"] | None = None,
) -> ExactLoss:
    """Give one view's loss.

    Args:
        leaves: as `step_leaves` gives them.
        head: whose triangles carry the Gaussians.
        binding: (n,) triangle of each.
        view: that is compared.
        degree: of the spherical harmonics in use.
        weights: of the losses.
        decisions: what to decide; None for what the definition says.
        shift: (n, 2) pixels that projected means are moved by; None for nothing.

    Source: Qian et al., GaussianAvatars, CVPR 2024, section 3.4; Zhou et al., Perceptual-GS, 2025 (cross-entropy).
    """
    kept, target = decisions, view.target
    world, lit = world_leaves(leaves, head, binding, target.camera, degree, None if kept is None else kept.lit)
    if shift is not None:
        world["means_2d"] = shift
    frame = draw(world, target.camera, BACKGROUND, view.depths, decisions=None if kept is None else kept.picture)
    wanted = torch.from_numpy(target.image.astype(np.float64) / 255)
    difference = frame.image[:3] - wanted
    brighter = torch.sign(difference.detach()) if kept is None else kept.brighter
    sensitive = frame.image[3]
    inside = sensitive.detach().clamp(CLAMP, 1 - CLAMP)
    unclamped = sensitive.detach() == inside if kept is None else kept.unclamped
    predicted = torch.where(unclamped, sensitive, inside)
    reference = torch.from_numpy(target.sensitivity.astype(np.float64) / 255)
    seen = torch.from_numpy(view.visible)
    distance = leaves["position"].norm(dim=1)
    spread = torch.exp(leaves["log_scale"])
    if kept is None:
        strayed = seen & (distance.detach() > weights.position_limit)
        swollen = seen[:, None] & (spread.detach() > weights.scale_limit)
        kept = StepDecisions(frame.decisions, lit, brighter, unclamped, strayed, swollen, max(int(seen.sum()), 1))
    rows = kept.swollen.any(1)  # elsewhere the length is 0 and has no slope
    excess = torch.where(kept.swollen[rows], spread[rows] - weights.scale_limit, 0.0).norm(dim=1)
    parts = {
        "l1": (difference * brighter).mean(),
        "ssim": structural_similarity(frame.image[:3], wanted),
        "sensitivity": -(reference * predicted.log() + (1 - reference) * (1 - predicted).log()).mean(),
        "position": weights.position * (distance[kept.strayed] - weights.position_limit).sum() / kept.n_visible,
        "scale": weights.scale * excess.sum() / kept.n_visible,
    }
    photometric = (
        weights.l1 * parts["l1"] + weights.ssim * (1 - parts["ssim"]) + weights.sensitivity * parts["sensitivity"]
    )
    return ExactLoss({"total": photometric + parts["position"] + parts["scale"], **parts}, frame, kept)


def structural_similarity(image: Float[Tensor, "c h w"], wanted: Float[Tensor, "c h w"]) -> Tensor:
    """Mean SSIM: 11 x 11 Gaussian window, sigma 1.5, zero padding.

    Source: Wang et al., Image quality assessment, 2004.
    """
    down, across = (_window(side) for side in image.shape[1:])
    x, y, xx, yy, xy = (
        down @ planes @ across for planes in (image, wanted, image * image, wanted * wanted, image * wanted)
    )
    above = (2 * x * y + C1) * (2 * (xy - x * y) + C2)
    below = (x * x + y * y + C1) * (xx - x * x + yy - y * y + C2)
    similarity: Tensor = (above / below).mean()
    return similarity


@lru_cache(maxsize=4)
def _window(side: int) -> Float[Tensor, "s s"]:
    """Give the matrix that blurs along a side; it is symmetric."""
    taps = np.exp(-(np.arange(-RADIUS, RADIUS + 1) ** 2) / (2 * SIGMA**2))
    apart = np.abs(np.subtract.outer(np.arange(side), np.arange(side)))
    return torch.from_numpy(np.where(apart <= RADIUS, np.exp(-(apart**2) / (2 * SIGMA**2)), 0) / taps.sum())


def quaternions(rotation: Float[Tensor, "n 3 3"]) -> Float[Tensor, "n 4"]:
    """Give the quaternion of each rotation, from the row of 4 q q^T with the largest diagonal entry.

    Source: Shepperd, Quaternion from rotation matrix, 1978.
    """
    (xx, xy, xz), (yx, yy, yz), (zx, zy, zz) = ((row[:, 0], row[:, 1], row[:, 2]) for row in rotation.unbind(1))
    table = torch.stack([
        torch.stack([1 + xx + yy + zz, zy - yz, xz - zx, yx - xy], 1),
        torch.stack([zy - yz, 1 + xx - yy - zz, xy + yx, xz + zx], 1),
        torch.stack([xz - zx, xy + yx, 1 - xx + yy - zz, yz + zy], 1),
        torch.stack([yx - xy, xz + zx, yz + zy, 1 - xx - yy + zz], 1),
    ], 1)  # fmt: skip
    largest = table.detach().diagonal(dim1=1, dim2=2).argmax(1)
    chosen = table[torch.arange(len(table)), largest]
    unit: Tensor = chosen / chosen.norm(dim=1, keepdim=True)
    return unit


def harmonics(direction: Float[Tensor, "n 3"], degree: int) -> Float[Tensor, "n k"]:
    """Give the real spherical harmonics up to a degree, with the Condon-Shortley phase, at unit vectors.

    Source: Kerbl et al., 3D Gaussian Splatting, SIGGRAPH 2023.
    """
    x, y, z = direction.unbind(1)
    pi = np.pi
    functions = [torch.full_like(x, (1 / (4 * pi)) ** 0.5)]
    if degree > 0:
        functions += [-((3 / (4 * pi)) ** 0.5) * y, (3 / (4 * pi)) ** 0.5 * z, -((3 / (4 * pi)) ** 0.5) * x]
    if degree > 1:
        a, b, c = (15 / (4 * pi)) ** 0.5, (5 / (16 * pi)) ** 0.5, (15 / (16 * pi)) ** 0.5
        functions += [a * x * y, -a * y * z, b * (3 * z * z - 1), -a * x * z, c * (x * x - y * y)]
    if degree > 2:
        a, b, c = (35 / (32 * pi)) ** 0.5, (105 / (4 * pi)) ** 0.5, (21 / (32 * pi)) ** 0.5
        d, e = (7 / (16 * pi)) ** 0.5, (105 / (16 * pi)) ** 0.5
        functions += [
            -a * y * (3 * x * x - y * y), b * x * y * z, -c * y * (5 * z * z - 1), d * z * (5 * z * z - 3), -c * x * (5 * z * z - 1),
            e * z * (x * x - y * y), -a * x * (x * x - 3 * y * y),
        ]  # fmt: skip
    return torch.stack(functions, 1)
