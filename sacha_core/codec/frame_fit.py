"""Fits how the parameters of a motion's frames are expected: one model for all groups, as small as it pays.

Only the encoder needs this.

Source: own; partners by forward selection until another one costs more bits than it saves.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from jaxtyping import Bool, Float, Int

from sacha_core.codec.frame_coder import Chosen, Mates
from sacha_core.codec.frame_model import LARGEST_WEIGHT, LIVE_BASE, MAX_PARTNERS, PARAMETERS, FrameModel, steps_of
from sacha_core.codec.kernels.frames import COUNT, FINE, LIMIT
from sacha_core.codec.kernels.residuals import CLASSES

__all__ = ["adopted", "first_model", "mates_of", "refit", "rescaled"]

NOTHING = 1e-6  # of the largest displacement
FIRST_DAMPING, FIRST_SIZE, FIRST_RISE = 4, 14, 4  # before anything is known
FITTED = ("damping", "pull", "size")
NOTICED = 0.1  # cosine of two displacements from which on one makes up for the other
DAMPINGS, PULLS = np.meshgrid(np.arange(-10, 17), np.arange(-1, 9), indexing="ij")
PARTNER_BITS = 13.0
SIXTEENTH, SIXTY_FOURTH = 1 / 16, 1 / 64


def first_model(
    values: Float[np.ndarray, "t p"],
    kinds: Int[np.ndarray, " p"],
    reach: Float[np.ndarray, " p"],
    fixed_steps: Float[np.ndarray, " p"],
    unit: float,
    *,
    live: bool = False,
) -> FrameModel:
    """Give a model before anything was chosen.

    Args:
        values: parameters of frames.
        kinds: of each parameter.
        reach: how far vertices go for a unit of each parameter; steps are `unit` over it.
        fixed_steps: for parameters that move nothing.
        unit: step of a parameter of reach 1.
        live: whether frames other than these are to come, in which any parameter that moves vertices may change.
    """
    still = reach <= NOTHING * reach.max(initial=0)
    ideal = -4 * np.log2(np.where(still, unit / fixed_steps, np.where(still, 1, reach)))
    exponents = near_the_last(ideal)
    levels = levels_of(values, steps_of(unit, exponents))
    alive = ~still & (live | (levels != middle(levels)).any(axis=0))
    q, nothing = int(alive.sum()), np.zeros(0, np.int64)
    return FrameModel(
        kinds=kinds,
        alive=alive,
        unit=unit,
        exponents=exponents,
        base=base_of(levels, alive),
        damping=np.full(q, FIRST_DAMPING),
        pull=np.zeros(q, np.int64),
        size=np.full(q, FIRST_SIZE),
        rise=np.full(len(PARAMETERS), FIRST_RISE),
        partners=np.zeros(q + 1, np.int64),
        sources=nothing,
        weights=nothing,
    )


def near_the_last(ideal: Float[np.ndarray, " p"]) -> Int[np.ndarray, " p"]:
    """Round exponents, each to the one before where that is not off by more than a quarter of an octave."""
    exponents = np.zeros(len(ideal), np.int64)
    last = 0
    for j, one in enumerate(ideal):
        last = exponents[j] = last if abs(one - last) <= 1 else round(float(one))
    return exponents


def levels_of(values: Float[np.ndarray, "t p"], steps: Float[np.ndarray, " p"]) -> Float[np.ndarray, "t p"]:
    """Give the nearest multiple of its step to each value.

    Raises:
        OverflowError: a value is beyond 2**30 steps.
    """
    levels = np.rint(values.astype(np.float64) / steps)
    if np.abs(levels).max(initial=0) > LIMIT // FINE:
        raise OverflowError(f"{np.abs(values).max()} is more than 2**30 steps")
    return np.asarray(levels)


def middle(levels: Float[np.ndarray, "t p"]) -> Float[np.ndarray, " p"]:
    """Give the middle level of each parameter, 0 where there is no frame."""
    return np.floor(np.median(levels, axis=0)) if len(levels) else np.zeros(levels.shape[1])


def base_of(levels: Float[np.ndarray, "t p"], alive: Bool[np.ndarray, " p"]) -> Int[np.ndarray, " p"]:
    """Give what first frames are expected to be, in units: roughly for parameters that move, exactly for the others."""
    exact = middle(levels).astype(np.int64)
    rough = np.clip(np.rint(exact / LIVE_BASE).astype(np.int64) * LIVE_BASE, -LIMIT // FINE, LIMIT // FINE)
    return np.asarray(np.where(alive, rough, exact) * FINE)


def rescaled(model: FrameModel, values: Float[np.ndarray, "t p"], unit: float) -> FrameModel:
    """Give a model with other steps, and the bases that these parameters have by them; what moved goes on moving.

    Raises:
        OverflowError: a value is beyond 2**30 steps.
    """
    levels = levels_of(values, steps_of(unit, model.exponents))
    return replace(model, unit=unit, base=base_of(levels, model.alive))


def adopted(fresh: FrameModel, model: FrameModel) -> FrameModel:
    """Give `fresh` what `model` knows of the parameters that move in both; partners only where they are the same."""
    if np.array_equal(fresh.alive, model.alive):
        same = {name: getattr(model, name) for name in (*FITTED, "partners", "sources", "weights")}
        return replace(fresh, rise=model.rise, **same)
    known = {}
    for name in FITTED:
        whole = np.zeros(len(fresh.alive), np.int64)
        whole[fresh.alive] = getattr(fresh, name)
        whole[model.alive] = getattr(model, name)
        known[name] = whole[fresh.alive]
    return replace(fresh, rise=model.rise, **known)


def mates_of(model: FrameModel, products: Float[np.ndarray, "p p"]) -> Mates:
    """Give whose errors each parameter makes up for: earlier ones that move the same vertices likewise."""
    steps = model.steps[model.alive]
    weighted = products[np.ix_(model.alive, model.alive)] * np.outer(steps, steps)
    size = np.sqrt(np.maximum(np.diag(weighted), 1e-300))
    noticed = np.tril(np.abs(weighted) > NOTICED * np.outer(size, size), -1)
    rows, others = np.nonzero(noticed)
    starts = np.concatenate([[0], np.cumsum(noticed.sum(axis=1))]).astype(np.int64)
    return Mates(starts, others, weighted[rows, others] / size[rows] ** 2)


def refit(
    model: FrameModel, targets: Float[np.ndarray, "t q"], chosen: Chosen, group_frames: int, *, live: bool = False
) -> FrameModel:
    """Give the model that would have served best for what was chosen.

    Args:
        model: with which it was chosen.
        targets: parameters that move, in units, of all groups.
        chosen: likewise.
        group_frames: frames in every group but the last.
        live: whether frames other than these are to come.
    """
    t = len(targets)
    inner = np.flatnonzero(np.arange(t) % group_frames)
    if not len(inner):
        return model
    base, last = model.base[model.alive], chosen.units[inner - 1]
    before = np.where((inner % group_frames > 1)[:, None], chosen.units[np.maximum(inner - 2, 0)], last)
    change, back, wanted = last - before, base - last, targets[inner] - last
    damping, pull = fit_coefficients(change, back, wanted)
    told = last + ((change * damping + back * pull + 8) >> 4)
    partners, sources, weights = fit_partners(chosen.units[inner] - told, targets[inner] - told)
    usual = np.abs(chosen.residuals[inner]).mean(axis=0)
    size = class_of_mean(np.maximum(usual, 1 / 8 if live else 0))
    kinds, rise = model.kinds[model.alive], np.zeros_like(model.rise)
    first = np.abs(chosen.residuals[::group_frames]).mean(axis=0)
    for kind in range(len(rise)):
        octaves = 2 * np.log2((first + 0.2) / (usual + 0.2))[kinds == kind]
        rise[kind] = np.rint(octaves.mean()) if len(octaves) else 0
    return replace(
        model, damping=damping, pull=pull, size=size, rise=rise, partners=partners, sources=sources, weights=weights
    )


def class_of_mean(magnitude: Float[np.ndarray, " q"]) -> Int[np.ndarray, " q"]:
    """Give the class that a mean magnitude falls into."""
    octaves = 2 * np.log2(np.maximum(magnitude * 0.95 + 0.02, 1 / COUNT) * COUNT)
    return np.asarray(np.clip(np.floor(octaves).astype(np.int64), 0, CLASSES - 1))


def bits_for(mean_square: Float[np.ndarray, "..."], n: int) -> Float[np.ndarray, "..."]:
    """Estimate the bits of n residuals of a mean square, in units."""
    return np.asarray(n / 2 * np.log2(1 + 12 / FINE**2 * np.maximum(mean_square, 0)))


def bits_of(integers: Int[np.ndarray, "..."]) -> Float[np.ndarray, "..."]:
    """Estimate the bits of an adaptive integer."""
    magnitude = np.abs(integers)
    return np.where(magnitude == 0, 1.0, 3 + 2 * np.log2(np.maximum(magnitude, 1)))


def fit_coefficients(
    change: Int[np.ndarray, "m q"], back: Int[np.ndarray, "m q"], wanted: Float[np.ndarray, "m q"]
) -> tuple[Int[np.ndarray, " q"], Int[np.ndarray, " q"]]:
    """Choose damping and pull of each parameter, by least squares and the bits by which they differ from those of the one before."""
    m, q = change.shape
    one, two, three = (part.astype(np.float64) for part in (wanted, change, back))
    sums = [np.einsum("mq,mq->q", a, b) / m for a, b in
            ((one, one), (two, two), (three, three), (one, two), (one, three), (two, three))]  # fmt: skip
    damping, pull = np.zeros(q, np.int64), np.zeros(q, np.int64)
    a, b = DAMPINGS * SIXTEENTH, PULLS * SIXTEENTH
    last = (0, 0)
    for j in range(q):
        ww, cc, bb, wc, wb, cb = (part[j] for part in sums)
        left = ww + a * a * cc + b * b * bb - 2 * a * wc - 2 * b * wb + 2 * a * b * cb
        cost = bits_for(left, m) + bits_of(DAMPINGS - last[0]) + bits_of(PULLS - last[1])
        best = np.unravel_index(np.argmin(cost), cost.shape)
        last = (int(DAMPINGS[best]), int(PULLS[best]))
        damping[j], pull[j] = last
    return damping, pull


def fit_partners(
    innovations: Int[np.ndarray, "m q"], wanted: Float[np.ndarray, "m q"]
) -> tuple[Int[np.ndarray, " o"], Int[np.ndarray, " e"], Int[np.ndarray, " e"]]:
    """Choose for each parameter the earlier ones whose innovations tell about its own, and how much."""
    m, q = innovations.shape
    known = innovations.astype(np.float64)
    among, towards = known.T @ known / m, known.T @ wanted / m
    scale = np.maximum(np.diag(among), 1e-9)
    counts, sources, weights = [0], [], []
    for j in range(q):
        chosen: list[int] = []
        best = np.zeros(0)
        left = start = float(np.mean(wanted[:, j] ** 2))
        while j and len(chosen) < min(MAX_PARTNERS, j):
            gain = (towards[:j, j] - among[:j, chosen] @ best) ** 2 / scale[:j]
            gain[chosen] = 0
            trial = [*chosen, int(np.argmax(gain))]
            square = among[np.ix_(trial, trial)] + 1e-6 * np.diag(scale[trial])
            fitted = np.linalg.solve(square, towards[trial, j])
            fitted = np.clip(np.rint(fitted / SIXTY_FOURTH), -LARGEST_WEIGHT, LARGEST_WEIGHT) * SIXTY_FOURTH
            trial_left = float(start - 2 * fitted @ towards[trial, j] + fitted @ among[np.ix_(trial, trial)] @ fitted)
            if bits_for(np.array(left), m) - bits_for(np.array(trial_left), m) < PARTNER_BITS:
                break
            chosen, best, left = trial, fitted, trial_left
        order = np.argsort(chosen)
        sources += [chosen[i] for i in order]
        weights += [round(float(best[i]) / SIXTY_FOURTH) for i in order]
        counts.append(counts[-1] + len(chosen))
    return np.array(counts), np.array(sources, np.int64), np.array(weights, np.int64)
