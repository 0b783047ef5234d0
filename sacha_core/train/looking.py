"""Looking at a state without learning: what each Gaussian gives to the views of a timestep."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from contextlib import AbstractContextManager

import numpy as np
from jaxtyping import Float

from sacha_core.errors import GeometryError
from sacha_core.parallel.pool import Pool
from sacha_core.raster.rasteriser import Rasteriser
from sacha_core.raster.splats import ColourError
from sacha_core.train.drawing import Drawer, Drawing
from sacha_core.train.optimiser import Adam
from sacha_core.train.rig import Rig
from sacha_core.train.state import TrainState
from sacha_core.train.views import Target

__all__ = ["Looker"]

UNIT = np.float32(1 / 255)
REMOVALS = 4  # numbers of a Gaussian: squared and absolute change, each plain and by reference sensitivity
COLOURS = 3  # channels that come before the sensitivity


class Looker:
    """Poses and draws a state, and sums over pixels what each Gaussian does there.

    A timestep that cannot be posed shows nothing, nor does a view with a colour that is not finite: those are faults of the state, counted
    where it is trained on.

    Args:
        rig: poses.
        rasteriser: draws.
        pool: shares out the work.
        time: measures a stage.
    """

    def __init__(
        self, rig: Rig, rasteriser: Rasteriser, pool: Pool, time: Callable[[str], AbstractContextManager[None]]
    ) -> None:
        self._rig, self._rasteriser = rig, rasteriser
        self._drawer, self._adam = Drawer(rasteriser, pool, time), Adam(pool)

    def weights(self, state: TrainState, targets: Sequence[Target]) -> Float[np.ndarray, "n 2"]:
        """See `sacha_core.train.engine.Engine.weights`."""
        weights = np.zeros((len(state), 2))
        for target, drawing in self._drawings(state, targets, None):
            weights += self._rasteriser.colour_weights(drawing.frame, pixel_weights(target, drawing))
        return weights

    def removals(self, state: TrainState, targets: Sequence[Target], degree: int) -> Float[np.ndarray, "n 4"]:
        """See `sacha_core.train.engine.Engine.removals`."""
        changes = np.zeros((len(state), REMOVALS))
        for target, drawing in self._drawings(state, targets, degree):
            found = self._rasteriser.removal_changes(drawing.frame, pixel_weights(target, drawing), COLOURS)
            changes += np.concatenate([found.squared, found.absolute], axis=1)
        return changes

    def _drawings(
        self, state: TrainState, targets: Sequence[Target], degree: int | None
    ) -> Iterator[tuple[Target, Drawing]]:
        """Draw each view that can be drawn; the drawing holds until the next."""
        stay = self._adam.prepare(state, {}, None)
        self._drawer.place(state, targets[0].timestep, self._rig.posing, stay, to_step=False)
        for target in targets:
            try:
                drawing = self._drawer.draw(target.camera, degree, target.box)
            except GeometryError:
                return
            except ColourError:
                continue
            yield target, drawing


def pixel_weights(target: Target, drawing: Drawing) -> Float[np.ndarray, "2 h w"]:
    """Give ones, and the reference sensitivity, of what was drawn."""
    left, top, right, bottom = drawing.box
    sensitive = target.sensitivity[top:bottom, left:right] * UNIT
    return np.stack([np.ones_like(sensitive), sensitive])
