"""What an avatar shall be cut down to: how much of it, and what an artist says of its regions."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from types import MappingProxyType
from typing import Literal

import numpy as np
from jaxtyping import Float

from sacha_core.errors import OptionError

__all__ = ["Budget"]


@dataclass(frozen=True)
class Budget:
    """What an avatar shall be cut down to. Regions are given by their labels.

    Args:
        keep: share of the Gaussians that stays, above 0 and at most 1.
        weights: how much more a region is worth than measured; 1 where none is given. A weight of 2 acts as half the modulator: each score
            of the region counts twice, or the region loses half its share.
        shares: least and most that a region has of the Gaussians that stay, each from 0 to 1.
        locks: how many Gaussians a region keeps, neither more nor fewer; None for all that were scored.
        importance: (f,) how many times as much Gaussians on each triangle are worth, from 0; None for once everywhere. It acts as weights
            do, triangle by triangle: where each region loses its own share, the mean over its Gaussians that show decides of that share.
        lowest_modulator: of any region, before weights. The bounds keep a measurement from starving or feeding a region beyond reason; an
            artist's weight is not bounded by them.
        highest_modulator: likewise.
        scope: `weighted` ranks all Gaussians together, by score over the modulator of the region; `regions` takes from each region its
            own share, the common one times the modulator; `all` ranks by score alone, so that modulators count for nothing and weights do.
        power: that bounded modulators are raised to, before weights.
        visible_pixels: blending weight, in pixels a view, up to which a Gaussian counts as hidden: those go first, lowest scores before
            others, wherever they are, and shares of regions are of what remains. Where a file does not say what views showed, those
            of score 0.

    Raises:
        OptionError: a number makes no sense.
    """

    keep: float
    weights: Mapping[int, float] = field(default_factory=lambda: MappingProxyType({}))
    lowest_modulator: float = 0.5
    highest_modulator: float = 2.0
    scope: Literal["weighted", "regions", "all"] = "weighted"
    power: float = 1.0
    visible_pixels: float = 1 / 12
    shares: Mapping[int, tuple[float, float]] = field(default_factory=lambda: MappingProxyType({}))
    locks: Mapping[int, int | None] = field(default_factory=lambda: MappingProxyType({}))
    importance: Float[np.ndarray, " f"] | None = field(default=None, compare=False)

    def __post_init__(self) -> None:
        """Refuse numbers that make no sense."""
        if not 0 < self.keep <= 1:
            raise OptionError(f"keep is {self.keep:g}, expected above 0 and at most 1")
        if not 0 < self.lowest_modulator <= self.highest_modulator < np.inf:
            raise OptionError(
                f"modulators are bounded by {self.lowest_modulator:g} and {self.highest_modulator:g}, expected 0 < lowest <= highest"
            )
        if not 0 <= self.power < np.inf:
            raise OptionError(f"power is {self.power:g}, expected 0 or more")
        for label, weight in self.weights.items():
            if not 0 < weight < np.inf:
                raise OptionError(f"the weight of region {label} is {weight:g}, expected above 0")
        self._require_limits()

    def _require_limits(self) -> None:
        """Refuse shares, locks and importances that make no sense."""
        for label, (lowest, highest) in self.shares.items():
            if not (0 <= lowest <= highest <= 1 and highest > 0):
                raise OptionError(f"region {label} shall have {lowest:g} to {highest:g} of what stays, expected 0 to 1")
        for label, count in self.locks.items():
            if count is not None and count < 0:
                raise OptionError(f"region {label} is locked to {count} Gaussians, expected 0 or more")
        if self.scope == "regions" and (self.shares or self.locks):
            raise OptionError(
                "where each region loses a share of its own, it has no other share or lock; expected another scope"
            )
        if self.importance is not None and not (np.isfinite(self.importance) & (self.importance >= 0)).all():
            raise OptionError("an importance is negative or not finite, expected numbers from 0")
