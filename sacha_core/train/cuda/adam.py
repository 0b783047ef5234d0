"""Adam on a device: one step for all that is fitted, taken or not as a flag on the device says."""

from __future__ import annotations

from collections.abc import Mapping

import torch
from jaxtyping import Bool, Float
from torch import Tensor
from torch.nn.functional import hardshrink, threshold

from sacha_core.train.cuda.layout import GROUPS, Layout
from sacha_core.train.kernels.adam import TINIEST
from sacha_core.train.optimiser import BETAS, EPSILON

__all__ = ["DeviceAdam"]


class DeviceAdam:
    """Steps the numbers of a layout, as the CPU engine's Adam does.

    Args:
        layout: of values, moments and gradients.
        device: where they are.

    Attributes:
        first: first moments, in the layout.
        second: second moments, in the layout.

    Source: Kingma and Ba, Adam, 2015.
    """

    def __init__(self, layout: Layout, device: torch.device) -> None:
        self._layout = layout
        self._owner = layout.owner(device)
        self._group = torch.tensor([place for place, group in enumerate(GROUPS) for _ in GROUPS[group]], device=device)
        self._betas = torch.tensor(BETAS, dtype=torch.float64, device=device)
        self._steps = torch.zeros(len(GROUPS), dtype=torch.int64, device=device)
        self.first, self.second = (torch.zeros(layout.size, device=device) for _ in range(2))

    @property
    def steps(self) -> dict[str, int]:
        """Steps taken by each group; waits for the device."""
        return dict(zip(GROUPS, self._steps.tolist(), strict=True))

    @steps.setter
    def steps(self, steps: Mapping[str, int]) -> None:
        self._steps.copy_(torch.tensor([steps[group] for group in GROUPS]))

    def step(
        self,
        values: Float[Tensor, " p"],
        gradient: Float[Tensor, " p"],
        rates: Float[Tensor, " k"],
        sound: Bool[Tensor, ""],
        moving: frozenset[str],
    ) -> None:
        """Take one step; where `sound` is false, change nothing.

        Args:
            values: in the layout, changed.
            gradient: in the layout.
            rates: float64 learning rates, in the order of `NAMES`.
            sound: whether every gradient is finite.
            moving: attributes that step, and `motion` if the motion does. All else stays as it is, moments included; a group of which
                nothing moves counts no step.
        """
        if moving - {"motion"}:
            self._steps[0].add_(sound)
        if "motion" in moving:
            self._steps[1].add_(sound)
        # where the step is not taken, moments keep all and take nothing, and the rates are 0
        keep = torch.where(sound, self._betas, 1).float()
        take = torch.where(sound, 1 - self._betas, 0).float()
        correction = (1 - self._betas[:, None] ** self._steps).index_select(1, self._group)
        pace = torch.where(sound, rates / correction[0], 0).float()
        root = torch.where(sound, correction[1].rsqrt(), 1).float()
        for begin, end in self._layout.runs(moving):
            part = slice(begin, end)
            owner = self._owner[part]
            first, second, slope = self.first[part], self.second[part], torch.where(sound, gradient[part], 0)
            first.mul_(keep[0]).addcmul_(slope, take[0])
            second.mul_(keep[1]).addcmul_(slope * take[1], slope)
            first.copy_(hardshrink(first, float(TINIEST)))
            second.copy_(threshold(second, float(TINIEST), 0.0))
            divisor = second.sqrt().mul_(root.index_select(0, owner)).add_(EPSILON)
            values[part].sub_(pace.index_select(0, owner).mul_(first).div_(divisor))
