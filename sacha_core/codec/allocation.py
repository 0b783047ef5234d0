r"""Where bits go: how coarse each Gaussian, from what its numbers were measured to be worth.

An error uniform in a step s costs $c s^2 / 12$ where c is what the number is worth. A file of a given quality is smallest where an octave
of any step costs the same. What opacity, size and shape do not tell of c is mostly how much of a Gaussian others cover, which all its
numbers share. So classes an octave apart even out what Gaussians cost, a few to either side of what the rules give: beyond, errors are
too large for their worth to hold.

Source: own; reverse water-filling (Cover and Thomas, Elements of Information Theory, 10.3).
"""

from __future__ import annotations

import numpy as np
from jaxtyping import Float, Int

__all__ = ["FINER", "N_CLASSES", "hidden_classes"]

FINER, N_CLASSES = 2, 4  # octaves of steps finer than by the rules in class 0, then one coarser with each class
LEAST = 1e-30


def hidden_classes(cost: Float[np.ndarray, " n"]) -> Int[np.ndarray, " n"]:
    """Choose classes so that Gaussians cost alike, with as many octaves finer as coarser in the mean.

    Args:
        cost: of an error of a step by the rules, over the numbers of each Gaussian.
    """
    octaves = -np.log2(np.maximum(cost, LEAST)) / 2

    def classes(middle: float) -> Int[np.ndarray, " n"]:
        return np.asarray(np.clip(np.rint(octaves - middle + FINER), 0, N_CLASSES - 1).astype(np.int64))

    low, high = float(octaves.min()) - N_CLASSES, float(octaves.max()) + N_CLASSES
    for _ in range(40):
        middle = (low + high) / 2
        low, high = (middle, high) if classes(middle).mean() > FINER else (low, middle)
    return classes(high)
