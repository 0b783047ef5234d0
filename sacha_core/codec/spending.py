r"""What each triangle of the head takes of a file: the bytes that describe Gaussians, told apart by the decoder's own account.

While it decodes, every integer's cost is put down: $-\log_2$ of the share that its token has of the coder's intervals, and its raw bits. An
integer belongs to the Gaussian that it describes, the Gaussian to its triangle; a number of `Counts` belongs to its place. What serves all
of them alike - header and section table, tables of the coder, rules, rounding to whole words, and sections of which nothing finer is known
(bindings of an archive, what an external program coded) - is shared out evenly among the Gaussians. So the triangles' bytes add up to
the file's Gaussian bytes, those of `inspect`, up to rounding in float64.

Source: own.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from dataclasses import dataclass, replace

import numpy as np
from jaxtyping import Float, Int

from sacha_core.codec.anchors import triangle_of
from sacha_core.codec.archive import DEGREES, WIDTHS, decode_binding
from sacha_core.codec.container import Section
from sacha_core.codec.counts import decode_layout
from sacha_core.codec.decoder import Source, find_template, read_gaussians, read_header, read_source
from sacha_core.codec.float_column import CONSTANT, LISTED, Column, passes_of
from sacha_core.codec.header import ARCHIVE, LOSSY, PAPER, Header
from sacha_core.codec.lossless import LAYOUT
from sacha_core.codec.order import Layout, passes_over
from sacha_core.codec.reading import ByteReader
from sacha_core.codec.sections import need, sections_of
from sacha_core.codec.spending_paper import paper_bits
from sacha_core.codec.template import Template
from sacha_core.flame.model import HeadModel

__all__ = ["Spending", "spent_bytes"]

ELSEWHERE = ("Static", "Motion", "head")  # sections that do not describe Gaussians
COLOURS = 3
Bits = Float[np.ndarray, " m"]


@dataclass(frozen=True)
class Spending:
    """Where the bytes of a file's Gaussians go.

    Args:
        triangles: (f,) bytes of each triangle, all sections together.
        sections: by name, (f,) bytes of each triangle; "(table)" is the section table. They add up to `triangles`.
    """

    triangles: Float[np.ndarray, " f"]
    sections: dict[str, Float[np.ndarray, " f"]]


def spent_bytes(source: Source, *, head: HeadModel | None = None) -> Spending:
    """Decode a file and tell which triangles its bytes were spent on.

    Args:
        source: as of `decode`.
        head: likewise.

    Raises:
        FormatError, HeadError, OptionError, OSError: as `decode` does.
    """
    data = read_source(source)
    _, sections = sections_of(data)
    header = read_header(data, sections)
    logged = {name: replace(section, log=[]) for name, section in sections.items()}
    template = find_template(sections, header, head)
    gaussians = read_gaussians(logged, header, template)
    binding, n_faces = gaussians.binding, header.head.n_faces
    told = _told_bits(sections, logged, header, template, binding)
    sizes = {name: len(section.data) for name, section in sections.items() if name not in ELSEWHERE}
    sizes["(table)"] = len(data) - sum(len(section.data) for section in sections.values())
    nothing = np.zeros(n_faces)
    spent = {name: _filled(told.get(name, nothing) / 8, n_bytes, binding) for name, n_bytes in sizes.items()}
    return Spending(sum(spent.values(), nothing), spent)


def _filled(told: Float[np.ndarray, " f"], n_bytes: int, binding: Int[np.ndarray, " n"]) -> Float[np.ndarray, " f"]:
    """Share out evenly among the Gaussians what no triangle accounts for; among the triangles where there are none."""
    n_faces = len(told)
    holders = np.bincount(binding, minlength=n_faces) if len(binding) else np.ones(n_faces)
    filled: np.ndarray = told + (n_bytes - told.sum()) * (holders / max(float(holders.sum()), 1.0))
    return filled


def _told_bits(
    sections: dict[str, Section],
    logged: dict[str, Section],
    header: Header,
    template: Template,
    binding: Int[np.ndarray, " n"],
) -> dict[str, Float[np.ndarray, " f"]]:
    """Give the bits of every triangle in the sections whose account tells triangles apart."""
    n, n_faces = header.n_gaussians, header.head.n_faces
    if header.profile == LOSSY:
        layout = decode_layout(need(sections, "Counts").reader(), template, n)
        rows = {name: _rows_of(layout, section) for name, section in logged.items() if name in _PREDICTED}
        told = {
            name: np.bincount(layout.binding[rows[name]], _joined(logged[name].log), n_faces)
            for name in rows
            if len(rows[name])
        }
        return {"Counts": _count_bits(logged["Counts"], template, layout, n_faces), **told}
    if header.profile == ARCHIVE and n:
        _, order = decode_binding(need(sections, "Binding").reader(), n, n_faces)
        bits = {name: _exact_bits(section, n, _widths(name, header)) for name, section in logged.items()}
        return {name: np.bincount(binding[order], told, n_faces) for name, told in bits.items() if told is not None}
    if header.profile == PAPER:
        return {name: np.bincount(binding, of, n_faces) for name, of in paper_bits(sections, logged, header).items()}
    return {}


_PREDICTED = ("Hidden", "Opacity", "Scale", "Rotation", "Position", "Colour", "Harmonic")


def _joined(log: Iterable[Bits] | None) -> Bits:
    return np.concatenate([np.zeros(0), *(log or ())])


def _rows_of(layout: Layout, section: Section) -> Int[np.ndarray, " m"]:
    """Give the Gaussian of every integer of a section of the lossy profile, in the order in which they were read."""
    log = section.log or []
    rows: list[Int[np.ndarray, " p"]] = []
    left = iter(log)
    n_reads = len(log) // max(
        len(layout.passes), 1
    )  # a pass: components one after another, or all of a Gaussian together
    for step in layout.passes:
        rows += [np.repeat(step.rows, len(next(left)) // len(step.rows)) for _ in range(n_reads)]
    return np.concatenate([np.zeros(0, np.int64), *rows])


def _count_bits(section: Section, template: Template, layout: Layout, n_faces: int) -> Float[np.ndarray, " f"]:
    """Give the bits of the numbers of Gaussians at every place, by its triangle; those of vertices without one count for nobody."""
    by_vertex = layout.anchors is not None
    triangle = triangle_of(template) if by_vertex else template.order
    places = np.concatenate([np.zeros(0, np.int64), *(step.rows for step in passes_over(template, by_vertex))])
    bits, owner = _joined(section.log), triangle[places]
    return np.bincount(owner[owner >= 0], bits[owner >= 0], n_faces)


def _widths(name: str, header: Header) -> list[int]:
    """Give the columns of every array of a section of an archive; none for what holds no arrays of Gaussians."""
    if name == "Harmonic":
        return [COLOURS * (b - a) for a, b in DEGREES[: header.sh_degree]]
    return [WIDTHS[name]] if name in WIDTHS else []


def _exact_bits(section: Section, n: int, widths: list[int]) -> Float[np.ndarray, " n"] | None:
    """Give the bits of every row of a section of exact numbers, in the order of coding; None for other sections."""
    if not widths:
        return None
    told = np.zeros(n)
    left = iter(section.log or [])
    reader = section.reader()
    for width in widths:
        part = reader.part(*reader.unpack("I")) if section.name == "Harmonic" else reader
        for column in _columns(part, width, n):
            _add_column(told, column, left)
    return told


def _columns(reader: ByteReader, width: int, n: int) -> list[Column]:
    """Read how the columns of an array are told."""
    _, head_bytes, _ = reader.unpack(LAYOUT)
    heads = reader.part(head_bytes)
    return [Column.unpack(heads, place, n) for place in range(width)]


def _add_column(told: Float[np.ndarray, " n"], column: Column, log: Iterator[Bits]) -> None:
    """Add the bits of a column to those of its rows; a list of different numbers serves all rows alike."""
    if column.mode == CONSTANT:
        return

    if column.mode == LISTED:
        told += (float(next(log).sum()) + float(next(log).sum())) / len(told)
    for rows, _, _ in passes_of(len(told)):
        told[rows] += next(log)
        if column.mode != LISTED:
            following, noise = next(log), next(log)
            told[rows] += noise
            whole = len(following) == len(rows)  # else some numbers are 0, which nothing follows
            told[rows] += following if whole else following.sum() / len(rows)
