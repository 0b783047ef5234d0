"""Frames of a motion from residuals, and residuals from frames: the loops alone, on sequences of plain numbers.

Every function here runs unchanged as plain Python (on lists) and compiled by Numba (on arrays). FORMAT.md, "Motion", is the specification.
Only `choose_group`, which no decoder needs, knows floating-point numbers.

Rows of `tables` (p integers each), one after another: base, damping, pull, class of the size, class of the size in a first frame, and
the first partner of each parameter; then the end of the last partner.

Source: own.
"""

from __future__ import annotations

from sacha_core.codec.kernels.residuals import CLASSES, take_residual

FINE = 16  # a residual of 1 stands for so many units
LIMIT = 1 << 34  # no value of an encoder is beyond, in units
LARGEST_COUNTED = 1 << 14  # residuals beyond count as this much
COUNT = 64  # what a residual of 1 counts
BASE, DAMPING, PULL, SIZE, FIRST_SIZE, PARTNERS = range(6)


def usual_size(kind):
    """Expected magnitude that a class stands for, in 64ths: the root of 3/2 * 2^kind, rounded down."""
    square = (3 << kind) >> 1
    root = 0
    bit = 1 << 20
    while bit > 0:
        if (root + bit) * (root + bit) <= square:
            root += bit
        bit >>= 1
    return root


def class_of(size):
    """Class of an expected magnitude in 64ths: half octaves, rounded down."""
    square = size * size
    kind = 0
    while (square >> (kind + 1)) > 0:
        kind += 1
    return min(kind, CLASSES - 1)


def forecast(j, frame, p, tables, last, before):
    """Expect a parameter from the two frames before: damped, and pulled towards its base."""
    base = tables[j]
    if frame == 0:
        return base
    return last[j] + (
        ((last[j] - before[j]) * tables[DAMPING * p + j] + (base - last[j]) * tables[PULL * p + j] + 8) >> 4
    )


def from_partners(j, p, tables, sources, weights, innovations):
    """What the innovations of earlier parameters of the same frame say about that of this one."""
    total = 32
    for k in range(tables[PARTNERS * p + j], tables[PARTNERS * p + j + 1]):
        total += weights[k] * innovations[sources[k]]
    return total >> 6


def class_in_frame(j, frame, p, tables, usual, recent):
    """Class of the residual's expected size."""
    if frame == 0:
        return tables[FIRST_SIZE * p + j]
    return class_of((usual[j] + recent[j] + 1) >> 1)


def begin(p, tables, usual, recent):
    """Set what is expected of every parameter before the first frame."""
    for j in range(p):
        usual[j] = usual_size(tables[SIZE * p + j])
        recent[j] = usual[j]


def end_parameter(j, frame, value, residual, last, before, recent):
    """Remember a parameter's value and how large its residual was."""
    before[j] = value if frame == 0 else last[j]
    last[j] = value
    if frame > 0:
        recent[j] = (recent[j] + min(abs(residual), LARGEST_COUNTED) * COUNT + 1) >> 1


def decode_group(registers, data, models, values, p, tables, sources, weights, state):
    """Read the frames of a group into `values`; give the number of the frame where they leave what an encoder writes, or -1.

    `state`: five rows of p integers.
    """
    last, before, usual, recent, innovations = state
    begin(p, tables, usual, recent)
    for frame in range(len(values) // max(p, 1)):
        for j in range(p):
            expected = forecast(j, frame, p, tables, last, before)
            told = from_partners(j, p, tables, sources, weights, innovations)
            kind = class_in_frame(j, frame, p, tables, usual, recent)
            residual = take_residual(registers, data, models, kind)
            innovations[j] = told + residual * FINE
            value = expected + innovations[j]
            if abs(value) > LIMIT:
                return frame
            values[frame * p + j] = value
            end_parameter(j, frame, value, residual, last, before, recent)
    return -1


def choose_group(targets, residuals, kinds, values, p, tables, sources, weights, state, errors, mates, dead_zone):
    """Choose the residuals of a group, each for the vertices' sake: what parameters before it in the frame are off is made up for.

    Args (flat sequences): targets, residuals, kinds, values: frames of p; errors: p numbers of room; mates: starts of each parameter's
    mates (p + 1), which, and how much their errors count for it; dead_zone: by class, how much nearer than a half to the next magnitude
    a number must be to round up to it; then the same for magnitude 1.
    """
    last, before, usual, recent, innovations = state
    starts, others, couplings = mates
    begin(p, tables, usual, recent)
    for frame in range(len(targets) // max(p, 1)):
        for j in range(p):
            at = frame * p + j
            expected = forecast(j, frame, p, tables, last, before)
            told = from_partners(j, p, tables, sources, weights, innovations)
            kind = class_in_frame(j, frame, p, tables, usual, recent)
            wanted = targets[at] - expected - told
            for k in range(starts[j], starts[j + 1]):
                wanted -= couplings[k] * errors[others[k]]
            wanted /= FINE
            residual = int(abs(wanted) + 0.5 - dead_zone[kind])
            if residual == 1 and abs(wanted) + 0.5 - dead_zone[CLASSES + kind] < 1:
                residual = 0
            if wanted < 0:
                residual = -residual
            innovations[j] = told + residual * FINE
            value = expected + innovations[j]
            errors[j] = value - targets[at]
            residuals[at] = residual
            kinds[at] = kind
            values[at] = value
            end_parameter(j, frame, value, residual, last, before, recent)
