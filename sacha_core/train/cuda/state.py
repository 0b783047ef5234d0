"""The state of a run on a device."""

from __future__ import annotations

import numpy as np
import torch
from jaxtyping import Bool, Float, Int
from torch import Tensor

from sacha_core.train.cuda.adam import DeviceAdam
from sacha_core.train.cuda.faults import DeviceFaults
from sacha_core.train.cuda.layout import Layout
from sacha_core.train.state import TrainState

__all__ = ["DeviceState"]


class DeviceState:
    """Values, gradients, moments, statistics and faults of a run, in memory that stays in place while no Gaussian comes or goes.

    Args:
        state: to begin with.
        device: where to keep it.

    Attributes:
        layout: of all that is fitted.
        values: by name, parts of `flat_values`.
        gradients: by name, parts of `flat_gradient`; of the motion zero but for the rows of one timestep.
        motion: (t, w) all parameters of each timestep side by side, a part of `flat_values`.
        motion_gradient: likewise.
        flat_values: in the layout.
        flat_gradient: in the layout.
        binding: (n,) triangle of each Gaussian.
        gradient_sum: (n,) see `TrainState`.
        gradient_count: (n,) see `TrainState`.
        adam: moments and step counts.
        faults: found since the last `get`.
    """

    def __init__(self, state: TrainState, device: torch.device) -> None:
        self.layout = Layout.of(state.values)
        self.flat_values, self.flat_gradient = (torch.zeros(self.layout.size, device=device) for _ in range(2))
        self.values, self.gradients = self.layout.views(self.flat_values), self.layout.views(self.flat_gradient)
        self.motion, self.motion_gradient = self.layout.table(self.flat_values), self.layout.table(self.flat_gradient)
        n = len(state)
        self.binding: Int[Tensor, " n"] = torch.zeros(n, dtype=torch.int32, device=device)
        self.gradient_sum: Float[Tensor, " n"] = torch.zeros(n, device=device)
        self.gradient_count: Int[Tensor, " n"] = torch.zeros(n, dtype=torch.int32, device=device)
        self.adam = DeviceAdam(self.layout, device)
        self.faults = DeviceFaults(self.layout, device)
        self.set(state)

    def fits(self, state: TrainState) -> bool:
        """Tell whether a state has the layout of this one."""
        return Layout.of(state.values) == self.layout

    def set(self, state: TrainState) -> None:
        """Take everything from a state that fits; gradients stay."""
        pairs = (
            (self.flat_values, self.layout.pack(state.values)),
            (self.adam.first, self.layout.pack(state.first)),
            (self.adam.second, self.layout.pack(state.second)),
            (self.binding, state.binding),
            (self.gradient_sum, state.gradient_sum),
            (self.gradient_count, state.gradient_count),
        )
        for tensor, array in pairs:
            tensor.copy_(torch.from_numpy(np.ascontiguousarray(array)))
        self.adam.steps = state.steps

    def get(self, state: TrainState) -> None:
        """Write everything to the state that this one was made of or set to."""
        for flat, arrays in (
            (self.flat_values, state.values),
            (self.adam.first, state.first),
            (self.adam.second, state.second),
        ):
            self.layout.unpack(flat.cpu().numpy(), arrays)
        state.gradient_sum[...] = self.gradient_sum.cpu().numpy()
        state.gradient_count[...] = self.gradient_count.cpu().numpy()
        state.steps.update(self.adam.steps)
        state.faults = self.faults.drain(state.faults)

    def inherit(self, other: DeviceState) -> None:
        """Take over the gradients of the motion, which stay good when Gaussians come and go."""
        self.motion_gradient.copy_(other.motion_gradient)

    def count(self, lengths: Float[Tensor, " n"], seen: Int[Tensor, " n"], sound: Bool[Tensor, ""]) -> None:
        """Add to the statistics what a step without fault says.

        Args:
            lengths: (n,) of image gradients, summed over the views.
            seen: (n,) in how many views each Gaussian was visible.
            sound: whether the step is without fault.
        """
        self.gradient_sum += torch.where(sound, lengths, 0)
        self.gradient_count += torch.where(sound, seen, 0).int()
