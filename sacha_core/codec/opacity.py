r"""Section `Opacity`: uniform steps in $\theta = \arcsin\sqrt{\alpha}$, in which an error shows equally at every opacity.

Gaussians of a triangle are sorted by falling opacity, so that a mate can be coded as how far it falls below the one before.

Source: own.
"""

from __future__ import annotations

import struct
from dataclasses import dataclass
from decimal import Decimal, localcontext
from functools import cache

import numpy as np
from jaxtyping import Float, Int

from sacha_core.codec.order import KINDS, MATES, Layout, Pass, weighted_mean
from sacha_core.codec.predicted import decode_predicted, encode_predicted
from sacha_core.codec.reading import ByteReader
from sacha_core.codec.steps import MAX_EXPONENT, STEPS
from sacha_core.codec.symbols import SymbolReader, SymbolWriter

__all__ = ["MAX_STEPS", "OpacityTable", "decode_opacity", "encode_opacity", "opacity_index", "opacity_table"]

MAX_STEPS = 1024
FALLS, MIXED = 0, 1
SPACINGS = 4
OCTAVES = np.array([2, 4, 8], np.int64)
CLASSES = 16  # contexts by the opacity that a Gaussian is predicted from
MAX_TRANSPARENCY = 24
DIGITS = 40
PI = Decimal("3.14159265358979323846264338327950288419716939937510582097494")


@dataclass(frozen=True)
class OpacityTable:
    """What an index stands for, at each of u + 1 indices.

    Args:
        logit: (u + 1,) float32.
        transparency: (u + 1,) half octaves of 1 / opacity, rounded, at most 24.
    """

    logit: Float[np.ndarray, " u"]
    transparency: Int[np.ndarray, " u"]


def sine(angle: Decimal) -> Decimal:
    """Sine by its series, to the precision of the decimal context."""
    term = total = angle
    k = 1
    while abs(term) > Decimal(10) ** -DIGITS:
        term *= -angle * angle / ((k + 1) * (k + 2))
        total += term
        k += 2
    return total


@cache
def opacity_table(n_steps: int) -> OpacityTable:
    """Give the table of `n_steps` steps from transparent to opaque.

    Decimal arithmetic, which is the same everywhere; the two ends stand a quarter of a step inside, since their logits are infinite.
    In the middle the logit is 0, which a series only comes close to.
    """
    logits, classes = [], []
    with localcontext() as context:
        context.prec = DIGITS
        for index in range(n_steps + 1):
            inside = min(max(Decimal(index), Decimal("0.25")), n_steps - Decimal("0.25"))
            angle = PI / 2 * inside / n_steps
            alpha, rest = sine(angle) ** 2, sine(PI / 2 - angle) ** 2
            logits.append(0.0 if 2 * index == n_steps else float((alpha / rest).ln()))
            classes.append(min(int((-2 * alpha.ln() / Decimal(2).ln()).to_integral_value()), MAX_TRANSPARENCY))
    return OpacityTable(np.array(logits, np.float32), np.array(classes, np.int64))


def opacity_index(logit: Float[np.ndarray, " n"], n_steps: int) -> Int[np.ndarray, " n"]:
    """Give the nearest index of each opacity."""
    half = np.clip(logit.astype(np.float64) / 2, -100, 100)
    return np.rint(np.arctan(np.exp(half)) * (2 / np.pi) * n_steps).astype(np.int64)  # tan(theta)^2 = a / (1 - a)


def expected_first(step: Pass, index: Int[np.ndarray, " n"], start: int) -> Int[np.ndarray, " p"]:
    """Opacity index that a first Gaussian is predicted to have."""
    return np.where(step.trust.any(axis=1), weighted_mean(index, step.near, step.trust), start)


def spacing_of(hidden: Int[np.ndarray, " n"], weight: int, n_steps: int) -> Int[np.ndarray, " n"]:
    """How many indices one level of each Gaussian spans: more for what is hidden."""
    return np.asarray(np.minimum(STEPS[np.minimum(hidden * weight, MAX_EXPONENT)], n_steps))


