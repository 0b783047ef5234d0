"""From parameters to what is drawn: posing, frames, binding and colours, differentiable by torch."""

from __future__ import annotations

from collections.abc import Mapping

import torch
from jaxtyping import Bool, Float, Int
from torch import Tensor

from sacha_core.flame.model import HeadModel
from sacha_core.flame.posing import HeadMotion
from sacha_core.train.cuda.binding import carry, triangle_frames
from sacha_core.train.cuda.drawing import World
from sacha_core.train.cuda.harmonics import Harmonics
from sacha_core.train.cuda.posing import DeviceHead

__all__ = ["Scene"]


class Scene:
    """One person's Gaussians in a pose.

    Args:
        head: the head model.
        motion: whose static parameters make the person.
        device: where to compute.

    Raises:
        HeadError: the motion has components or vertex offsets that the head lacks.
    """

    def __init__(self, head: HeadModel, motion: HeadMotion, device: torch.device) -> None:
        self._head = DeviceHead(head, motion, device)
        self._faces = torch.from_numpy(head.faces.astype("int32")).to(device)
        self._harmonics = Harmonics(device)

    def place(
        self, values: Mapping[str, Tensor], binding: Int[Tensor, " n"]
    ) -> tuple[World, Float[Tensor, " f"], Bool[Tensor, ""]]:
        """Put the Gaussians into the world.

        Args:
            values: attributes of the Gaussians, and one row of each motion parameter, by name.
            binding: (n,) triangle of each Gaussian.

        Returns:
            The Gaussians, metres a local unit of each triangle, and whether every triangle has an area.
        """
        pose = torch.cat([values[name] for name in ("rotation", "neck", "jaw", "eyes")])
        vertices = self._head.pose(values["expression"], pose, values["translation"])
        frames = triangle_frames(vertices, self._faces)
        carried = carry(values["position"], values["log_scale"], values["quaternion"], binding, frames)
        world = World(*carried, values["opacity_logit"].sigmoid())
        return world, frames.scale.detach(), frames.sound.all()

    def colours(
        self, values: Mapping[str, Tensor], means: Float[Tensor, "n 3"], centres: Float[Tensor, "c 3"], degree: int
    ) -> Float[Tensor, "c n 4"]:
        """Give red, green, blue and sensitivity of the Gaussians as cameras at `centres` see them."""
        colours = self._harmonics.colours(values["sh_dc"], values["sh_rest"], means, centres, degree)
        sensitivity = values["sensitivity_logit"].sigmoid()[None, :, None]
        return torch.cat([colours, sensitivity.expand(len(centres), -1, -1)], 2)
