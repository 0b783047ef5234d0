r"""The basis that harmonics are coded in: made for one avatar from what errors are worth to its pictures.

Colours get three orthogonal axes, those of the most energy first. Coefficients are whitened by the metric of the pictures' error and
rotated to principal components, so that equal steps make equal errors and few components carry what can be seen.

Source: own; principal components under a metric (generalised Karhunen-Loeve transform).
"""

from __future__ import annotations

import numpy as np
from jaxtyping import Float, Int

from sacha_core.codec.harmonic_metric import Metric
from sacha_core.codec.harmonics import AXES, BASIS_ONE, Transform
from sacha_core.codec.steps import MAX_EXPONENT, PER_OCTAVE, StepRule

__all__ = ["fit_transform", "on_axes"]

FLOOR = 1e-3  # of the metric's mean: what no camera sees stays representable
PEAK = BASIS_ONE - 1
WORTH_A_COMPONENT = 200.0  # bits: what the basis function and the weights of a component take


def fit_transform(rest: Float[np.ndarray, "n k 3"], metric: Metric, rule: StepRule, lagrangian: float) -> Transform:
    """Give the transform for coefficients.

    Args:
        rest: (n, k, 3) coefficients, RGB.
        metric: what their errors are worth.
        rule: step of a component that errors of degree 0 are worth as much as.
        lagrangian: squared change of the picture that a bit is worth.
    """
    axes = sent(colour_axes(rest, metric))
    whitened, functions = principal_functions(on_axes(rest, axes), metric)
    peaks = np.maximum(np.abs(functions).max(axis=1), 1e-30)
    basis = np.rint(functions / peaks[:, None] * PEAK).astype(np.int64)
    scale = peaks * (BASIS_ONE / PEAK)  # of a component's value over that of the function
    exponents = np.rint(PER_OCTAVE * np.log2(scale)).astype(np.int64)
    low, high = -rule.base - rule.low, MAX_EXPONENT - rule.base - rule.most
    energy = (metric.weight @ np.square(whitened).reshape(len(whitened), AXES * whitened.shape[2])).reshape(AXES, -1)
    counts = [used(of_axis, lagrangian) for of_axis in energy]
    n_functions = max(counts)
    exponents = np.clip(exponents[:n_functions], max(low, -128), min(high, 127))
    return Transform(rule, tuple(counts), axes, basis[:n_functions], exponents)


def used(energy: Float[np.ndarray, " f"], lagrangian: float) -> int:
    """How many functions from the first on are worth their bytes."""
    worth = np.flatnonzero(energy > WORTH_A_COMPONENT * lagrangian)
    return int(worth[-1]) + 1 if len(worth) else 0


def sent(axes: Float[np.ndarray, "3 3"]) -> Int[np.ndarray, "3 3"]:
    """Round axes of colours to what is sent."""
    return np.asarray(np.rint(axes * PEAK).astype(np.int64))


def on_axes(rest: Float[np.ndarray, "n k 3"], axes: Int[np.ndarray, "3 3"]) -> Float[np.ndarray, "n k 3"]:
    """Give coefficients along axes of colours, of which the decoder makes RGB again."""
    return np.asarray(rest.astype(np.float64) @ np.linalg.inv(axes / BASIS_ONE))


def colour_axes(rest: Float[np.ndarray, "n k 3"], metric: Metric) -> Float[np.ndarray, "3 3"]:
    """Orthonormal axes of colours, that of the most energy first."""
    single = rest.astype(np.float32)
    energy = (metric.left @ single).reshape(-1, AXES).T.astype(np.float64) @ single.reshape(-1, AXES)
    energy = (energy + energy.T) / 2
    _, axes = np.linalg.eigh(energy)
    rows = axes[:, ::-1].T
    return np.asarray(rows * np.where(rows.sum(axis=1, keepdims=True) < 0, -1.0, 1.0))


def principal_functions(
    coefficients: Float[np.ndarray, "n k 3"], metric: Metric
) -> tuple[Float[np.ndarray, "n 3 k"], Float[np.ndarray, "k k"]]:
    """Give the values of components in which errors are worth as much as of degree 0, and the coefficients of each function."""
    k = coefficients.shape[1]
    mean = metric.left.sum(axis=0, dtype=np.float64) / max(metric.weight.sum(), 1e-30)
    mean = mean + FLOOR * max(np.trace(mean), 1e-30) / k * np.eye(k)
    values, vectors = np.linalg.eigh(mean)
    values = np.maximum(values, values[-1] * 1e-9)
    root, inverse = (vectors * values**power @ vectors.T for power in (0.5, -0.5))
    whitened = coefficients.transpose(0, 2, 1).reshape(len(coefficients) * AXES, k) @ root
    heavy = whitened * np.repeat(np.sqrt(metric.weight), AXES)[:, None]
    _, rotation = np.linalg.eigh(heavy.T @ heavy)
    rotation = rotation[:, ::-1]
    return (whitened @ rotation).reshape(len(coefficients), AXES, k), (inverse @ rotation).T
