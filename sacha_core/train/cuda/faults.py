"""Steps that must not be taken, found and counted on a device, and read when somebody asks."""

from __future__ import annotations

from collections.abc import Mapping

import torch
from jaxtyping import Bool, Float, Int
from torch import Tensor

from sacha_core.train.cuda.layout import NAMES, Layout
from sacha_core.train.faults import LARGEST_GRADIENT, Fault, Faults
from sacha_core.train.state import ATTRIBUTES, FITTED_MOTION

__all__ = ["DeviceFaults"]

SOUND = torch.iinfo(torch.int32).max
POSE = 0  # codes, the earlier cause below the later: the pose; colours by row; gradients by row and attribute; motion; the loss


class DeviceFaults:
    """Counts faults and remembers the first, as a code and an iteration.

    Args:
        layout: of the gradients.
        device: where they are.
    """

    def __init__(self, layout: Layout, device: torch.device) -> None:
        self._n = layout.shapes[0][0]
        self._codes = self._code_gradients(layout, device)
        self._rows = torch.arange(1, self._n + 1, dtype=torch.int32, device=device)
        self._count, self._first, self._iteration = (
            torch.zeros((), dtype=torch.int64, device=device) for _ in range(3)
        )
        self._timestep = torch.zeros((), dtype=torch.int64, device=device)

    def note(
        self,
        moment: Int[Tensor, "2"],
        posed: Bool[Tensor, ""],
        colours: Float[Tensor, "c n k"],
        gradient: Float[Tensor, " p"],
        loss: Float[Tensor, ""],
    ) -> Bool[Tensor, ""]:
        """Look for a fault; count it if there is one, and tell whether there is none.

        Args:
            moment: iteration and timestep.
            posed: whether every triangle has an area.
            colours: (c, n, k) of Gaussians, as each camera sees them.
            gradient: in the layout.
            loss: of the iteration.
        """
        dark = ~colours.isfinite().all(2).all(0)
        steep = ~(gradient.abs() <= LARGEST_GRADIENT)  # true for what is not a number
        causes = (
            torch.where(posed, SOUND, POSE),
            torch.where(dark, self._rows, SOUND).amin(),
            torch.where(steep, self._codes, SOUND).amin(),
            torch.where(loss.isfinite(), SOUND, self._loss_code),
        )
        code = torch.stack([cause.to(torch.int64) for cause in causes]).amin()
        sound = code == SOUND
        is_first = ~sound & (self._count == 0)
        for kept, new in ((self._first, code), (self._iteration, moment[0]), (self._timestep, moment[1])):
            kept.copy_(torch.where(is_first, new, kept))
        self._count += ~sound
        return sound

    def drain(self, before: Faults) -> Faults:
        """Give the faults with those that came since the last call; waits for the device."""
        count, code, iteration, timestep = (
            int(value) for value in torch.stack([self._count, self._first, self._iteration, self._timestep]).tolist()
        )
        if count == 0:
            return before
        self._count.zero_()
        return Faults(before.count + count, before.first or Fault(iteration, *self._cause(code, timestep)))

    @property
    def _loss_code(self) -> int:
        return 1 + self._n * (1 + len(ATTRIBUTES)) + len(FITTED_MOTION)

    def _code_gradients(self, layout: Layout, device: torch.device) -> Int[Tensor, " p"]:
        """Give the code of a fault in each number of the layout."""
        codes = torch.full((layout.size,), SOUND, dtype=torch.int32, device=device)
        views: Mapping[str, Tensor] = layout.views(codes)
        attributes = len(ATTRIBUTES)
        start = 1 + self._n
        for place, name in enumerate(NAMES):
            view = views[name]
            if place < attributes:
                rows = torch.arange(self._n, dtype=torch.int32, device=device) * attributes + (start + place)
                view.copy_(rows.view(-1, *[1] * (view.dim() - 1)).expand_as(view))
            else:
                view.fill_(start + self._n * attributes + place - attributes)
        return codes

    def _cause(self, code: int, timestep: int) -> tuple[str, int]:
        """Give the parameter and the row of a fault."""
        attributes, gradients = len(ATTRIBUTES), code - 1 - self._n
        if code == POSE:
            return "pose", timestep
        if gradients < 0:
            return "colour", code - 1
        if gradients < self._n * attributes:
            return ATTRIBUTES[gradients % attributes], gradients // attributes
        if code == self._loss_code:
            return "loss", timestep
        return FITTED_MOTION[gradients - self._n * attributes], timestep
