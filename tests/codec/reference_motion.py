"""Static and dynamic parameters, in plain Python, written from FORMAT.md alone: "Static", "Motion"."""

from __future__ import annotations

import math
from collections.abc import Callable

import numpy as np
from reference_streams import AdaptiveIntegers, Fields, Residuals

WIDTHS = {"expression": 0, "rotation": 3, "neck": 3, "jaw": 3, "eyes": 6, "translation": 3}
Q = (1.0, 1.189207115002721, 1.4142135623730951, 1.681792830507429)


def accumulated(values: list[int]) -> list[int]:
    """Integers from their differences."""
    return np.cumsum(np.array(values, int)).tolist()


def static_of(data: bytes, s: int, o: int, nearby: Callable[[Fields], list[list[int]]]) -> dict[str, np.ndarray]:
    """Section "Static"; `nearby` reads predicted values of every vertex."""
    fields = Fields(data)
    shape_step, offset_step, way = fields.read("ddB")
    coded = AdaptiveIntegers(fields.take(*fields.read("I")) if way else fields.take(), 4)
    shape = coded.run([0] * s)
    offsets = np.array([] if way else coded.run([1, 2, 3] * o), float).reshape(-1, 3).cumsum(axis=0)
    coded.end()
    offsets = np.array(nearby(fields), float) if way else offsets
    return {"shape": np.array(shape, float) * shape_step, "static_offset": offsets * offset_step}


class Model:
    """The model of a motion."""

    def __init__(self, data: bytes, kinds: list[int]) -> None:
        coded = AdaptiveIntegers(data, 10)
        p = len(kinds)
        self.moves = [i for i, flag in enumerate(coded.run([0] * p)) if flag]
        q = len(self.moves)
        self.exponents = accumulated(coded.run([1] * p))
        self.bases = coded.run([2] * p)
        self.damping, self.pull, self.size = (accumulated(coded.run([context] * q)) for context in (3, 4, 5))
        self.rise = coded.run([6] * 6)
        partners = coded.run([7] * q)
        back, weights = coded.run([8] * sum(partners)), coded.run([9] * sum(partners))
        coded.end()
        self.partners, at = [], 0
        for j, count in enumerate(partners):
            self.partners.append([(j - back[k], weights[k]) for k in range(at, at + count)])
            at += count
        self.kinds = [kinds[i] for i in self.moves]

    def group(self, data: bytes, n_frames: int) -> list[list[int]]:
        """Values of the parameters that move, in sixteenths of a step."""
        coded, q = Residuals(data), len(self.moves)
        usual = [math.isqrt((3 << size) >> 1) for size in self.size]
        lately, frames = list(usual), []
        for t in range(n_frames):
            innovations: list[int] = []
            values, residuals = [], []
            for j in range(q):
                base = self.bases[self.moves[j]] * 64
                if t == 0:
                    forecast = base
                    k = min(max(self.size[j] + self.rise[self.kinds[j]], 0), 40)
                else:
                    v1 = frames[-1][j]
                    v2 = frames[-2][j] if t > 1 else v1
                    forecast = v1 + (((v1 - v2) * self.damping[j] + (base - v1) * self.pull[j] + 8) >> 4)
                    e = (usual[j] + lately[j] + 1) >> 1
                    k = min(max((e * e).bit_length() - 1, 0), 40)
                told = (sum(weight * innovations[i] for i, weight in self.partners[j]) + 32) >> 6
                residual = coded.residual(k)
                innovations.append(told + 16 * residual)
                values.append(forecast + innovations[-1])
                residuals.append(residual)
            if t:
                lately = [(a + 64 * min(abs(one), 16384) + 1) >> 1 for a, one in zip(lately, residuals, strict=True)]
            frames.append(values)
        coded.end()
        return frames


def length_of(fields: Fields) -> int:
    """Read a number of seven bits a byte."""
    value = shift = 0
    while True:
        (byte,) = fields.read("B")
        value |= (byte & 127) << shift
        shift += 7
        if byte < 128:
            return value


def dynamic_of(data: bytes, t: int, e: int) -> dict[str, np.ndarray]:
    """Section "Motion"."""
    fields = Fields(data)
    _, group_frames, unit, model_bytes = fields.read("dHdI")
    widths = WIDTHS | {"expression": e}
    model = Model(fields.take(model_bytes), np.repeat(range(6), list(widths.values())).tolist())
    steps = [(unit * Q[x % 4]) * 2.0 ** (x // 4) for x in model.exponents]
    starts = range(0, t, group_frames)
    lengths = [length_of(fields) for _ in starts]
    moved = [
        frame
        for start, n in zip(starts, lengths, strict=True)
        for frame in model.group(fields.take(n), min(group_frames, t - start))
    ]
    assert not fields.take()
    whole = np.tile(np.array(model.bases, float) * 16, (t, 1))
    whole[:, model.moves] = np.array(moved, float).reshape(t, len(model.moves))
    values = whole * (np.array(steps) / 16)
    return dict(zip(widths, np.split(values, np.cumsum(list(widths.values()))[:-1], axis=1), strict=True))
