"""Where the arithmetic of training happens: what the CPU's engine and the GPU's both offer to the loop."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Protocol

import numpy as np
from jaxtyping import Float

from sacha_core.stopwatch import Stopwatch
from sacha_core.train.state import Arrays, TrainState
from sacha_core.train.views import Target

__all__ = ["Engine"]


class Engine(Protocol):
    """Holds the state of a run where it computes, and takes it through iterations.

    The loop decides when, an engine how. Between `put` and `take` the state on the host may be out of date, so that nothing has to
    wait for a device but at the rare events of density control, checkpoints and reports.

    Attributes:
        stopwatch: told how long each stage takes; None for nobody.
    """

    stopwatch: Stopwatch | None

    def put(self, state: TrainState) -> None:
        """Go on from a state: at the start, and after every change that the loop made to one it took.

        Gradients of the last `differentiate` that are not void stay good for the next `advance`.
        """

    def take(self) -> TrainState:
        """Give the state as it is now, faults included, on the host; `put` it back after changing it."""

    def differentiate(self, iteration: int, targets: Sequence[Target], degree: int) -> None:
        """Draw some views of one timestep, compare, and keep the gradients of the mean loss; adds to the statistics of growth.

        Where a loss or a gradient is not finite, or the pose leaves a triangle without area, that is a fault of the state: it is
        counted, the statistics stay as they are, and the next `advance` does nothing.

        Args:
            iteration: which one this is, counted from 1.
            targets: of one timestep; more than one where a step learns from several cameras at once. The statistics get from each what
                it would give alone.
            degree: of the spherical harmonics in use.
        """

    def advance(self, rates: Mapping[str, float], void: frozenset[str]) -> None:
        """Let Adam step with the gradients kept; not at all after a fault.

        Args:
            rates: learning rate of each attribute and motion parameter.
            void: attributes whose rows have changed since, and wait for the next iteration.
        """

    def losses(self) -> dict[str, float]:
        """Give the mean losses of the iterations since the last call: `total` and its parts; nothing where there was none without fault.

        May wait for a device.
        """

    def gradients(self) -> Arrays:
        """Give copies of the gradients of the last `differentiate`, by name; of the motion the row of its timestep, where it is fitted.

        For those who look at training; a step needs no copies. May wait for a device.
        """

    def weights(self, targets: Sequence[Target], degree: int) -> Float[np.ndarray, "n 2"]:
        """Give each Gaussian's blending weight summed over pixels of views of one timestep: plain, and by reference sensitivity.

        Leaves the gradients of the last `differentiate` as they are. A timestep that cannot be posed has no weights.
        """

    def removals(self, targets: Sequence[Target], degree: int) -> Float[np.ndarray, "n 4"]:
        """Give by how much views of one timestep would change if one Gaussian alone were not drawn.

        Four numbers of each, sums over pixels and colours: the squared change, plain and with each pixel weighted by its reference
        sensitivity, and the absolute change, likewise. All are 0 where nothing shows the Gaussian. Values count from 0 to 1.
        See `sacha_core.raster.rasteriser.Rasteriser.removal_changes`.

        Leaves the gradients of the last `differentiate` as they are. A timestep that cannot be posed changes nothing.
        """

    @property
    def triangle_scale(self) -> Float[np.ndarray, " f"]:
        """Metres a local unit, of each triangle, in the pose of the last `differentiate` that could pose."""
