"""All that is fitted, in one flat buffer: one kernel then serves every attribute, and one copy moves them all."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from functools import cached_property
from itertools import groupby

import numpy as np
import torch
from jaxtyping import Float, Int
from torch import Tensor

from sacha_core.train.state import ATTRIBUTES, FITTED_MOTION, Arrays

__all__ = ["GROUPS", "NAMES", "Layout"]

GROUPS = {"gaussians": ATTRIBUTES, "motion": FITTED_MOTION}  # each has a step count of its own
NAMES = (*ATTRIBUTES, *FITTED_MOTION)
ALIGNED = 32  # numbers; each block begins at a multiple of so many, 128 bytes, and zeros fill the gaps


@dataclass(frozen=True)
class Layout:
    """Where each array lies: a block for each attribute, and last a table with a row of all motion parameters for each timestep.

    Args:
        attributes: shape of each attribute, in the order of `ATTRIBUTES`.
        timesteps: rows of the table.
        widths: columns of each motion parameter, in the order of `FITTED_MOTION`.
    """

    attributes: tuple[tuple[int, ...], ...]
    timesteps: int
    widths: tuple[int, ...]

    @classmethod
    def of(cls, arrays: Mapping[str, np.ndarray]) -> Layout:
        """Give the layout of the arrays of `NAMES`."""
        motion = [arrays[name].shape for name in FITTED_MOTION]
        return cls(tuple(arrays[name].shape for name in ATTRIBUTES), motion[0][0], tuple(width for _, width in motion))

    @cached_property
    def bounds(self) -> tuple[int, ...]:
        """Where each block begins, and where the last one ends."""
        bounds = [0]
        for shape in (*self.attributes, (self.timesteps, sum(self.widths))):
            bounds.append(bounds[-1] + -(-math.prod(shape) // ALIGNED) * ALIGNED)
        return tuple(bounds)

    @property
    def n_gaussians(self) -> int:
        """Number of Gaussians."""
        return self.attributes[0][0]

    @property
    def size(self) -> int:
        """Numbers in the buffer."""
        return self.bounds[-1]

    def table(self, flat: Float[Tensor, " p"]) -> Float[Tensor, "t w"]:
        """Give the motion parameters that lie in a buffer, side by side."""
        start, width = self.bounds[len(ATTRIBUTES)], sum(self.widths)
        return flat[start : start + self.timesteps * width].view(self.timesteps, width)

    def views(self, flat: Float[Tensor, " p"]) -> dict[str, Tensor]:
        """Give the arrays that lie in a buffer, by name."""
        blocks = zip(ATTRIBUTES, self.bounds, self.attributes, strict=False)
        views = {name: flat[start : start + math.prod(shape)].view(shape) for name, start, shape in blocks}
        columns = self.table(flat).split_with_sizes(self.widths, 1)
        return views | dict(zip(FITTED_MOTION, columns, strict=True))

    def pack(self, arrays: Mapping[str, np.ndarray]) -> Float[np.ndarray, " p"]:
        """Give a buffer that holds copies of the arrays."""
        flat = np.zeros(self.size, np.float32)
        for name, view in self.views(torch.from_numpy(flat)).items():
            view.numpy()[...] = arrays[name]
        return flat

    def unpack(self, flat: Float[np.ndarray, " p"], arrays: Arrays) -> None:
        """Copy what lies in a buffer to the arrays."""
        for name, view in self.views(torch.from_numpy(flat)).items():
            arrays[name][...] = view.numpy()

    def owner(self, device: torch.device) -> Int[Tensor, " p"]:
        """Give for each number the place of its array in `NAMES`."""
        owner = torch.zeros(self.size, dtype=torch.int32, device=device)
        for place, view in enumerate(self.views(owner).values()):
            view.fill_(place)
        return owner

    def runs(self, moving: frozenset[str]) -> Iterator[tuple[int, int]]:
        """Give the stretches of the buffer, begin and end, that some attributes and the table, where `motion` is among them, fill."""
        blocks = groupby(enumerate((*ATTRIBUTES, "motion")), lambda block: block[1] in moving)
        for moves, stretch in blocks:
            places = [place for place, _ in stretch]
            if moves:
                yield self.bounds[places[0]], self.bounds[places[-1] + 1]
