"""Splats as points with integer columns for G-PCC, by JEE6.2's mapping or one fitted to the avatar.

Source: MPEG m69429 by way of UniGSC's configuration (ranges, bits, quantisations); the fitted mapping is our own.
"""

from __future__ import annotations

import struct
from dataclasses import dataclass

import numpy as np
from jaxtyping import Float, Int

from sacha_core.avatar.gaussians import Gaussians
from sacha_core.evaluate.peers.attributes import (
    FROM_YUV,
    GROUPS,
    TO_YUV,
    columns_of,
    dequantise,
    gaussians_of,
    quantise,
    range_of,
)
from sacha_core.geometry import quaternion

__all__ = ["FITTED", "Head", "Points", "map_points", "morton", "unmap_points"]

JEE_BITS, FITTED_BITS = 12, 10
CUBE_BITS, CUBE = 18, 256.0
WORLD_FACTOR = 128.0  # a metre in JEE6.2's units, so that a triangle is about one of them, as in its own frame
Degrees = tuple[int, int, int]
Quantisation = tuple[int, int, Degrees, Degrees, int, int, int]
JEE_RANGES = {
    "opacity": (-7.0, 25.0), "scale": (-26.0, 30.0), "rotation": (-1.0, 2.0), "colour": (-4.0, 8.0), "harmonic": (-4.0, 8.0),
}  # fmt: skip
# luma and chroma of degree 0, luma and chroma of degrees 1 to 3, opacity, scale, rotation
JEE: dict[str, Quantisation] = {
    "r01": (26, 30, (38, 46, 49), (42, 50, 53), 46, 38, 38), "r02": (18, 22, (30, 38, 41), (34, 42, 45), 38, 30, 30),
    "r03": (10, 14, (22, 30, 33), (26, 34, 37), 30, 22, 22), "r04": (4, 6, (14, 22, 25), (18, 26, 29), 22, 14, 14),
}  # fmt: skip
# bits of positions; then quantisations as above, over ranges fitted to the avatar
FITTED: dict[str, tuple[int, *Quantisation]] = {
    "f1": (10, 40, 42, (46, 48, 50), (48, 50, 50), 44, 36, 39), "f2": (10, 36, 38, (43, 45, 46), (45, 47, 48), 41, 32, 35),
    "f3": (11, 33, 35, (40, 42, 43), (42, 44, 45), 38, 29, 32), "f4": (11, 30, 32, (37, 39, 40), (39, 41, 42), 35, 26, 29),
    "f5": (12, 26, 28, (34, 36, 37), (36, 38, 39), 31, 22, 25), "f6": (13, 22, 24, (30, 32, 33), (32, 34, 35), 26, 18, 21),
}  # fmt: skip
NAMES = (*JEE, *FITTED)
HEAD = struct.Struct("<BBBf")  # mapping, columns of harmonics of one channel, in the world?, factor of places and sizes


@dataclass(frozen=True)
class Head:
    """What a decoder is told beside the points.

    Args:
        mapping: its name.
        n_rest: coefficients beyond degree 0.
        factor: that places and sizes were multiplied by.
        limits: (2, c) ranges of position and columns; none for JEE6.2's, but for the least position.
    """

    mapping: str
    n_rest: int
    factor: float
    limits: Float[np.ndarray, "2 c"]

    @property
    def n_bits(self) -> int:
        """Bits of a column."""
        return JEE_BITS if self.mapping in JEE else FITTED_BITS

    @property
    def n_columns(self) -> int:
        """Columns beside the position."""
        return 1 + 3 + (4 if self.mapping in JEE else 3) + 3 + 3 * self.n_rest

    def pack(self) -> bytes:
        """Give the bytes."""
        kept = self.limits[:1, :3] if self.mapping in JEE else self.limits
        start = HEAD.pack(NAMES.index(self.mapping), self.n_rest, 0, self.factor)
        return start + kept.astype("<f4").tobytes()

    @classmethod
    def read(cls, data: bytes) -> Head:
        """Undo `pack`."""
        mapping, n_rest, _, factor = HEAD.unpack_from(data)
        kept = np.frombuffer(data, "<f4", offset=HEAD.size).astype(np.float64)
        limits = np.stack([kept, kept + CUBE]) if NAMES[mapping] in JEE else kept.reshape(2, -1)
        return cls(NAMES[mapping], n_rest, factor, limits)


@dataclass(frozen=True)
class Points:
    """Points with columns.

    Args:
        position: (n, 3) whole places, no two the same.
        columns: (n, c) of 12 or, fitted, 10 bits each.
        qps: quantisation of each column.
        told: what a decoder is told.
        rows: (n,) which Gaussian each is.
    """

    position: Int[np.ndarray, "n 3"]
    columns: Int[np.ndarray, "n c"]
    qps: tuple[int, ...]
    told: Head
    rows: Int[np.ndarray, " n"]

    def sorted(self) -> Points:
        """Give them in Morton order."""
        order = np.argsort(morton(self.position), kind="stable")
        return Points(self.position[order], self.columns[order], self.qps, self.told, self.rows[order])

    def head(self) -> bytes:
        """Give the bytes of what a decoder is told."""
        return self.told.pack()


