"""Steps that must not be taken, found and counted on a device, and read when somebody asks."""

from __future__ import annotations

import torch
from jaxtyping import Bool, Float, Int
from torch import Tensor

from sacha_core.raster.splats import LARGEST_COLOUR
from sacha_core.train.cuda.layout import Layout
from sacha_core.train.faults import CAUSES, LARGEST_GRADIENT, Fault, Faults
from sacha_core.train.state import FITTED_MOTION

__all__ = ["DeviceFaults"]

SOUND = torch.iinfo(torch.int32).max
POSE = 0  # codes, the earlier cause below the later: the pose; colours by row; gradients by row and cause; motion; the loss


class DeviceFaults:
    """Counts faults and remembers the first, as a code with its iteration and timestep.

    Args:
        layout: of the gradients.
        device: where they are.
    """

    def __init__(self, layout: Layout, device: torch.device) -> None:
        self._n = layout.n_gaussians
        self._codes = self._code_gradients(layout, device)
        self._rows = torch.arange(1, self._n + 1, dtype=torch.int32, device=device)
        self._count = torch.zeros(1, dtype=torch.int64, device=device)
        self._first = torch.zeros(3, dtype=torch.int64, device=device)

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
        lit = (colours.abs() < float(LARGEST_COLOUR)).all(2).all(0)  # as are the next: false for what is not a number
        gentle = gradient.abs() <= LARGEST_GRADIENT
        code = torch.stack(
            [
                torch.where(posed, SOUND, POSE),
                torch.where(lit, SOUND, self._rows).amin().long(),
                torch.where(gentle, SOUND, self._codes).amin().long(),
                torch.where(loss.isfinite(), SOUND, self._loss_code),
            ]
        ).amin()
        fault = code != SOUND
        is_first = fault & (self._count == 0)
        self._first.copy_(torch.where(is_first, torch.cat([code[None], moment]), self._first))
        self._count += fault
        return ~fault

    def drain(self, before: Faults) -> Faults:
        """Give the faults with those that came since the last call; waits for the device."""
        count, code, iteration, timestep = torch.cat([self._count, self._first]).tolist()
        if count == 0:
            return before
        self._count.zero_()
        return Faults(before.count + count, before.first or Fault(iteration, *self._cause(code, timestep)))

    @property
    def _loss_code(self) -> int:
        return 1 + self._n * (1 + len(CAUSES)) + len(FITTED_MOTION)

    def _code_gradients(self, layout: Layout, device: torch.device) -> Int[Tensor, " p"]:
        """Give the code of a fault in each number of the layout."""
        codes = torch.full((layout.size,), SOUND, dtype=torch.int32, device=device)
        views, start, count = layout.views(codes), 1 + self._n, len(CAUSES)
        for place, name in enumerate(CAUSES):
            rows = torch.arange(self._n, dtype=torch.int32, device=device) * count + (start + place)
            views[name].copy_(rows.view(-1, *[1] * (views[name].dim() - 1)).expand_as(views[name]))
        for place, name in enumerate(FITTED_MOTION):
            views[name].fill_(start + self._n * count + place)
        return codes

    def _cause(self, code: int, timestep: int) -> tuple[str, int]:
        """Give the parameter and the row of a fault."""
        count, place = len(CAUSES), code - 1 - self._n
        if code == POSE:
            return "pose", timestep
        if place < 0:
            return "colour", code - 1
        if place < self._n * count:
            return CAUSES[place % count], place // count
        if code == self._loss_code:
            return "loss", timestep
        return FITTED_MOTION[place - self._n * count], timestep
