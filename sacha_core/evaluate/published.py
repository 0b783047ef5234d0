"""What papers report of other methods, and the bytes of an avatar counted as they count them."""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple

from sacha_core.avatar.gaussians import PLY_BYTES_PER_GAUSSIAN, Gaussians
from sacha_core.avatar.motion import Motion

__all__ = ["PROTOCOL", "REPORTED", "ModelBytes", "Reported", "model_bytes"]


class Reported(NamedTuple):
    """One row of a published table: novel expressions of ten NeRSemble subjects.

    Args:
        method: as the paper calls it.
        megabytes: Gaussians, bindings and FLAME parameters, 10^6 bytes.
        psnr: decibels.
        ssim: structural similarity.
        lpips: the paper does not say with which network; by its size it is VGG.
    """

    method: str
    megabytes: float
    psnr: float
    ssim: float
    lpips: float


# Source: SACHA, table 1.
REPORTED = (
    Reported("GaussianAvatars", 100.08, 25.5097, 0.9102, 0.1103),
    Reported("TGA", 21.78, 25.8089, 0.9125, 0.1364),
    Reported("TexAvatars", 69.67, 26.5422, 0.9087, 0.0596),
    Reported("SVG-Head", 84.99, 24.9033, 0.9010, 0.1270),
    Reported("SACHA, best level", 2.83, 25.4799, 0.9103, 0.1202),
)
PROTOCOL = (
    "reported: ten NeRSemble subjects, 802x550, held-out expressions, 100 images a subject; other subjects than yours, so rows compare "
    "in columns only as far as captures do. LPIPS there: network not stated, probably VGG."
)

FLOAT = 4  # bytes
A_FRAME = 100 + 3 + 3 + 3 + 6 + 3  # expression, rotation, neck, jaw, eyes, translation
IDENTITY = 300


@dataclass(frozen=True)
class ModelBytes:
    """Bytes of an avatar as GaussianAvatars saves it: 32-bit floats without a header.

    Args:
        gaussians: 63 numbers for each, binding among them.
        motion: shape, static offset and the parameters of each frame.
        dynamic_offset: the vertex offsets of each frame that are saved and always zero.
    """

    gaussians: int
    motion: int
    dynamic_offset: int

    @property
    def without_offset(self) -> int:
        """What has to be kept."""
        return self.gaussians + self.motion

    @property
    def with_offset(self) -> int:
        """What is saved."""
        return self.without_offset + self.dynamic_offset


def model_bytes(gaussians: Gaussians, motion: Motion | None, n_vertices: int) -> ModelBytes:
    """Count the bytes of an avatar as GaussianAvatars saves it.

    Args:
        gaussians: the avatar's.
        motion: its motion, or None.
        n_vertices: of its head.

    Source: GaussianAvatars' saved models: `point_cloud.ply` and `flame_param.npz`.
    """
    frames = 0 if motion is None else len(motion)
    person = IDENTITY + 3 * n_vertices if frames else 0
    return ModelBytes(
        gaussians=PLY_BYTES_PER_GAUSSIAN * len(gaussians),
        motion=FLOAT * (person + A_FRAME * frames),
        dynamic_offset=FLOAT * 3 * n_vertices * frames,
    )