def map_points(splats: Gaussians, mapping: str, in_world: bool) -> Points:
    """Quantise splats to points and columns."""
    n_rest = splats.sh_rest.shape[1]
    if mapping in JEE:
        factor = WORLD_FACTOR if in_world else 1.0
        position = splats.position.astype(np.float64) * factor
        low = position.min(axis=0).astype(np.float32).astype(np.float64)
        place = quantise(position, np.stack([low, low + CUBE]), CUBE_BITS)
        table, limits = jee_columns(splats, factor)
        head = Head(mapping, n_rest, factor, np.stack([low, low + CUBE]))
        quantisation = JEE[mapping]
    else:
        columns = columns_of(splats)
        spans = {name: range_of(values) for name, values in columns.items()}
        n_bits, rest = FITTED[mapping][0], FITTED[mapping][1:]
        place = quantise(columns["position"], spans["position"], n_bits)
        names = [name for name in GROUPS[1:] if name in columns]
        table = np.concatenate([columns[name] for name in names], axis=1)
        limits = np.concatenate([spans[name] for name in names], axis=1)
        head = Head(mapping, n_rest, 1.0, np.concatenate([spans["position"], limits], axis=1))
        quantisation = rest
    qps = qps_of(quantisation, n_rest, 4 if mapping in JEE else 3)
    return Points(set_apart(place), quantise(table, limits, head.n_bits), qps, head, np.arange(len(splats)))


def qps_of(quantisation: Quantisation, n_rest: int, n_rotation: int) -> tuple[int, ...]:
    """Give the quantisation of each column: opacity, scale, rotation, colour, harmonics (all Y, then U, then V)."""
    luma, chroma, luma_rest, chroma_rest, opacity, scale, rotation = quantisation
    degrees = [degree for degree in range(1, 4) for _ in range(2 * degree + 1)][:n_rest]
    rest = [of[degree - 1] for of in (luma_rest, chroma_rest, chroma_rest) for degree in degrees]
    return (opacity, *[scale] * 3, *[rotation] * n_rotation, luma, chroma, chroma, *rest)


def jee_columns(splats: Gaussians, factor: float) -> tuple[Float[np.ndarray, "n c"], Float[np.ndarray, "2 c"]]:
    """Give opacity logits, sizes, quaternions of w >= 0 and YUV, with their fixed ranges."""
    turns = quaternion.normalise(splats.quaternion.astype(np.float64))
    rest = (splats.sh_rest @ TO_YUV.T).transpose(0, 2, 1).reshape(len(splats), -1)
    found = {
        "opacity": splats.opacity_logit[:, None],
        "scale": splats.log_scale + np.log(factor),
        "rotation": turns * np.where(turns[:, :1] < 0, -1, 1),
        "colour": splats.sh_dc @ TO_YUV.T,
        "harmonic": rest,
    }
    limits = [np.repeat([[JEE_RANGES[k][0]], [sum(JEE_RANGES[k])]], v.shape[1], axis=1) for k, v in found.items()]
    return np.concatenate(list(found.values()), axis=1), np.concatenate(limits, axis=1)


def unmap_points(
    position: Int[np.ndarray, "n 3"], columns: Int[np.ndarray, "n c"], head: Head, binding: Int[np.ndarray, " n"]
) -> Gaussians:
    """Undo `map_points`."""
    if head.mapping not in JEE:
        place = dequantise(position, head.limits[:, :3], FITTED[head.mapping][0])
        values = dequantise(columns, head.limits[:, 3:], FITTED_BITS)
        cut = np.cumsum([1, 3, 3, 3])
        opacity, scale, rotation, colour, harmonic = np.split(values, cut, axis=1)
        named = {"position": place, "opacity": opacity, "scale": scale, "rotation": rotation, "colour": colour}
        return gaussians_of({**named, "harmonic": harmonic}, binding)
    n = len(binding)
    spans = [
        JEE_RANGES[name]
        for name, width in zip(JEE_RANGES, (1, 3, 4, 3, 3 * head.n_rest), strict=True)
        for _ in range(width)
    ]
    low, width = np.array(spans).T
    values = low + columns / ((1 << JEE_BITS) - 1) * width
    opacity, scale, rotation, colour, harmonic = np.split(values, np.cumsum([1, 3, 4, 3]), axis=1)
    place = dequantise(position, head.limits, CUBE_BITS) / head.factor
    rest = harmonic.reshape(n, 3, head.n_rest).transpose(0, 2, 1) @ FROM_YUV.T
    return Gaussians(
        position=place.astype(np.float32),
        log_scale=(scale - np.log(head.factor)).astype(np.float32),
        quaternion=quaternion.normalise(rotation).astype(np.float32),
        opacity_logit=opacity[:, 0].astype(np.float32),
        sh_dc=(colour @ FROM_YUV.T).astype(np.float32),
        sh_rest=np.ascontiguousarray(rest, np.float32),
        binding=binding,
    )


def set_apart(place: Int[np.ndarray, "n 3"]) -> Int[np.ndarray, "n 3"]:
    """Move points that fall on a taken place to the next free one along x, then along y and z where that helps sooner."""
    found, taken = place.copy(), set[tuple[int, int, int]]()
    for row, (x, y, z) in enumerate(place.tolist()):
        reach = 0
        while True:
            near = [(x + i, y + j, z + k) for i, j, k in STEPS if max(i, j, k) == reach]
            free = next((one for one in near if one not in taken), None)
            if free is not None:
                break
            reach += 1
            if reach > REACH:
                free = (x + len(taken) + 1, y, z)
                break
        taken.add(free)
        found[row] = free
    return found


REACH = 6
STEPS = sorted(((i, j, k) for i in range(REACH + 1) for j in range(REACH + 1) for k in range(REACH + 1)), key=sum)


def morton(place: Int[np.ndarray, "n 3"]) -> Int[np.ndarray, " n"]:
    """Interleave the bits of x, y and z, up to 21 of each."""
    code = np.zeros(len(place), np.int64)
    for bit in range(21):
        for axis in range(3):
            code |= ((place[:, axis] >> bit) & 1) << (3 * bit + 2 - axis)
    return code
