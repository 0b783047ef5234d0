"""Colours that depend on the direction of view, by spherical harmonics, and their gradient."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from jaxtyping import Float

from sacha_core.errors import OptionError
from sacha_core.raster.kernels.harmonics import BASIS, harmonic_colours, harmonic_gradients
from sacha_core.raster.pool import Pool, even_ranges

__all__ = ["sh_colours", "sh_colours_backward"]


def sh_colours(
    sh_dc: Float[np.ndarray, "n 3"],
    sh_rest: Float[np.ndarray, "n k 3"],
    means: Float[np.ndarray, "n 3"],
    centre: Float[np.ndarray, "3"],
    degree: int,
    pool: Pool | None = None,
) -> Float[np.ndarray, "n 3"]:
    """Give max(SH + 0.5, 0), the colours of Gaussians as seen from a camera.

    Args:
        sh_dc: (n, 3) coefficient of degree 0, RGB.
        sh_rest: (n, k, 3) coefficients of degree 1 and up, world axes.
        means: (n, 3) world, metres. One that is not finite, or lies at `centre`, is taken to lie straight ahead.
        centre: (3,) where the camera stands, metres.
        degree: 0 to 3; higher coefficients are not looked at.
        pool: shares out the work; None for the calling thread alone.

    Returns:
        (n, 3) in the dtype of `sh_dc`.

    Raises:
        OptionError: `degree` is not 0 to 3, or `sh_rest` has no coefficients of that degree.

    Source: Kerbl et al., 3D Gaussian Splatting, SIGGRAPH 2023: real harmonics with the Condon-Shortley phase.
    """
    arrays = _inputs(sh_dc, sh_rest, means, centre, degree)
    colours = np.empty(sh_dc.shape, sh_dc.dtype)

    def task(start: int, stop: int) -> None:
        harmonic_colours(*arrays, np.empty_like(arrays[-1]), degree, start, stop, colours)

    _share(pool, len(sh_dc), task)
    return colours


def sh_colours_backward(
    sh_dc: Float[np.ndarray, "n 3"],
    sh_rest: Float[np.ndarray, "n k 3"],
    means: Float[np.ndarray, "n 3"],
    centre: Float[np.ndarray, "3"],
    degree: int,
    gradient: Float[np.ndarray, "n 3"],
    pool: Pool | None = None,
) -> tuple[Float[np.ndarray, "n 3"], Float[np.ndarray, "n k 3"], Float[np.ndarray, "n 3"]]:
    """Give the gradients by `sh_dc`, `sh_rest` and `means` from that by the colours.

    Args:
        sh_dc: as of `sh_colours`, as are the next four.
        sh_rest: (n, k, 3).
        means: (n, 3).
        centre: (3,).
        degree: 0 to 3.
        gradient: (n, 3) of the loss by the colours.
        pool: shares out the work.

    Returns:
        Gradients in the shapes of the three; zero beyond `degree`, and through colours that were cut at 0.
    """
    arrays = _inputs(sh_dc, sh_rest, means, centre, degree)
    gradient = np.ascontiguousarray(gradient, sh_dc.dtype)
    g_dc, g_rest, g_means = np.empty_like(arrays[0]), np.zeros(sh_rest.shape, sh_dc.dtype), np.empty_like(arrays[0])

    def task(start: int, stop: int) -> None:
        space = np.zeros((2, len(BASIS)), sh_dc.dtype)
        harmonic_gradients(*arrays, *space, degree, start, stop, gradient, g_dc, g_rest, g_means)

    _share(pool, len(sh_dc), task)
    return g_dc, g_rest, g_means


def _inputs(
    sh_dc: np.ndarray, sh_rest: np.ndarray, means: np.ndarray, centre: np.ndarray, degree: int
) -> tuple[np.ndarray, ...]:
    """Give the kernels' inputs in the dtype of `sh_dc`, the basis last."""
    if not 0 <= degree <= 3:
        raise OptionError(f"spherical harmonics of degree {degree} were asked for, expected 0 to 3")
    if sh_rest.shape[1] < (degree + 1) ** 2 - 1:
        raise OptionError(f"degree {degree} needs {(degree + 1) ** 2 - 1} coefficients, sh_rest has {sh_rest.shape[1]}")
    arrays = (sh_dc, sh_rest, means, centre, np.array(BASIS))
    return tuple(np.ascontiguousarray(a, sh_dc.dtype) for a in arrays)


def _share(pool: Pool | None, n: int, task: Callable[[int, int], None]) -> None:
    """Call task(start, stop) for ranges that make up n Gaussians."""
    if pool is None:
        task(0, n)
        return
    bounds = even_ranges(n, pool.threads)
    pool.run(lambda _, job: task(bounds[job], bounds[job + 1]), len(bounds) - 1)
