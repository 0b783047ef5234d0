r"""How an encoder fits the weights of the contexts to levels that it has already chosen.

The weights minimise $\sum \ln E + a / E$, the negative log-likelihood of sizes a under Laplace distributions of mean size E, by
multiplicative updates, which never increase it and keep the weights from falling below 0.

Source: Fevotte, Bertin and Durrieu, 2009, of whose Itakura-Saito factorisation this is one factor; otherwise own.
"""

from __future__ import annotations

import numpy as np
from jaxtyping import Float, Int

from sacha_core.codec.contexts import (
    FEATURES,
    GROUPS,
    MAX_WEIGHT,
    PER_STEP,
    WEIGHT_BITS,
    ContextPlan,
    Sizes,
)
from sacha_core.codec.order import KINDS, MATES, Layout
from sacha_core.codec.steps import MAX_EXPONENT, PER_OCTAVE

__all__ = ["fit_plan"]

N_ITERATIONS = 60
MOST_ROWS = 6000  # of a group and component: more do not change what is found
SMALLEST = 1e-4  # steps; keeps estimates from becoming 0


def fit_plan(layout: Layout, levels: Int[np.ndarray, "n c"], steps: Int[np.ndarray, "n c"]) -> ContextPlan:
    """Fit the contexts of levels.

    Args:
        layout: where the Gaussians lie.
        levels: as they are, or nearly, to be coded.
        steps: their quantiser steps.
    """
    n_components = levels.shape[1]
    width = FEATURES + n_components - 1
    weights = np.zeros((n_components, GROUPS, width), np.int64)
    floors = np.zeros((n_components, GROUPS), np.int64)
    offsets = np.zeros((n_components, KINDS), np.int64)
    for (group, component), (features, kinds, rows) in gather(layout, levels, steps).items():
        step = steps[rows, component].astype(np.float64)
        known = features / step[:, None] / (1 << WEIGHT_BITS)
        kind_columns = (kinds[:, None] == np.arange(KINDS)) / PER_STEP
        design = np.concatenate([known, (1 / step)[:, None], kind_columns], axis=1)
        found = descend(design, np.abs(levels[rows, component]).astype(np.float64))
        n_known = known.shape[1]
        weights[component, group, :n_known] = np.clip(np.rint(found[:n_known]), 0, MAX_WEIGHT)
        exponent = np.rint(PER_OCTAVE * np.log2(max(found[n_known], 1.0)))
        floors[component, group] = min(int(exponent), MAX_EXPONENT)
        present = np.unique(kinds)
        offsets[component, present] = np.clip(np.rint(found[n_known + 1 :][present]), 0, MAX_WEIGHT)
    return ContextPlan(weights, floors, offsets)


Gathered = dict[tuple[int, int], tuple[Float[np.ndarray, "m w"], Int[np.ndarray, " m"], Int[np.ndarray, " m"]]]


def gather(layout: Layout, levels: Int[np.ndarray, "n c"], steps: Int[np.ndarray, "n c"]) -> Gathered:
    """Collect, for each group and component, features, kinds of pass and rows of an even choice of Gaussians."""
    sizes = Sizes(steps)
    parts: dict[tuple[int, int], list[tuple[np.ndarray, np.ndarray, np.ndarray]]] = {}
    stride = max(1, len(levels) // MOST_ROWS)
    for step in layout.passes:
        sizes.enter(step)
        taken = slice(None, None, stride if len(step.rows) > stride else 1)
        for component in range(levels.shape[1]):
            features = np.stack(sizes.features(component), axis=1)[taken].astype(np.float64)
            rows = step.rows[taken]
            key = (int(step.kind == MATES), component)
            parts.setdefault(key, []).append((features, np.full(len(rows), step.kind), rows))
            sizes.learn(component, levels[step.rows, component])
    return {key: tuple(np.concatenate(columns) for columns in zip(*found, strict=True)) for key, found in parts.items()}  # type: ignore[misc]


def descend(design: Float[np.ndarray, "m w"], sizes: Float[np.ndarray, " m"]) -> Float[np.ndarray, " w"]:
    """Give the weights, 0 or more, that make `sizes` likeliest."""
    used = design.any(axis=0)
    columns = design[:, used]
    share = sizes.mean() / max(columns.shape[1], 1) if len(sizes) else 0.0
    found = share / np.maximum(columns.mean(axis=0), 1e-12)
    for _ in range(N_ITERATIONS):
        inverse = 1 / (columns @ found + SMALLEST)
        found *= np.sqrt(columns.T @ (sizes * inverse * inverse) / np.maximum(columns.T @ inverse, 1e-30))
    weights = np.zeros(design.shape[1])
    weights[used] = found
    return weights
