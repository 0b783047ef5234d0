"""From parameters to what is drawn: posing, frames, binding and colours, differentiable by torch."""

from __future__ import annotations

from collections.abc import Mapping

import torch
from jaxtyping import Bool, Float, Int
from torch import Tensor

from sacha_core.flame.model import HeadModel
from sacha_core.flame.posing import HeadMotion
from sacha_core.train.cuda.binding import Binder
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
        self._binder = Binder(head.faces, device)
        self._harmonics = Harmonics(device)

    def place(
        self, values: Mapping[str, Tensor], row: Float[Tensor, " w"], binding: Int[Tensor, " n"]
    ) -> tuple[World, Float[Tensor, " f"], Bool[Tensor, ""]]:
        """Put the Gaussians into the world.

        Args:
            values: attributes of the Gaussians, by name.
            row: motion parameters in the order of `FITTED_MOTION`.
            binding: (n,) triangle of each Gaussian.

        Returns:
            The Gaussians, metres a local unit of each triangle, and whether every triangle has an area.
        """
        frames = self._binder.frames(self._head.pose(row))
        local = (values["position"], values["log_scale"], values["quaternion"])
        world = World(*self._binder.carry(*local, binding, frames), values["opacity_logit"].sigmoid())
        return world, frames.scale.detach(), frames.sound.all()

    def colours(
        self, values: Mapping[str, Tensor], means: Float[Tensor, "n 3"], centres: Float[Tensor, "c 3"], degree: int
    ) -> Float[Tensor, "c n 4"]:
        """Give red, green, blue and sensitivity of the Gaussians as cameras at `centres` see them."""
        colours = self._harmonics.colours(values["sh_dc"], values["sh_rest"], means, centres, degree)
        sensitivity = values["sensitivity_logit"].sigmoid()[None, :, None]
        return torch.cat([colours, sensitivity.expand(len(centres), -1, -1)], 2)
