"""Contexts of levels, compiled: the same integers as the array operations of `contexts` and `harmonic_contexts`.

Source: own.
"""

from __future__ import annotations

from sacha_core.parallel.kernels.kernel import kernel

__all__ = ["classes_of_activity", "classes_of_sizes", "learn_sizes"]


@kernel
def classes_of_sizes(
    known, rows, steps, near, mates, weights, component, floor, offset, per_step, shift, class_of, out
):
    """Class of the estimated size of a component of each Gaussian of a pass, into `out` (p,).

    `near` and `mates` (p, c) are mean sizes around, `known` (n, c) sizes of earlier components; `weights` are of four features, then of
    those. `class_of` lists the class of every estimate, the last that of all beyond.
    """
    n_components, most = near.shape[1], len(class_of) - 1
    for i in range(len(rows)):
        near_all = mates_all = 0
        for c in range(n_components):
            near_all += near[i, c]
            mates_all += mates[i, c]
        total = weights[0] * near[i, component] + weights[1] * near_all
        total += weights[2] * mates[i, component] + weights[3] * mates_all
        row = rows[i]
        for before in range(component):
            total += weights[4 + before] * known[row, before]
        estimate = ((total >> shift) + floor) * per_step // steps[row, component] + offset
        out[i] = class_of[min(estimate, most)]


@kernel
def learn_sizes(known, rows, steps, levels, component, most):
    """Keep the sizes of the levels of a component, in fine units."""
    for i in range(len(rows)):
        row = rows[i]
        known[row, component] = min(abs(levels[i]) * steps[row, component], most)


@kernel
def classes_of_activity(
    sizes, rows, near, trust, mates, mate_trust, weights, floors, scale, glass, shift, class_of, out
):
    """Context of every component of each Gaussian of a pass, into `out` (p, c): from sizes (n, c) around, by trust and weights."""
    n_components, most = sizes.shape[1], len(class_of) - 1
    for i in range(len(rows)):
        row = rows[i]
        for c in range(n_components):
            out[i, c] = 0
        if weights[0]:
            for j in range(near.shape[1]):
                share, other = weights[0] * trust[i, j], near[i, j]
                for c in range(n_components):
                    out[i, c] += sizes[other, c] * share
        if weights[1]:
            for j in range(mates.shape[1]):
                share, other = weights[1] * mate_trust[i, j], mates[i, j]
                for c in range(n_components):
                    out[i, c] += sizes[other, c] * share
        for c in range(n_components):
            estimate = floors[c] + ((out[i, c] // scale[row]) >> shift)
            out[i, c] = class_of[min(estimate, most)] + glass[row]
