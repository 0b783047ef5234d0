"""How an encoder decides to tell a column of float32: by what is estimated to be shortest.

Source: own.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from jaxtyping import Float, Int

from sacha_core.codec import float_column as rules
from sacha_core.codec.float_column import Column
from sacha_core.codec.float_symbols import Symbols, direct_symbols, residual_symbols
from sacha_core.codec.listed_column import list_symbols, listed_of, place_symbols

__all__ = ["choose_column"]

BITS_PER_CELL = 2.5  # of a frequency table, about
ROUNDS = 3  # of reweighted least squares
FEW_ROWS, FEW_BINS, MANY_BINS = 400, 4, 16
FRACTIONS = 1 / rules.FRACTION


def conditional_bits(symbols: Int[np.ndarray, " n"], contexts: Int[np.ndarray, " n"]) -> float:
    """Estimate the bits of symbols, one table for each context."""
    low = symbols.min(initial=0)
    width = int(symbols.max(initial=0) - low) + 1
    cells = np.bincount(contexts * width + symbols - low)
    totals = np.bincount(contexts)
    cells, totals = cells[cells > 0], totals[totals > 0]
    return float((totals * np.log2(totals)).sum() - (cells * np.log2(cells)).sum() + BITS_PER_CELL * len(cells))


def cost_of(told: Symbols, lead_context: Int[np.ndarray, " n"], next_context: Int[np.ndarray, " n"]) -> float:
    """Estimate the bits of a column."""
    shown = told.has_next
    return (
        conditional_bits(told.lead, lead_context)
        + conditional_bits(told.next[shown], next_context[shown])
        + float(told.lengths.sum())
    )


def common_zeros(x: Float[np.ndarray, " n"]) -> int:
    """Low bits that are 0 in every number, as far as they can be left out."""
    joined = int(np.bitwise_or.reduce(x.view(np.uint32))) | 1 << rules.MAX_ZEROS
    return (joined & -joined).bit_length() - 1


def fitted_coefficients(
    x: Float[np.ndarray, " n"], centre: float, mean: Float[np.ndarray, " n"], off: list[Float[np.ndarray, " n"]]
) -> tuple[int, ...]:
    """Give the coefficients that leave small distances, far ones counting little."""
    table = np.column_stack([mean - centre, *off])
    target = x.astype(np.float64) - centre
    scale = np.abs(table).max(axis=0, initial=0) + 1e-30
    weights = np.ones(len(x))
    found = np.zeros(table.shape[1])
    for _ in range(ROUNDS):
        with np.errstate(over="ignore", invalid="ignore"):
            found = np.linalg.lstsq(table / scale * weights[:, None], target * weights, rcond=None)[0] / scale
            rest = np.abs(target - table @ found)
        weights = 1 / np.sqrt(rest + np.median(rest) + 1e-30)
    whole = np.clip(np.rint(np.nan_to_num(found) * FRACTIONS), -(1 << 15), (1 << 15) - 1).astype(int).tolist()
    return tuple(whole) + (0,) * (rules.REACH + 1 - len(whole))


def as_direct(x: Float[np.ndarray, " n"], column: Column, expected: Float[np.ndarray, " n"]) -> tuple[float, Column]:
    """Estimate the bits of telling a column directly."""
    n_bins = FEW_BINS if len(x) < FEW_ROWS else MANY_BINS
    cuts: tuple[float, ...] = ()
    if any(column.coefficients):
        ordered = np.sort(expected)
        cuts = tuple(ordered[len(ordered) * np.arange(1, n_bins) // n_bins].tolist())
    anchor = int(rules.magnitudes(x).max() >> 23)
    column = replace(column, mode=rules.DIRECT, anchor=anchor, thresholds=cuts)
    told = direct_symbols(x, column)
    bins = column.bins(expected)
    family = np.minimum(np.abs(told.lead), rules.FAMILIES // 2) * 2 + (told.lead < 0)
    return cost_of(told, bins, bins * 16 + family) + 32 * len(cuts), column


def as_residual(
    x: Float[np.ndarray, " n"], column: Column, expected: Float[np.ndarray, " n"], spread: Int[np.ndarray, " n"]
) -> tuple[float, Column]:
    """Estimate the bits of telling a column by distances."""
    told = residual_symbols(x, expected, column)
    anchor = int(np.median(told.lead))
    return cost_of(told, spread, told.lead), replace(column, anchor=anchor)


def choose_column(
    x: Float[np.ndarray, " n"],
    centre: float,
    mean: Float[np.ndarray, " n"],
    earlier: list[Float[np.ndarray, " n"]],
    off: list[Float[np.ndarray, " n"]],
    spread: Int[np.ndarray, " n"],
) -> Column:
    """Give the shortest way that was found to tell a column.

    Args:
        x: its numbers, float32.
        centre: what is expected without neighbours.
        mean: of each number's neighbours.
        earlier: up to three columns before, the nearest first.
        off: how far those are from their neighbours' means.
        spread: class of how far the neighbours are from each other.
    """
    if not len(x) or (x.view(np.uint32) == np.float32(centre).view(np.uint32)).all():
        return Column(rules.CONSTANT, centre)
    plain = Column(rules.RESIDUAL, centre, common_zeros(x))
    beside = replace(plain, coefficients=(int(FRACTIONS), *plain.coefficients[1:]))
    fitted = replace(plain, coefficients=fitted_coefficients(x, centre, mean, off))
    candidates = []
    for column in dict.fromkeys((plain, beside, fitted)):
        expected = column.expected(mean, earlier, off)
        candidates += [as_direct(x, column, expected), as_residual(x, column, expected, spread)]
    if len(earlier) == rules.REACH:
        unit = replace(plain, mode=rules.UNIT)
        candidates.append(as_residual(x, unit, unit.expected(mean, earlier, off), spread))
    listed = listed_of(x)
    if len(listed) * 2 <= len(x):
        column = replace(fitted, mode=rules.LISTED, zeros=0, n_listed=len(listed))
        lead = place_symbols(x, column.expected(mean, earlier, off)).lead
        candidates.append(
            (conditional_bits(lead, spread) + float(list_symbols(listed)[2].sum() + 4 * len(listed)), column)
        )
    return min(candidates, key=lambda candidate: candidate[0])[1]
