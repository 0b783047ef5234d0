"""Gaussians as columns of numbers to be quantised, in the ranges that peers are given: as fitted as the best of them have it.

Colours go as YUV, opacity as opacity, rotations as the vector part of unit quaternions with w >= 0, logarithms of sizes no lower than
what matters.

Source: own; colour transform as JEE6.2's.
"""

from __future__ import annotations

import struct
from collections.abc import Mapping

import numpy as np
from jaxtyping import Float, Int

from sacha_core.avatar.gaussians import Gaussians
from sacha_core.geometry import quaternion

__all__ = ["GROUPS", "Columns", "columns_of", "dequantise", "gaussians_of", "quantise", "range_bytes", "range_of"]

Columns = dict[str, Float[np.ndarray, "n c"]]
GROUPS = ("position", "opacity", "scale", "rotation", "colour", "harmonic")
TO_YUV = np.array([[0.299, 0.587, 0.114], [-0.14713, -0.28886, 0.436], [0.615, -0.51498, -0.10001]])
FROM_YUV = np.array([[1, 0, 1.13983], [1, -0.39465, -0.5806], [1, 2.03211, 0]])
LEAST_OPACITY, MOST_OPACITY = 1 / 255, 0.9995
THINNEST = 5.0  # how far below its largest axis, in natural logarithms, a smaller one still shows
RANGE = struct.Struct("<2f")


def columns_of(splats: Gaussians, thinnest: float = THINNEST) -> Columns:
    """Give each group's columns, float64."""
    largest = splats.log_scale.max(axis=1, keepdims=True, initial=-np.inf).astype(np.float64)
    turns = quaternion.normalise(splats.quaternion.astype(np.float64))
    opacity = 1 / (1 + np.exp(-np.clip(splats.opacity_logit.astype(np.float64), -50, 50)))
    found = {
        "position": splats.position.astype(np.float64),
        "opacity": np.clip(opacity, 0, MOST_OPACITY)[:, None],
        "scale": np.maximum(splats.log_scale, largest - thinnest),
        "rotation": (turns * np.where(turns[:, :1] < 0, -1, 1))[:, 1:],
        "colour": splats.sh_dc @ TO_YUV.T,
    }
    if splats.sh_rest.shape[1]:
        yuv = splats.sh_rest @ TO_YUV.T
        found["harmonic"] = yuv.transpose(0, 2, 1).reshape(len(splats), -1)  # all of Y, then of U, then of V
    return found


def gaussians_of(columns: Mapping[str, Float[np.ndarray, "n c"]], binding: Int[np.ndarray, " n"]) -> Gaussians:
    """Undo `columns_of`, but for what it clamps."""
    n = len(binding)
    opacity = np.clip(columns["opacity"][:, 0], LEAST_OPACITY, MOST_OPACITY)
    vector = columns["rotation"]
    real = np.sqrt(np.maximum(1 - (vector**2).sum(axis=1, keepdims=True), 0))
    rest = columns.get("harmonic", np.zeros((n, 0)))
    yuv = rest.reshape(n, 3, rest.shape[1] // 3).transpose(0, 2, 1)
    return Gaussians(
        position=columns["position"].astype(np.float32),
        log_scale=columns["scale"].astype(np.float32),
        quaternion=quaternion.normalise(np.concatenate([real, vector], axis=1)).astype(np.float32),
        opacity_logit=np.log(opacity / (1 - opacity)).astype(np.float32),
        sh_dc=(columns["colour"] @ FROM_YUV.T).astype(np.float32),
        sh_rest=np.ascontiguousarray(yuv @ FROM_YUV.T, np.float32),
        binding=binding.astype(np.int32),
    )


def range_of(values: Float[np.ndarray, "n c"], together: bool = True) -> Float[np.ndarray, "2 c"]:
    """Give the least and greatest value of columns, as float32 holds them; `together`: one width for all."""
    if not len(values):
        return np.zeros((2, values.shape[1]))
    low, high = values.min(axis=0), values.max(axis=0)
    width = np.maximum(high - low, 1e-6)
    if together:
        width = np.full_like(width, width.max())
    return np.stack([low, low + width]).astype(np.float32).astype(np.float64)


def range_bytes(limits: Float[np.ndarray, "2 c"]) -> bytes:
    """Give a range as bytes: two float32 a column."""
    return b"".join(RANGE.pack(*pair) for pair in limits.T)


def quantise(values: Float[np.ndarray, "n c"], limits: Float[np.ndarray, "2 c"], n_bits: int) -> Int[np.ndarray, "n c"]:
    """Round columns to steps of their ranges; what lies outside goes to the end."""
    largest = (1 << n_bits) - 1
    scaled = (values - limits[0]) / np.maximum(limits[1] - limits[0], 1e-30) * largest
    return np.asarray(np.clip(np.rint(scaled), 0, largest).astype(np.int64))


def dequantise(
    levels: Int[np.ndarray, "n c"], limits: Float[np.ndarray, "2 c"], n_bits: int
) -> Float[np.ndarray, "n c"]:
    """Undo `quantise`."""
    return np.asarray(limits[0] + levels * (limits[1] - limits[0]) / ((1 << n_bits) - 1))
