"""Smooth curves through a few points, and the soft steps and bumps that everything here is modelled with."""

from __future__ import annotations

import numpy as np
from jaxtyping import Float

__all__ = ["bump", "smooth_curve", "smooth_step"]


def smooth_curve(
    knots: Float[np.ndarray, " p"], values: Float[np.ndarray, "p d"], at: Float[np.ndarray, " q"]
) -> Float[np.ndarray, "q d"]:
    """Evaluate the natural cubic spline through `values` at `knots`; outside the knots it continues its last piece.

    Args:
        knots: (p,) increasing.
        values: (p, d) what to pass through.
        at: (q,) where.

    Returns:
        (q, d) values.

    Source: own; the textbook tridiagonal system of the second derivatives.
    """
    step = np.diff(knots)
    slope = np.diff(values, axis=0) / step[:, None]
    system = np.eye(len(knots))
    right = np.zeros_like(values)
    for i in range(1, len(knots) - 1):
        system[i, i - 1 : i + 2] = step[i - 1], 2 * (step[i - 1] + step[i]), step[i]
        right[i] = 6 * (slope[i] - slope[i - 1])
    second = np.linalg.solve(system, right)
    piece = np.clip(np.searchsorted(knots, at, side="right") - 1, 0, len(knots) - 2)
    h, t = step[piece][:, None], (at - knots[piece])[:, None]
    linear = slope[piece] - h * (2 * second[piece] + second[piece + 1]) / 6
    cubic = (second[piece + 1] - second[piece]) / (6 * h)
    curve: Float[np.ndarray, "q d"] = values[piece] + t * (linear + t * (second[piece] / 2 + t * cubic))
    return curve


def smooth_step(
    x: Float[np.ndarray, " *n"], low: float | Float[np.ndarray, " *n"], high: float | Float[np.ndarray, " *n"]
) -> Float[np.ndarray, " *n"]:
    """Rise from 0 at `low` to 1 at `high` with two continuous derivatives; with `low` above `high` it falls."""
    t = np.clip((x - low) / (high - low), 0.0, 1.0)
    step: Float[np.ndarray, " *n"] = t * t * t * (t * (6 * t - 15) + 10)
    return step


def bump(
    points: Float[np.ndarray, "n d"], centre: tuple[float, ...], radius: tuple[float, ...]
) -> Float[np.ndarray, " n"]:
    """Give the Gaussian of height 1 about `centre`, of standard deviation `radius` along each axis (the first axes of `points`)."""
    away = (points[:, : len(centre)] - np.asarray(centre)) / np.asarray(radius)
    height: Float[np.ndarray, " n"] = np.exp(-0.5 * (away * away).sum(axis=1))
    return height
