"""All that is fitted, in one flat buffer: one kernel then serves every attribute, and one copy moves them all."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from itertools import groupby

import numpy as np
import torch
from jaxtyping import Float, Int
from torch import Tensor

from sacha_core.train.state import ATTRIBUTES, FITTED_MOTION, Arrays

__all__ = ["GROUPS", "NAMES", "Layout"]

GROUPS = {"gaussians": ATTRIBUTES, "motion": FITTED_MOTION}  # each has a step count of its own
NAMES = (*ATTRIBUTES, *FITTED_MOTION)
ALIGNED = 32  # numbers; each array begins at a multiple of so many, 128 bytes, and zeros fill the gaps


@dataclass(frozen=True)
class Layout:
    """Where each array lies in the flat buffer.

    Args:
        shapes: of the arrays, in the order of `NAMES`.
    """

    shapes: tuple[tuple[int, ...], ...]

    @classmethod
    def of(cls, arrays: Mapping[str, np.ndarray]) -> Layout:
        """Give the layout of the arrays of `NAMES`."""
        return cls(tuple(arrays[name].shape for name in NAMES))

    @property
    def bounds(self) -> tuple[int, ...]:
        """Where each array begins, and where the last one ends."""
        bounds = [0]
        for shape in self.shapes:
            bounds.append(bounds[-1] + -(-math.prod(shape) // ALIGNED) * ALIGNED)
        return tuple(bounds)

    @property
    def size(self) -> int:
        """Numbers in the buffer."""
        return self.bounds[-1]

    def views(self, flat: Float[Tensor, " p"]) -> dict[str, Tensor]:
        """Give the arrays that lie in a buffer, by name."""
        return {
            name: flat[start : start + math.prod(shape)].view(shape)
            for name, start, shape in zip(NAMES, self.bounds, self.shapes, strict=False)
        }

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
        lengths = torch.tensor(np.diff(self.bounds), device=device)
        return torch.repeat_interleave(torch.arange(len(NAMES), device=device), lengths).int()

    def runs(self, still: frozenset[str]) -> Iterator[tuple[str, int, int]]:
        """Give the stretches of the buffer without the arrays that stay as they are: group, begin and end of each."""
        bounds = self.bounds
        for group, names in GROUPS.items():
            for moves, stretch in groupby(names, lambda name: name not in still):
                if moves:
                    places = [NAMES.index(name) for name in stretch]
                    yield group, bounds[places[0]], bounds[places[-1] + 1]
