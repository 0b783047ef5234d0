"""What all groups of a motion need: steps, bases and how every parameter of a frame is expected from what is known.

FORMAT.md, "Motion", is the specification.

Source: own; damped second-order prediction as used on tracked motion, the rest after lossless audio coding.
"""

from __future__ import annotations

import struct
from dataclasses import dataclass

import numpy as np
from jaxtyping import Bool, Float, Int

from sacha_core.avatar.motion import Motion
from sacha_core.codec.adaptive import AdaptiveDecoder, AdaptiveEncoder
from sacha_core.codec.kernels import frames, residuals
from sacha_core.codec.reading import ByteReader

__all__ = ["MAX_PARTNERS", "PARAMETERS", "FrameModel", "columns_of", "parameters_of", "steps_of"]

PARAMETERS = ("expression", "rotation", "neck", "jaw", "eyes", "translation")
WIDTHS = (0, 3, 3, 3, 6, 3)  # of an expression the header tells
QUARTERS = (1.0, 1.189207115002721, 1.4142135623730951, 1.681792830507429)  # octaves
LARGEST_UNIT = 2.0**60
MAX_EXPONENT = 240  # quarter octaves
SMALLEST_STEP, LARGEST_STEP = 1e-9, 1e3
MAX_PARTNERS, LARGEST_WEIGHT = 16, 127
LARGEST_COEFFICIENT = 16  # damping and pull, sixteenths
LIVE_BASE = 4  # the base of a parameter that moves is a multiple of so many steps
ALIVE, EXPONENT, BASE, DAMPING, PULL, SIZE, RISE, COUNT, DISTANCE, WEIGHT = range(10)  # contexts
N_CONTEXTS = 10


