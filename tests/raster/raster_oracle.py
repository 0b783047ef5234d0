"""The definition that the kernels are held to: a sequential float64 compositor, one Gaussian after the other, without tiles or boxes."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import torch

from sacha_core.raster.camera import Camera
from sacha_core.raster.splats import Splats

ALPHA_MIN, ALPHA_MAX, STOP, DILATION, SLACK = 1 / 255, 0.99, 1e-4, 0.3, 0.15
NAMES = ("means", "scales", "quaternions", "opacities", "colours", "means_2d")


@dataclass
class OracleFrame:
    image: torch.Tensor  # (c, h, w)
    transmittance: torch.Tensor  # (h, w)
    weights: torch.Tensor  # (n, h, w)
    band: np.ndarray  # (h, w): relative distance of the nearest decision at a threshold


def parameters(splats: Splats, gradients: bool = False) -> dict[str, torch.Tensor]:
    """Give float64 leaves of what can be differentiated; `means_2d` is a shift of the projected means, pixels."""
    leaves = {name: torch.tensor(np.asarray(getattr(splats, name), np.float64)) for name in NAMES[:5]}
    leaves["means_2d"] = torch.zeros(len(splats.means), 2, dtype=torch.float64)
    for leaf in leaves.values():
        leaf.requires_grad_(gradients)
    return leaves


def rotations(quaternions: torch.Tensor) -> torch.Tensor:
    w, x, y, z = (quaternions / quaternions.norm(dim=1, keepdim=True)).unbind(1)
    rows = [
        torch.stack([1 - 2 * (y * y + z * z), 2 * (x * y - w * z), 2 * (x * z + w * y)], 1),
        torch.stack([2 * (x * y + w * z), 1 - 2 * (x * x + z * z), 2 * (y * z - w * x)], 1),
        torch.stack([2 * (x * z - w * y), 2 * (y * z + w * x), 1 - 2 * (x * x + y * y)], 1),
    ]
    return torch.stack(rows, 1)


def draw(
    leaves: dict[str, torch.Tensor], camera: Camera, background: np.ndarray, depths: np.ndarray, near: float = 0.1
) -> OracleFrame:
    """Composite in the order of `depths`, the kernel's own float32 depths; ties keep their order."""
    rotation, translation = torch.tensor(camera.rotation), torch.tensor(camera.translation)
    x, y, z = (leaves["means"] @ rotation.T + translation).unbind(1)
    low_x, high_x = -(camera.cx + SLACK * camera.width), camera.width - camera.cx + SLACK * camera.width
    low_y, high_y = -(camera.cy + SLACK * camera.height), camera.height - camera.cy + SLACK * camera.height
    slope_x = (x / z).clamp(low_x / camera.fx, high_x / camera.fx)
    slope_y = (y / z).clamp(low_y / camera.fy, high_y / camera.fy)
    nothing = torch.zeros_like(z)
    jacobian = torch.stack(
        [
            torch.stack([camera.fx / z, nothing, -camera.fx * slope_x / z], 1),
            torch.stack([nothing, camera.fy / z, -camera.fy * slope_y / z], 1),
        ],
        1,
    )
    axes = rotations(leaves["quaternions"]) * leaves["scales"][:, None, :]
    flat = jacobian @ rotation @ axes
    covariance = flat @ flat.transpose(1, 2) + DILATION * torch.eye(2, dtype=torch.float64)
    conic = torch.linalg.inv(covariance)
    mean_x = camera.fx * x / z + camera.cx + leaves["means_2d"][:, 0]
    mean_y = camera.fy * y / z + camera.cy + leaves["means_2d"][:, 1]

    pixel_x = torch.arange(camera.width, dtype=torch.float64)[None, :] + 0.5
    pixel_y = torch.arange(camera.height, dtype=torch.float64)[:, None] + 0.5
    image = torch.zeros(leaves["colours"].shape[1], camera.height, camera.width, dtype=torch.float64)
    transmittance = torch.ones(camera.height, camera.width, dtype=torch.float64)
    still_open = torch.ones(camera.height, camera.width, dtype=torch.bool)
    band = np.full((camera.height, camera.width), np.inf)
    weights = torch.zeros(len(z), camera.height, camera.width, dtype=torch.float64)
    for g in np.argsort(depths, kind="stable").tolist():
        if not float(z[g].detach()) > near:
            continue
        dx, dy = pixel_x - mean_x[g], pixel_y - mean_y[g]
        power = -0.5 * (conic[g, 0, 0] * dx**2 + 2 * conic[g, 0, 1] * dx * dy + conic[g, 1, 1] * dy**2)
        alpha = leaves["opacities"][g] * torch.exp(power)
        shown = still_open & (alpha >= ALPHA_MIN)
        near_cut = np.where(still_open.numpy(), np.abs(alpha.detach().numpy() / ALPHA_MIN - 1), np.inf)
        alpha = alpha.clamp(max=ALPHA_MAX)
        after = transmittance * (1 - alpha)
        near_stop = np.where(shown.numpy(), np.abs(after.detach().numpy() / STOP - 1), np.inf)
        band = np.minimum(band, np.minimum(near_cut, near_stop))
        passes = shown & (after > STOP)
        still_open = still_open & ~(shown & ~passes)
        weight = torch.where(passes, alpha * transmittance, 0.0)
        weights[g] = weight.detach()
        image = image + weight * leaves["colours"][g][:, None, None]
        transmittance = torch.where(passes, after, transmittance)
    behind = torch.tensor(np.asarray(background, np.float64))
    return OracleFrame(image + behind[:, None, None] * transmittance, transmittance, weights, band)
