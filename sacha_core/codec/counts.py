"""Section `Counts`: how many Gaussians each triangle carries, or which vertices have one, in place of n triangle indices.

Numbers are coded coarse to fine, each under a context of what its neighbours on the head have.

Source: own.
"""

from __future__ import annotations

import numpy as np
from jaxtyping import Int

from sacha_core.codec.order import Layout, Pass, layout_by_triangle, layout_by_vertex, passes_over, weighted_mean
from sacha_core.codec.reading import ByteReader
from sacha_core.codec.symbols import SymbolReader, SymbolWriter
from sacha_core.codec.template import Template

__all__ = ["decode_layout", "encode_layout"]

BY_TRIANGLE, BY_VERTEX = 0, 1
PER_GAUSSIAN = 16  # means of counts are in sixteenths
BOUNDS = np.array([1, 4, 8, 12, 16, 20, 24, 32, 40, 48, 64, 96, 128, 256, 512])  # of the classes of a mean
CLASSES = len(BOUNDS) + 1


def contexts_of(step: Pass, numbers: Int[np.ndarray, " m"]) -> Int[np.ndarray, " p"]:
    """Class of the mean over the neighbours of each place."""
    mean = weighted_mean(np.minimum(numbers, 1 << 30) * PER_GAUSSIAN, step.near, step.trust)
    return np.asarray(np.searchsorted(BOUNDS, mean, side="right"))


def encode_layout(numbers: Int[np.ndarray, " m"], template: Template, by_vertex: bool) -> bytes:
    """Code the number of Gaussians at every place, in coding order: of triangles, or (0 or 1) of vertices."""
    writer = SymbolWriter(CLASSES)
    for step in passes_over(template, by_vertex):
        writer.write(numbers[step.rows], contexts_of(step, numbers))
    return bytes([BY_VERTEX if by_vertex else BY_TRIANGLE]) + writer.finish()


def decode_layout(reader: ByteReader, template: Template, n_gaussians: int) -> Layout:
    """Read where the Gaussians lie.

    Raises:
        FormatError: a number is out of range, the numbers do not add up to `n_gaussians`, or vertices are named that are not known.
    """
    (kind,) = reader.unpack("B")
    if kind not in (BY_TRIANGLE, BY_VERTEX) or (kind == BY_VERTEX and not template.known):
        raise reader.error(
            f"Gaussians lie by {kind}, expected {BY_TRIANGLE} (triangles) or, with the head, {BY_VERTEX} (vertices)"
        )
    by_vertex = kind == BY_VERTEX
    symbols = SymbolReader(reader, CLASSES)
    numbers = np.zeros(len(template.vertices if by_vertex else template.triangles), np.int64)
    most = 1 if by_vertex else n_gaussians
    for step in passes_over(template, by_vertex):
        found = symbols.read(contexts_of(step, numbers))
        if found.min() < 0 or found.max() > most:
            raise reader.error(f"numbers from {found.min()} to {found.max()}, expected 0 to {most}")
        numbers[step.rows] = found
    symbols.check_end()
    if numbers.sum() != n_gaussians:
        raise reader.error(f"numbers add up to {numbers.sum()}, not {n_gaussians}")
    layout = layout_by_vertex(numbers > 0, template) if by_vertex else layout_by_triangle(numbers, template)
    if layout.binding.min(initial=0) < 0:
        raise reader.error("a Gaussian at a vertex that no triangle has")
    return layout