@dataclass(frozen=True)
class FrameModel:
    """How frames are expected; q parameters of p move.

    Args:
        kinds: (p,) index into PARAMETERS.
        alive: (p,) which parameters move; the others stay at their base.
        unit: step of a parameter with exponent 0.
        exponents: (p,) quarter octaves by which steps differ from `unit`.
        base: (p,) what first frames are expected to be; in units, `frames.FINE` to a step.
        damping: (q,) share of the last change that is expected again, sixteenths.
        pull: (q,) share of the way back to the base, sixteenths.
        size: (q,) class of the usual residual.
        rise: (6,) by how many classes residuals of first frames are larger, of each of PARAMETERS.
        partners: (q + 1,) where each parameter's entries in the next two begin.
        sources: earlier parameters (numbers among the q) whose innovation tells about this one's.
        weights: how much, 64ths.
    """

    kinds: Int[np.ndarray, " p"]
    alive: Bool[np.ndarray, " p"]
    unit: float
    exponents: Int[np.ndarray, " p"]
    base: Int[np.ndarray, " p"]
    damping: Int[np.ndarray, " q"]
    pull: Int[np.ndarray, " q"]
    size: Int[np.ndarray, " q"]
    rise: Int[np.ndarray, " k"]
    partners: Int[np.ndarray, " o"]
    sources: Int[np.ndarray, " m"]
    weights: Int[np.ndarray, " m"]

    @property
    def steps(self) -> Float[np.ndarray, " p"]:
        """Quantiser step of every parameter."""
        return steps_of(self.unit, self.exponents)

    @property
    def tables(self) -> Int[np.ndarray, " l"]:
        """The integers that `kernels/frames.py` works with."""
        first = np.clip(self.size + self.rise[self.kinds[self.alive]], 0, residuals.CLASSES - 1)
        parts = (self.base[self.alive], self.damping, self.pull, self.size, first, self.partners)
        return np.concatenate(parts).astype(np.int64)

    def values(self, units: Int[np.ndarray, "t q"]) -> Float[np.ndarray, "t p"]:
        """Give float32 values of frames in units: two float64 products, rounded once."""
        whole = np.tile(self.base, (len(units), 1))
        whole[:, self.alive] = units
        return (whole.astype(np.float64) * (self.steps * (1 / frames.FINE))).astype(np.float32)

    def pack(self) -> bytes:
        """Write the model."""
        coder = AdaptiveEncoder(N_CONTEXTS)

        def write(values: Int[np.ndarray, " m"], context: int) -> None:
            coder.write(values, np.full(len(values), context))

        write(self.alive.astype(np.int64), ALIVE)
        write(np.diff(self.exponents, prepend=0), EXPONENT)
        write(self.base // np.where(self.alive, LIVE_BASE * frames.FINE, frames.FINE), BASE)
        for values, context in ((self.damping, DAMPING), (self.pull, PULL), (self.size, SIZE)):
            write(np.diff(values, prepend=0), context)
        write(self.rise, RISE)
        counts = np.diff(self.partners)
        write(counts, COUNT)
        write(np.repeat(np.arange(len(counts)), counts) - self.sources, DISTANCE)
        write(self.weights, WEIGHT)
        coded = coder.finish()
        return struct.pack("<dI", self.unit, len(coded)) + coded

    @classmethod
    def read(cls, reader: ByteReader, n_expression: int) -> FrameModel:
        """Read what `pack` wrote.

        Raises:
            FormatError: a number is out of its range, or bytes are left over.
        """
        unit, n_bytes = reader.unpack("dI")
        if not 1 / LARGEST_UNIT <= unit <= LARGEST_UNIT:
            raise reader.error(f"a unit of {unit}, expected {1 / LARGEST_UNIT:.3g} to {LARGEST_UNIT:.3g}")
        kinds = columns_of(n_expression)
        p = len(kinds)
        offset = reader.offset
        coder = AdaptiveDecoder(reader.take(n_bytes), N_CONTEXTS, p, offset=offset)

        def read(count: int, context: int, low: int, high: int, *, differences: bool = False) -> Int[np.ndarray, " m"]:
            values = coder.read(np.full(count, context))
            values = np.cumsum(values) if differences else values
            if count and not (low <= values.min() and values.max() <= high):
                raise reader.error(
                    f"a number of its frames is {values.min()} or {values.max()}, expected {low} to {high}"
                )
            return np.asarray(values)

        alive = read(p, ALIVE, 0, 1).astype(bool)
        q = int(alive.sum())
        exponents = read(p, EXPONENT, -MAX_EXPONENT, MAX_EXPONENT, differences=True)
        largest = frames.LIMIT // frames.FINE
        base = read(p, BASE, -largest, largest) * np.where(alive, LIVE_BASE * frames.FINE, frames.FINE)
        damping = read(q, DAMPING, -LARGEST_COEFFICIENT, LARGEST_COEFFICIENT, differences=True)
        pull = read(q, PULL, -LARGEST_COEFFICIENT, LARGEST_COEFFICIENT, differences=True)
        size = read(q, SIZE, 0, residuals.CLASSES - 1, differences=True)
        rise = read(len(PARAMETERS), RISE, -residuals.CLASSES, residuals.CLASSES)
        counts = read(q, COUNT, 0, MAX_PARTNERS)
        distance = read(int(counts.sum()), DISTANCE, 1, max(q, 1))
        sources = np.repeat(np.arange(q), counts) - distance
        weights = read(len(sources), WEIGHT, -LARGEST_WEIGHT, LARGEST_WEIGHT)
        coder.check_end()
        if len(sources) and sources.min() < 0:
            raise reader.error("a parameter has a partner before the first")
        partners = np.concatenate([[0], np.cumsum(counts)])
        model = cls(kinds, alive, unit, exponents, base, damping, pull, size, rise, partners, sources, weights)
        steps = model.steps
        if steps.min() < SMALLEST_STEP or steps.max() > LARGEST_STEP:
            raise reader.error(f"steps of {steps.min()} to {steps.max()}, expected {SMALLEST_STEP} to {LARGEST_STEP}")
        return model


def columns_of(n_expression: int) -> Int[np.ndarray, " p"]:
    """Give the parameter that each number of a frame belongs to."""
    return np.repeat(np.arange(len(PARAMETERS)), [n_expression, *WIDTHS[1:]])


def parameters_of(motion: Motion) -> Float[np.ndarray, "t p"]:
    """Give the parameters of all frames, in the order of the stream."""
    return np.concatenate([getattr(motion, name) for name in PARAMETERS], axis=1)


def steps_of(unit: float, exponents: Int[np.ndarray, " p"]) -> Float[np.ndarray, " p"]:
    """Give steps: a product with a quarter of an octave from a table, then a power of two, which is exact."""
    octaves, quarters = np.divmod(exponents, len(QUARTERS))
    return np.asarray(np.ldexp(unit * np.array(QUARTERS)[quarters], octaves))
