"""The bytes of a `.sacha` file into an avatar.

Source: own.
"""

from __future__ import annotations

import os
from pathlib import Path

import numpy as np

from sacha_core.avatar.avatar import Avatar
from sacha_core.avatar.gaussians import Gaussians
from sacha_core.avatar.motion import Motion
from sacha_core.codec.colour import decode_colour
from sacha_core.codec.container import Section, parse_sections
from sacha_core.codec.counts import decode_counts
from sacha_core.codec.harmonics import decode_harmonics
from sacha_core.codec.head import decode_head
from sacha_core.codec.header import Header
from sacha_core.codec.motion import decode_motion
from sacha_core.codec.opacity import decode_opacity
from sacha_core.codec.order import Layout
from sacha_core.codec.position import decode_position
from sacha_core.codec.rotation import decode_rotation
from sacha_core.codec.scale import classes_of, decode_scale
from sacha_core.codec.static import decode_static
from sacha_core.errors import FormatError, HeadError
from sacha_core.flame.model import HeadModel

__all__ = ["Source", "decode", "embedded_head", "read_header", "read_source", "sections_of"]

Source = bytes | bytearray | memoryview | str | os.PathLike[str]
KNOWN = ("Header", "Static", "Counts", "Opacity", "Scale", "Rotation", "Position", "Colour", "Harmonic", "Motion")


def read_source(source: Source) -> bytes:
    """Give the bytes that `source` is, or those of the file that it names."""
    if isinstance(source, bytes | bytearray | memoryview):
        return bytes(source)
    return Path(source).read_bytes()


def sections_of(data: bytes) -> tuple[tuple[int, int], dict[str, Section]]:
    """Split a file; refuse sections that must be understood and are not known.

    Raises:
        FormatError: the container is damaged, or the file needs a newer decoder.
    """
    version, sections = parse_sections(data)
    for name, section in sections.items():
        if name[0].isupper() and name not in KNOWN:
            raise FormatError(
                f"section {name!r} must be understood to decode this file; a newer decoder is needed", section.offset
            )
    return version, sections


def need(sections: dict[str, Section], name: str) -> Section:
    """Give a section that has to be there."""
    if name not in sections:
        raise FormatError(f"section {name!r} is missing")
    return sections[name]


def read_header(data: bytes, sections: dict[str, Section]) -> Header:
    """Read the header of a file that was split."""
    return Header.unpack(need(sections, "Header").reader(), len(data))


def decode(source: Source, *, head: HeadModel | None = None) -> Avatar:
    """Decompress an avatar.

    Gaussians come sorted by triangle, in a triangle by falling opacity, the axes of each by falling scale.

    Args:
        source: the bytes of a `.sacha` file, or its path.
        head: the head model that it should be bound to; only checked: decoding itself needs no head.

    Returns:
        The avatar, valid and finite; where its head is, `sacha_core.flame.shelf` or `embedded_head` tell.

    Raises:
        FormatError: the file is damaged, cut, of a newer version, or no `.sacha` file at all.
        HeadError: `head` is another one.
        OSError: the file cannot be read.
    """
    data = read_source(source)
    _, sections = sections_of(data)
    header = read_header(data, sections)
    if head is not None and head.reference.sha256 != header.head.sha256:
        raise HeadError(f"the file is bound to head {header.head.name!r}, another one, {head.name!r}, was given")
    gaussians = decode_gaussians(sections, header)
    gaussians.validate(header.head.n_faces)
    motion = read_motion(sections, header)
    return Avatar(gaussians, header.head, motion, header.scheme)


def decode_gaussians(sections: dict[str, Section], header: Header) -> Gaussians:
    """Decode all attributes, each after those that its steps follow."""
    counts = decode_counts(need(sections, "Counts").reader(), header.head.n_faces, header.n_gaussians)
    layout = Layout(counts)
    index, table = decode_opacity(need(sections, "Opacity").reader(), layout)
    transparency = table.transparency[index]
    log_scale, scale = decode_scale(need(sections, "Scale").reader(), layout, transparency)
    classes = classes_of(transparency, scale)
    n, k = header.n_gaussians, header.n_harmonics
    sh_rest = np.zeros((n, 0, 3), np.float32)
    if k:
        sh_rest = decode_harmonics(need(sections, "Harmonic").reader(), n, k, classes)
    return Gaussians(
        position=decode_position(need(sections, "Position").reader(), layout, classes),
        log_scale=log_scale,
        quaternion=decode_rotation(need(sections, "Rotation").reader(), layout, classes),
        opacity_logit=table.logit[index],
        sh_dc=decode_colour(need(sections, "Colour").reader(), layout, classes),
        sh_rest=sh_rest,
        binding=layout.binding,
    )


def read_motion(sections: dict[str, Section], header: Header) -> Motion | None:
    """Decode the motion, or give None where the file has none."""
    if not header.has_motion:
        return None
    shape, static_offset = decode_static(need(sections, "Static").reader(), header.n_shape, header.n_offsets)
    dynamic = need(sections, "Motion").reader()
    motion = decode_motion(dynamic, header.n_frames, header.n_expression, shape, static_offset)
    motion.validate()
    return motion


def embedded_head(source: Source) -> HeadModel | None:
    """Give the head model inside a file, or None where it has none.

    Raises:
        FormatError: the file is damaged.
        HeadError: the head inside is not the one that the avatar is bound to.
    """
    data = read_source(source)
    _, sections = sections_of(data)
    header = read_header(data, sections)
    if "head" not in sections:
        return None
    head = decode_head(sections["head"].reader())
    if head.reference.sha256 != header.head.sha256:
        raise HeadError(f"the head inside the file is not {header.head.name!r}, which its avatar is bound to")
    return head