def contexts_of(
    step: Pass, expected: Int[np.ndarray, " p"], spacing: Int[np.ndarray, " p"], n_steps: int
) -> Int[np.ndarray, " p"]:
    """Context of each Gaussian: kind of pass, the opacity that it is predicted from, octave of its spacing."""
    octave = np.minimum(np.searchsorted(OCTAVES, spacing, side="right"), SPACINGS - 1)
    nearby = np.clip(expected * CLASSES // n_steps, 0, CLASSES - 1)
    return np.asarray((step.kind * SPACINGS + octave) * CLASSES + nearby)


def known_mate(step: Pass, index: Int[np.ndarray, " n"]) -> Int[np.ndarray, " p"]:
    """Opacity index of the last mate known before the pass."""
    return np.asarray(index[step.mates[:, 0]])


def run_starts(step: Pass) -> Int[np.ndarray, " p"]:
    """For each Gaussian of a pass of mates, where in the pass its triangle begins."""
    new = np.diff(step.slot, prepend=-1) > 0
    return np.maximum.accumulate(np.where(new, np.arange(len(new)), 0))


def encode_opacity(
    layout: Layout, index: Int[np.ndarray, " n"], n_steps: int, hidden: Int[np.ndarray, " n"], hidden_weight: int = 0
) -> tuple[bytes, Int[np.ndarray, " n"]]:
    """Code opacity indices, which may fall inside each triangle; give the section and the indices as decoded.

    As falls, or as any other attribute: whichever is shorter.
    """
    head = struct.pack("<HB", n_steps, hidden_weight)
    spacing = spacing_of(hidden, hidden_weight, n_steps)
    falls, decoded = encode_falls(layout, index, n_steps, spacing)
    mixed, values = encode_predicted(layout, index[:, None], spacing[:, None])
    if len(mixed) < len(falls):
        return head + bytes([MIXED]) + mixed, np.clip(values[:, 0], 0, n_steps)
    return head + bytes([FALLS]) + falls, decoded


def encode_falls(
    layout: Layout, index: Int[np.ndarray, " n"], n_steps: int, spacing: Int[np.ndarray, " n"]
) -> tuple[bytes, Int[np.ndarray, " n"]]:
    """Code opacity indices by how far they fall inside each triangle."""
    start = int(np.median(index[layout.firsts])) if len(index) else 0
    writer = SymbolWriter(KINDS * SPACINGS * CLASSES)
    decoded = np.zeros_like(index)
    for step in layout.passes:
        expected = known_mate(step, decoded) if step.kind == MATES else expected_first(step, decoded, start)
        levels = np.zeros(len(step.rows), np.int64)
        lowest = step.rank.min()
        for rank in range(lowest, step.rank.max() + 1):
            mine = step.rank == rank
            rows = step.rows[mine]
            before = expected[mine] if rank == lowest else decoded[rows - 1]
            levels[mine] = nearest_level(index[rows] - before, before, spacing[rows], n_steps)
            decoded[rows] = before + levels[mine] * spacing[rows]
        falls = -levels if step.kind == MATES else levels
        writer.write(falls, contexts_of(step, expected, spacing[step.rows], n_steps))
    return struct.pack("<H", start) + writer.finish(), decoded


def nearest_level(
    away: Int[np.ndarray, " p"], before: Int[np.ndarray, " p"], spacing: Int[np.ndarray, " p"], n_steps: int
) -> Int[np.ndarray, " p"]:
    """Give the nearest level that stays inside the table."""
    level = np.rint(away / spacing).astype(np.int64)
    return np.asarray(np.clip(level, -(before // spacing), (n_steps - before) // spacing))


def decode_opacity(
    reader: ByteReader, layout: Layout, hidden: Int[np.ndarray, " n"]
) -> tuple[Int[np.ndarray, " n"], OpacityTable]:
    """Read opacity indices and the table that they point into.

    Raises:
        FormatError: an index lies outside the table.
    """
    n_steps, hidden_weight, kind = reader.unpack("HBB")
    if not 1 <= n_steps <= MAX_STEPS:
        raise reader.error(f"{n_steps} opacity steps, expected 1 to {MAX_STEPS}")
    if kind not in (FALLS, MIXED):
        raise reader.error(f"opacities of kind {kind}, expected {FALLS} (falls) or {MIXED} (mixture)")
    spacing = spacing_of(hidden, hidden_weight, n_steps)
    if kind == MIXED:
        index = np.clip(decode_predicted(reader, layout, spacing[:, None], 1)[:, 0], 0, n_steps)
    else:
        index = decode_falls(reader, layout, n_steps, spacing)
    return index, opacity_table(n_steps)


def decode_falls(
    reader: ByteReader, layout: Layout, n_steps: int, spacing: Int[np.ndarray, " n"]
) -> Int[np.ndarray, " n"]:
    """Read what `encode_falls` wrote."""
    (start,) = reader.unpack("H")
    if start > n_steps:
        raise reader.error(f"opacity starts from {start} of {n_steps} steps")
    index = np.zeros(len(layout.slots), np.int64)
    symbols = SymbolReader(reader, KINDS * SPACINGS * CLASSES)
    for step in layout.passes:
        wide = spacing[step.rows]
        if step.kind == MATES:
            known = known_mate(step, index)
            fall = np.cumsum(symbols.read(contexts_of(step, known, wide, n_steps)) * wide)
            begin = run_starts(step)
            index[step.rows] = known - (fall - np.where(begin > 0, fall[begin - 1], 0))
        else:
            expected = expected_first(step, index, start)
            index[step.rows] = expected + symbols.read(contexts_of(step, expected, wide, n_steps)) * wide
        if index[step.rows].min() < 0 or index[step.rows].max() > n_steps:
            raise reader.error(f"an opacity index outside 0 to {n_steps}")
    symbols.check_end()
    return index
