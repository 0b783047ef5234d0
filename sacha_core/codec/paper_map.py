r"""The paper profile's integers: positions on a grid of 18 bits, everything else on 12 bits over fixed ranges, colours as YCbCr.

One row of integers for each Gaussian, columns in this order: x, y, z; Y, Cb, Cr of degree 0; Y, then Cb, then Cr of all further
coefficients; opacity; three scales; four numbers of the quaternion. Rows sorted by all columns are in an order that both sides know,
whatever order a coder of point clouds gives them back in; equal rows are equal Gaussians.

Source: mapping, ranges and rate points: MPEG JEE6.2 for Gaussian splats (contribution m69429), as the SACHA paper uses it through GeS-TM;
the order by all columns own: by x, y, z alone it is not certain.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float, Int

from sacha_core.avatar.gaussians import Gaussians
from sacha_core.errors import FormatError

__all__ = [
    "ATTRIBUTE_MAX", "MAX_QP", "POSITION_BITS", "POSITION_MAX", "RATES", "columns_of", "dead_zone_level", "from_integers", "qps_of",
    "reconstructed", "row_order", "step_of", "to_integers",
]  # fmt: skip

POSITION_BITS, ATTRIBUTE_BITS = 18, 12
POSITION_MAX, ATTRIBUTE_MAX = (1 << POSITION_BITS) - 1, (1 << ATTRIBUTE_BITS) - 1
POSITION_RANGE = 256.0
RANGES = {
    "Colour": (-4.0, 8.0),
    "Harmonic": (-4.0, 8.0),
    "Opacity": (-7.0, 25.0),
    "Scale": (-26.0, 30.0),
    "Rotation": (-1.0, 2.0),
}
TO_YUV = np.array([[0.299, 0.587, 0.114], [-0.14713, -0.28886, 0.436], [0.615, -0.51498, -0.10001]])
# quantiser steps in 256ths: 2^((QP - 4) / 6), rounded for these six, doubled for every six more
STEPS = np.array([161, 181, 203, 228, 256, 287], np.int64)
MAX_QP = 63


@dataclass(frozen=True)
class RatePoint:
    """Quantisation parameters: degree 0 as (luma, chroma), degrees 1 to 3 of luma and of chroma, then one for each attribute."""

    colour: tuple[int, int]
    luma: tuple[int, int, int]
    chroma: tuple[int, int, int]
    opacity: int
    scale: int
    rotation: int


RATES = {
    1: RatePoint((26, 30), (38, 46, 49), (42, 50, 53), 46, 38, 38),
    2: RatePoint((18, 22), (30, 38, 41), (34, 42, 45), 38, 30, 30),
    3: RatePoint((10, 14), (22, 30, 33), (26, 34, 37), 30, 22, 22),
    4: RatePoint((4, 6), (14, 22, 25), (18, 26, 29), 22, 14, 14),
}


def columns_of(n_harmonics: int) -> dict[str, slice]:
    """Columns of every section."""
    widths = {"Geometry": 3, "Colour": 3, "Harmonic": 3 * n_harmonics, "Opacity": 1, "Scale": 3, "Rotation": 4}
    ends = np.cumsum(list(widths.values())).tolist()
    return {name: slice(end - width, end) for (name, width), end in zip(widths.items(), ends, strict=True)}


def qps_of(level: int, sh_degree: int) -> dict[str, list[int]]:
    """Quantisation parameter of every column, by section."""
    rate = RATES[level]

    def of_degrees(qps: tuple[int, ...]) -> list[int]:
        return [qp for degree, qp in enumerate(qps[:sh_degree]) for _ in range(2 * degree + 3)]

    luma, chroma = rate.colour
    harmonics = of_degrees(rate.luma) + 2 * of_degrees(rate.chroma)
    return {
        "Colour": [luma, chroma, chroma],
        "Harmonic": harmonics,
        "Opacity": [rate.opacity],
        "Scale": [rate.scale] * 3,
        "Rotation": [rate.rotation] * 4,
    }


def step_of(qp: Int[np.ndarray, " c"]) -> Int[np.ndarray, " c"]:
    """Quantiser step in 256ths of a unit."""
    held = np.maximum(qp, 4)
    return np.asarray(STEPS[held % 6] << held // 6)


def dead_zone_level(
    values: Int[np.ndarray, "n c"], centre: Int[np.ndarray, " c"], qp: Int[np.ndarray, " c"]
) -> Int[np.ndarray, "n c"]:
    """Give the level of each value: its distance from the centre in steps, rounded down past a third."""
    step, distance = step_of(qp), values - centre
    level = (np.abs(distance) * 768 + step) // (3 * step)
    return np.asarray(np.where(distance < 0, -level, level))


def reconstructed(
    levels: Int[np.ndarray, "n c"], centre: Int[np.ndarray, " c"], qp: Int[np.ndarray, " c"]
) -> Int[np.ndarray, "n c"]:
    """Give the values that levels stand for."""
    distance = (np.abs(levels) * step_of(qp) + 128) >> 8
    return np.asarray(np.clip(centre + np.where(levels < 0, -distance, distance), 0, ATTRIBUTE_MAX))


def quantised(values: Float[np.ndarray, "..."], section: str) -> Int[np.ndarray, "..."]:
    """Give the integers of an attribute; what is out of range goes to its end."""
    low, extent = RANGES[section]
    return np.clip(np.rint((values.astype(np.float64) - low) / extent * ATTRIBUTE_MAX), 0, ATTRIBUTE_MAX).astype(
        np.int64
    )


def to_integers(gaussians: Gaussians) -> tuple[Int[np.ndarray, "n c"], Float[np.ndarray, "3"]]:
    """Give the rows of all Gaussians, in their order, and the least position of each axis.

    Raises:
        FormatError: positions extend over more than the grid does.
    """
    n = len(gaussians)
    wide = gaussians.position.astype(np.float64)
    low = gaussians.position.min(axis=0, initial=np.inf).astype(np.float64) if n else np.zeros(3)
    if n and (wide - low).max() > POSITION_RANGE:
        raise FormatError(f"positions extend over {(wide - low).max():g}; the paper profile holds {POSITION_RANGE:g}")
    grid = np.clip(np.rint((wide - low) / POSITION_RANGE * POSITION_MAX), 0, POSITION_MAX).astype(np.int64)
    colours = np.concatenate([gaussians.sh_dc[:, None], gaussians.sh_rest], axis=1) @ TO_YUV.T
    quaternion = gaussians.quaternion.astype(np.float64)
    length = np.linalg.norm(quaternion, axis=1, keepdims=True)
    unit = np.where(length > 0, quaternion / np.where(length > 0, length, 1), np.array([1.0, 0, 0, 0]))
    unit = np.where(unit[:, :1] < 0, -unit, unit)
    parts = [
        grid,
        quantised(colours[:, 0], "Colour"),
        quantised(colours[:, 1:].transpose(0, 2, 1).reshape(n, 3 * gaussians.sh_rest.shape[1]), "Harmonic"),
        quantised(gaussians.opacity_logit[:, None], "Opacity"),
        quantised(gaussians.log_scale, "Scale"),
        quantised(unit, "Rotation"),
    ]
    return np.concatenate(parts, axis=1), low.astype(np.float32)


def row_order(rows: Int[np.ndarray, "n c"]) -> Int[np.ndarray, " n"]:
    """Order of rows by all their columns, the first one first."""
    return np.lexsort(rows.T[::-1])


def dequantised(whole: Int[np.ndarray, "..."], section: str) -> Float[np.ndarray, "..."]:
    """Give the float64 values of integers."""
    low, extent = RANGES[section]
    return np.asarray(whole.astype(np.float64) * extent / ATTRIBUTE_MAX + low)


def rgb_of(yuv: Float[np.ndarray, "... 3"]) -> Float[np.ndarray, "... 3"]:
    """Give float32 RGB, in operations of a fixed order."""
    y, u, v = yuv[..., 0], yuv[..., 1], yuv[..., 2]
    return np.stack([y + 1.13983 * v, (y - 0.39465 * u) - 0.5806 * v, y + 2.03211 * u], axis=-1).astype(np.float32)


def from_integers(
    rows: Int[np.ndarray, "n c"], low: Float[np.ndarray, "3"], binding: Int[np.ndarray, " n"], n_harmonics: int
) -> Gaussians:
    """Give the Gaussians that rows stand for."""
    n, columns = len(rows), columns_of(n_harmonics)
    position = rows[:, columns["Geometry"]].astype(np.float64) * POSITION_RANGE / POSITION_MAX + low.astype(np.float64)
    rest = dequantised(rows[:, columns["Harmonic"]], "Harmonic").reshape(n, 3, n_harmonics).transpose(0, 2, 1)
    return Gaussians(
        position=position.astype(np.float32),
        log_scale=dequantised(rows[:, columns["Scale"]], "Scale").astype(np.float32),
        quaternion=dequantised(rows[:, columns["Rotation"]], "Rotation").astype(np.float32),
        opacity_logit=dequantised(rows[:, columns["Opacity"]], "Opacity")[:, 0].astype(np.float32),
        sh_dc=rgb_of(dequantised(rows[:, columns["Colour"]], "Colour")),
        sh_rest=rgb_of(rest),
        binding=binding.astype(np.int32),
    )
