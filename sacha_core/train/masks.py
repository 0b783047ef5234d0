"""Masks that a run learns: which Gaussians the pictures can do without, as Compact-3DGS asks."""

from __future__ import annotations

import numpy as np
from jaxtyping import Bool, Float

from sacha_core.avatar.binding import sigmoid
from sacha_core.density.events import MaskPruning
from sacha_core.train.regions import Regions
from sacha_core.train.state import MASK_LOGIT, Arrays, TrainState, rearrange

__all__ = ["alive", "mask_gradient", "mask_penalty", "prune_masked"]

LOWEST = 0.01  # a mask at or below which hides its Gaussian


def alive(mask_logit: Float[np.ndarray, " n"]) -> Bool[np.ndarray, " n"]:
    """Tell which Gaussians their masks let be drawn."""
    drawn: np.ndarray = sigmoid(mask_logit) > LOWEST
    return drawn


def mask_penalty(mask_logit: Float[np.ndarray, " n"], weight: float) -> float:
    """Give the loss that draws masks towards 0: their mean, weighted."""
    return weight * float(np.mean(sigmoid(mask_logit.astype(np.float64)))) if len(mask_logit) else 0.0


def mask_gradient(
    mask_logit: Float[np.ndarray, " n"], opacities: Float[np.ndarray, " n"], slopes: Arrays, weight: float
) -> Float[np.ndarray, " n"]:
    r"""Give the gradient of the loss by the mask's logit l, with m = sigmoid(l).

    A Gaussian is drawn with opacity M o and scale M s, where M is 1 for m above the limit and else 0; on the way back M counts as m (a
    straight-through estimate). By the chain rule, with x the drawn opacity and y the drawn scales,

        dL/dm = dL/dx o + sum_k dL/dy_k s_k.

    Where M is 1, x = o and y = s, so the first term is dL/do o and the second sum_k dL/dlog s_k: both are at hand. With o = sigmoid(u),
    dL/du = dL/do o (1 - o), hence dL/do o = dL/du / (1 - o); a Gaussian whose opacity is 1 to the last digit has no slope to speak of.
    Where M is 0 nothing is drawn, and both terms are 0. Then dL/dl = dL/dm m (1 - m), and the penalty adds weight m (1 - m) / n.

    Args:
        mask_logit: (n,) l.
        opacities: (n,) M o, as drawn.
        slopes: of `opacity_logit` (n,) and `log_scale` (n, 3), with those of the penalty on scales, which are the drawn ones.
        weight: of the penalty, the mean of m.

    Source: Lee et al., Compact 3D Gaussian Representation, 2024, section 3.1.
    """
    mask = sigmoid(mask_logit)
    rest = 1 - opacities
    by_opacity = np.divide(slopes["opacity_logit"], rest, out=np.zeros_like(rest), where=rest > 0)
    by_mask = by_opacity + slopes["log_scale"].sum(axis=1) + np.float32(weight / max(len(mask), 1))
    gradient: np.ndarray = by_mask * (mask * (1 - mask))
    return gradient


def prune_masked(state: TrainState, regions: Regions) -> MaskPruning:
    """Remove the Gaussians that their masks hide.

    Args:
        state: changed.
        regions: of the head.
    """
    before, of = regions.counts(state.binding), regions.of(state.binding)
    keep = alive(state.values[MASK_LOGIT])
    removed = np.bincount(of[~keep], minlength=regions.n_regions)
    rearrange(state, np.flatnonzero(keep))
    return MaskPruning(state.iteration, before, tuple(removed.tolist()), regions.counts(state.binding))
