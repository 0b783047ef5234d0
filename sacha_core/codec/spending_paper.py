"""What each Gaussian takes in the paper's profile, by the account of this project's own coder of points and attributes.

The count of a box of points belongs to its points, in equal parts. Gaussians at one point of the grid cannot be told apart: they share.

Source: own.
"""

from __future__ import annotations

import numpy as np
from jaxtyping import Float, Int

from sacha_core.codec.container import Section
from sacha_core.codec.header import Header
from sacha_core.codec.paper import OWN, read_geometry_head
from sacha_core.codec.paper_tree import BITS, codes_of, decode_points
from sacha_core.codec.sections import need

__all__ = ["paper_bits"]


def paper_bits(
    sections: dict[str, Section], logged: dict[str, Section], header: Header
) -> dict[str, Float[np.ndarray, " n"]]:
    """Give the bits of every Gaussian in each section, Gaussians as the decoder gives them; none for an external program's.

    Args:
        sections: of the file.
        logged: the same, each with the account of its decoding.
        header: of the file.
    """
    n = header.n_gaussians
    reader = need(sections, "Geometry").reader()
    _, coder = read_geometry_head(reader)
    if coder != OWN or not n:
        return {}
    code = codes_of(decode_points(reader, n))  # of every row; rows of one code may change places later
    _, point, alike = np.unique(code, return_inverse=True, return_counts=True)
    told = {"Geometry": _box_bits(logged["Geometry"].log or [], code)}
    told |= {
        name: np.sum(section.log, axis=0)
        for name, section in logged.items()
        if name in ("Colour", "Harmonic", "Opacity", "Scale", "Rotation") and section.log
    }
    shared = {name: (np.bincount(point, bits) / alike)[point] for name, bits in told.items()}
    return shared | {"Binding": np.sum(logged["Binding"].log or [np.zeros(n)], axis=0)}


def _box_bits(log: list[Float[np.ndarray, " b"]], code: Int[np.ndarray, " n"]) -> Float[np.ndarray, " n"]:
    """Share out the bits of boxes among their points, box by box of each size."""
    bits = np.zeros(len(code))
    for depth, of_box in enumerate(log):
        _, box, size = np.unique(code >> (BITS - depth), return_inverse=True, return_counts=True)
        bits += (of_box / size)[box]
    return bits
