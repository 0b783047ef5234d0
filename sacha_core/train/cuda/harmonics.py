"""Colours by spherical harmonics on a device, for several cameras at once: the twin of `sacha_core.raster.harmonics`."""

from __future__ import annotations

import numpy as np
import torch
from jaxtyping import Float
from torch import Tensor

from sacha_core.raster.kernels.harmonics import BASIS

__all__ = ["Harmonics"]

# Each basis function is a constant times a polynomial of the direction; here by monomial, in the order in which `monomials` gives them
POLYNOMIALS = (
    {"": 1},
    {"y": 1}, {"z": 1}, {"x": 1},
    {"xy": 1}, {"yz": 1}, {"zz": 2, "xx": -1, "yy": -1}, {"xz": 1}, {"xx": 1, "yy": -1},
    {"xxy": 3, "yyy": -1}, {"xyz": 1}, {"yzz": 4, "xxy": -1, "yyy": -1}, {"zzz": 2, "xxz": -3, "yyz": -3},
    {"xzz": 4, "xxx": -1, "xyy": -1}, {"xxz": 1, "yyz": -1}, {"xxx": 1, "xyy": -3},
)  # fmt: skip
MONOMIALS = (
    "", "x", "y", "z", "xx", "xy", "xz", "yy", "yz", "zz",
    "xxx", "xxy", "xxz", "xyy", "xyz", "xzz", "yyy", "yyz", "yzz", "zzz",
)  # fmt: skip
COUNTS = (1, 4, 10, 20)  # of monomials up to each degree


class Harmonics:
    """Evaluates spherical harmonics.

    Args:
        device: where to compute.
        dtype: float32, or float64 where gradients are checked.

    Source: Kerbl et al., 3D Gaussian Splatting, SIGGRAPH 2023: real harmonics with the Condon-Shortley phase.
    """

    def __init__(self, device: torch.device, dtype: torch.dtype = torch.float32) -> None:
        table = np.zeros((len(MONOMIALS), len(BASIS)))
        for k, (constant, polynomial) in enumerate(zip(BASIS, POLYNOMIALS, strict=True)):
            for monomial, factor in polynomial.items():
                table[MONOMIALS.index(monomial), k] = constant * factor
        self._table = torch.from_numpy(table).to(device, dtype)

    def colours(
        self,
        sh_dc: Float[Tensor, "n 3"],
        sh_rest: Float[Tensor, "n k 3"],
        means: Float[Tensor, "n 3"],
        centres: Float[Tensor, "c 3"],
        degree: int,
    ) -> Float[Tensor, "c n 3"]:
        """Give max(SH + 0.5, 0), the colours of n Gaussians as c cameras see them.

        Args:
            sh_dc: (n, 3) coefficient of degree 0, RGB.
            sh_rest: (n, k, 3) coefficients of degree 1 and up, world axes.
            means: (n, 3) world, metres. One that is not finite, or lies at a camera, has no direction; its colour is still finite.
            centres: (c, 3) where the cameras stand, metres.
            degree: 0 to 3; higher coefficients are not looked at.
        """
        colours = (BASIS[0] * sh_dc).expand(len(centres), -1, -1)
        if degree > 0:
            count = (degree + 1) ** 2
            basis = monomials(directions(means, centres), degree) @ self._table[: COUNTS[degree], 1:count]
            colours = colours + (basis[..., None] * sh_rest[:, : count - 1]).sum(2)
        return (colours + 0.5).clamp_min(0)


def directions(means: Float[Tensor, "n 3"], centres: Float[Tensor, "c 3"]) -> Float[Tensor, "c n 3"]:
    """Give the unit vectors from cameras to means; zero where there is none."""
    offset = means - centres[:, None, :]
    square = (offset * offset).sum(2, keepdim=True)
    known = (square > 0) & (square < torch.inf)
    offset, square = torch.where(known, offset, 0), torch.where(known, square, 1)
    return offset * square.rsqrt()


def monomials(direction: Float[Tensor, "c n 3"], degree: int) -> Float[Tensor, "c n m"]:
    """Give the monomials of x, y and z up to a degree, in the order of `MONOMIALS`.

    Those of a degree are x times all of the degree below, y times those of them without x, and z times the last, a power of z.
    """
    x, y, z = direction.chunk(3, 2)
    below = torch.ones_like(x)
    parts = [below]
    for lower in range(degree):
        below = torch.cat([x * below, y * below[..., -(lower + 1) :], z * below[..., -1:]], 2)
        parts.append(below)
    return torch.cat(parts, 2)
