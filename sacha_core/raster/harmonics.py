"""Colours that depend on the direction of view, by spherical harmonics, and their gradients."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from jaxtyping import Float, UInt8

from sacha_core.errors import OptionError
from sacha_core.parallel.kernels.lanes import LANES
from sacha_core.parallel.pool import Pool, even_ranges
from sacha_core.raster.kernels.harmonics import coefficient_gradients, harmonic_colours, harmonic_gradients

__all__ = [
    "ALL_DEGREES",
    "NO_TILTS",
    "degrees_in_use",
    "sh_colours",
    "sh_colours_backward",
    "sh_rest_gradient",
    "share",
]

ALL_DEGREES = np.zeros(0, np.uint8)  # for kernels: no Gaussian has a limit of its own
NO_TILTS = np.zeros((3, 0, 3), np.float32)  # for kernels: nobody wants the colours' gradients by the means


def sh_colours(
    sh_dc: Float[np.ndarray, "n 3"],
    sh_rest: Float[np.ndarray, "n k 3"],
    means: Float[np.ndarray, "n 3"],
    centre: Float[np.ndarray, "3"],
    degree: int,
    pool: Pool | None = None,
    degrees: UInt8[np.ndarray, " n"] | None = None,
    out: Float[np.ndarray, "n c"] | None = None,
    tilts: Float[np.ndarray, "3 n 3"] | None = None,
) -> Float[np.ndarray, "n c"]:
    """Give max(SH + 0.5, 0), the colours of Gaussians as seen from a camera.

    Coefficients that are zero give the same bits as a lower degree, and so does any number of threads.

    Args:
        sh_dc: (n, 3) coefficient of degree 0, RGB.
        sh_rest: (n, k, 3) coefficients of degree 1 and up, world axes.
        means: (n, 3) world, metres. One that is not finite, or lies at `centre`, is taken to lie straight ahead.
        centre: (3,) where the camera stands, metres.
        degree: 0 to 3; higher coefficients are not looked at.
        pool: shares out the work; None for the calling thread alone.
        degrees: (n,) of each Gaussian: its higher coefficients are not looked at either; None for no such limit.
        out: (n, 3 or 4) contiguous float32, to write to; a fourth column stays as it is. None for new memory.
        tilts: (3, n, 3) contiguous float32, to write the gradient of each colour by the mean to; None for nobody to want it.

    Returns:
        `out`, or (n, 3) float32.

    Raises:
        OptionError: `degree` is not 0 to 3, `sh_rest` has no coefficients of that degree, or `degrees` or `out` have another shape.

    Source: Kerbl et al., 3D Gaussian Splatting, SIGGRAPH 2023: real harmonics with the Condon-Shortley phase.
    """
    require_degree(degree, sh_rest.shape[1])
    n = len(sh_dc)
    colours = np.empty((n, 3), np.float32) if out is None else out
    if colours.shape not in ((n, 3), (n, 4)) or colours.dtype != np.float32 or not colours.flags.c_contiguous:
        raise OptionError(f"colours go to {colours.dtype} of shape {colours.shape}, expected float32 of ({n}, 3 or 4)")
    limits = ALL_DEGREES if degrees is None else np.ascontiguousarray(degrees, np.uint8)
    if degrees is not None and limits.shape != (n,):
        raise OptionError(f"degrees of harmonics have shape {limits.shape}, expected ({n},)")
    arrays, slopes = single(sh_dc, sh_rest, means, centre), NO_TILTS if tilts is None else tilts
    share(pool, n, lambda start, stop: harmonic_colours(start, stop, *arrays, degree, limits, colours, slopes))
    return colours


def sh_colours_backward(
    sh_rest: Float[np.ndarray, "n k 3"],
    means: Float[np.ndarray, "n 3"],
    centre: Float[np.ndarray, "3"],
    degree: int,
    colours: Float[np.ndarray, "n c"],
    gradient: Float[np.ndarray, "n c"],
    g_means: Float[np.ndarray, "n 3"],
    pool: Pool | None = None,
) -> Float[np.ndarray, "n 3"]:
    """Carry the gradient by the colours back.

    The gradients by coefficients follow from what is given back: by `sh_dc` it is `BASIS[0]`, the first basis function, times it; by
    `sh_rest` see `sh_rest_gradient`. An optimiser makes them as it goes: to write them takes longer than to compute them.

    Args:
        sh_rest: as of `sh_colours`, as are the next three.
        means: (n, 3).
        centre: (3,).
        degree: 0 to 3.
        colours: (n, 3 or 4) what `sh_colours` gave.
        gradient: (n, 3 or 4) of the loss by the colours; a fourth column is not looked at.
        g_means: (n, 3) contiguous float32, the gradient by the means is added to it.
        pool: shares out the work; None for the calling thread alone.

    Returns:
        (n, 3) float32, `gradient` where the colour was not cut at 0, 0 elsewhere.

    Raises:
        OptionError: `degree` is not 0 to 3, or `sh_rest` has no coefficients of that degree.
    """
    require_degree(degree, sh_rest.shape[1])
    cut, slopes = np.empty(means.shape, np.float32), single(colours, gradient)
    nothing, again, tilts = np.zeros_like(cut), np.empty_like(cut), np.empty((3, *cut.shape), np.float32)
    arrays = (nothing, *single(sh_rest, means, centre), degree, ALL_DEGREES, again, tilts)

    def task(start: int, stop: int) -> None:
        harmonic_colours(start, stop, *arrays)
        harmonic_gradients(start, stop, tilts, *slopes, cut, g_means)

    share(pool, len(means), task)
    return cut


def sh_rest_gradient(
    means: Float[np.ndarray, "n 3"],
    centre: Float[np.ndarray, "3"],
    degree: int,
    cut: Float[np.ndarray, "n 3"],
    coefficients: int,
) -> Float[np.ndarray, "n k 3"]:
    """Give the gradient by `sh_rest`, of so many coefficients, from what `sh_colours_backward` gave; zero beyond `degree`."""
    require_degree(degree, coefficients)
    gradient = np.zeros((len(means), coefficients, 3), np.float32)
    means, centre, cut = single(means, centre, cut)
    if degree > 0:
        coefficient_gradients(0, len(means), means, centre, degree, cut, gradient)
    return gradient


def degrees_in_use(sh_rest: Float[np.ndarray, "n k 3"]) -> UInt8[np.ndarray, " n"]:
    """Give the degree beyond which all of a Gaussian's coefficients are zero, 0 to 3."""
    used = np.any(sh_rest, axis=2)
    degrees = np.zeros(len(used), np.uint8)
    for degree in (1, 2, 3):
        degrees[used[:, degree**2 - 1 : (degree + 1) ** 2 - 1].any(axis=1)] = degree
    return degrees


def require_degree(degree: int, coefficients: int) -> None:
    """Raise OptionError unless a degree can be had from so many coefficients."""
    if not 0 <= degree <= 3:
        raise OptionError(f"spherical harmonics of degree {degree} were asked for, expected 0 to 3")
    if coefficients < (degree + 1) ** 2 - 1:
        raise OptionError(f"degree {degree} needs {(degree + 1) ** 2 - 1} coefficients, sh_rest has {coefficients}")


def single(*arrays: np.ndarray) -> tuple[np.ndarray, ...]:
    return tuple(np.ascontiguousarray(array, np.float32) for array in arrays)


def share(pool: Pool | None, n: int, task: Callable[[int, int], None]) -> None:
    """Call task(start, stop) for ranges that make up n Gaussians, of whole blocks of lanes."""
    if pool is None:
        task(0, n)
        return
    bounds = [min(LANES * block, n) for block in even_ranges(-(-n // LANES), pool.threads)]
    pool.run(lambda _, job: task(bounds[job], bounds[job + 1]), len(bounds) - 1)
