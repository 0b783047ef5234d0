"""The bytes of a `.sacha` file into an avatar.

Source: own.
"""

from __future__ import annotations

import os
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from sacha_core.avatar.avatar import Avatar
from sacha_core.avatar.gaussians import Gaussians
from sacha_core.codec.archive import decode_archive, decode_archive_motion
from sacha_core.codec.colour import decode_colour
from sacha_core.codec.container import MAGIC, Section
from sacha_core.codec.counts import decode_layout
from sacha_core.codec.harmonics import decode_harmonics
from sacha_core.codec.head import decode_head
from sacha_core.codec.header import ARCHIVE, PAPER, Header
from sacha_core.codec.hidden import decode_hidden
from sacha_core.codec.motion import MotionReader
from sacha_core.codec.opacity import decode_opacity
from sacha_core.codec.paper import decode_paper
from sacha_core.codec.paper_motion import decode_paper_motion
from sacha_core.codec.position import decode_position
from sacha_core.codec.rotation import decode_rotation
from sacha_core.codec.scale import classes_of, decode_scale, known_classes
from sacha_core.codec.sections import need, sections_of
from sacha_core.codec.static import decode_static
from sacha_core.codec.template import Template, template_of, unknown_template
from sacha_core.codec.whole_motion import WholeMotion
from sacha_core.errors import HeadError, TopologyError
from sacha_core.flame.model import HeadModel, HeadReference

__all__ = [
    "AvatarStream",
    "Source",
    "decode",
    "embedded_head",
    "open_stream",
    "read_header",
    "read_source",
    "sections_of",
]

Source = bytes | bytearray | memoryview | str | os.PathLike[str]


def read_source(source: Source) -> bytes:
    """Give the bytes that `source` is, or those of the file that it names."""
    if isinstance(source, bytes | bytearray | memoryview):
        return bytes(source)
    with Path(source).open("rb") as file:
        start = file.read(len(MAGIC))
        return start + file.read() if start == MAGIC else start  # what is no such file may have no end


def read_header(data: bytes, sections: dict[str, Section]) -> Header:
    """Read the header of a file that was split."""
    return Header.unpack(need(sections, "Header").reader(), len(data))


@dataclass(frozen=True)
class AvatarStream:
    """An avatar whose motion is still to be decoded, group by group.

    Args:
        gaussians: the canonical Gaussians.
        head: which head model they are bound to.
        motion: gives any group alone; None for an avatar without a motion.
        scheme: name of the region scheme that was used in training.
    """

    gaussians: Gaussians
    head: HeadReference
    motion: MotionReader | WholeMotion | None
    scheme: str


def decode(source: Source, *, head: HeadModel | None = None) -> Avatar:
    """Decompress an avatar.

    Gaussians come triangle by triangle, in a triangle by falling opacity, the axes of each by falling scale; from an archive as they were.

    Args:
        source: the bytes of a `.sacha` file, or its path.
        head: the head model that it is bound to. A file that was made with one (`Header.needs_head`) needs it: where it is not given, the
            one inside the file is taken, else one that was used before (`sacha_core.flame.shelf`).

    Returns:
        The avatar, valid and finite.

    Raises:
        FormatError: the file is damaged, cut, of a newer version, or no `.sacha` file at all.
        HeadError: `head` is another one, or the head is needed and not to be found; the message names it.
        OptionError: the file was coded by an external program (paper profile), which SACHA_TMC3 does not name.
        OSError: the file cannot be read.
    """
    stream = open_stream(source, head=head)
    return Avatar(stream.gaussians, stream.head, None if stream.motion is None else stream.motion.all(), stream.scheme)


def open_stream(source: Source, *, head: HeadModel | None = None) -> AvatarStream:
    """Decompress an avatar but for the frames of its motion, so that the time does not grow with their number.

    Args:
        source: as of `decode`.
        head: likewise.

    Raises:
        FormatError, HeadError, OSError: as `decode` does, but for damage in the groups of the motion, which shows when they are decoded.
    """
    data = read_source(source)
    _, sections = sections_of(data)
    header = read_header(data, sections)
    template = find_template(sections, header, head)
    gaussians = read_gaussians(sections, header, template)
    gaussians.validate(header.head.n_faces)
    return AvatarStream(gaussians, header.head, read_motion(sections, header, template), header.scheme)


def read_gaussians(sections: dict[str, Section], header: Header, template: Template) -> Gaussians:
    """Decode all attributes by the file's profile."""
    if header.profile == ARCHIVE:
        return decode_archive(sections, header)
    if header.profile == PAPER:
        return decode_paper(sections, header)
    return decode_gaussians(sections, header, template)


def find_template(sections: dict[str, Section], header: Header, head: HeadModel | None) -> Template:
    """Give what is known of the head: from the one given, the one inside, or one used before.

    Raises:
        HeadError: it is needed and not to be found, or is another one.
    """
    if not header.needs_head and head is None:
        return unknown_template(header.head.n_faces)
    if head is None:
        head = head_inside(sections, header)
    if head is None:
        from sacha_core.flame.shelf import find_head  # noqa: PLC0415  # may have to make a synthetic head

        head = find_head(header.head, None, None)
    if head.reference.sha256 != header.head.sha256 or head.n_faces != header.head.n_faces:
        raise TopologyError(
            f"the file is bound to head {header.head.name!r} (SHA-256 {header.head.sha256[:12]}...),"
            f" but {head.name!r} ({head.reference.sha256[:12]}...) was given"
        )
    return template_of(head.v_template, head.faces) if header.needs_head else unknown_template(head.n_faces)


def decode_gaussians(sections: dict[str, Section], header: Header, template: Template) -> Gaussians:
    """Decode all attributes, each after those that its steps follow."""
    layout = decode_layout(need(sections, "Counts").reader(), template, header.n_gaussians)
    hidden = decode_hidden(need(sections, "Hidden").reader(), layout)
    index, table = decode_opacity(need(sections, "Opacity").reader(), layout, hidden)
    known = known_classes(table.transparency[index], hidden)
    log_scale, scale = decode_scale(need(sections, "Scale").reader(), layout, known)
    classes = classes_of(known, scale)
    k = header.n_harmonics
    sh_rest = np.zeros((header.n_gaussians, 0, 3), np.float32)
    if k:
        sh_rest = decode_harmonics(need(sections, "Harmonic").reader(), layout, k, classes)
    return Gaussians(
        position=decode_position(need(sections, "Position").reader(), layout, classes),
        log_scale=log_scale,
        quaternion=decode_rotation(need(sections, "Rotation").reader(), layout, classes),
        opacity_logit=table.logit[index],
        sh_dc=decode_colour(need(sections, "Colour").reader(), layout, classes),
        sh_rest=sh_rest,
        binding=layout.binding,
    )


def read_motion(sections: dict[str, Section], header: Header, template: Template) -> MotionReader | WholeMotion | None:
    """Read what the motion says once and where its groups lie, or give None where the file has none."""
    if not header.has_motion:
        return None
    if header.profile == ARCHIVE:
        return WholeMotion(decode_archive_motion(sections, header))
    if header.profile == PAPER:
        return WholeMotion(decode_paper_motion(sections, header))
    shape, static_offset = decode_static(need(sections, "Static").reader(), header.n_shape, header.n_offsets, template)
    dynamic = need(sections, "Motion").reader()
    motion = MotionReader(dynamic, header.n_frames, header.n_expression, shape, static_offset)
    motion.still().validate()
    return motion


def embedded_head(source: Source) -> HeadModel | None:
    """Give the head model inside a file, or None where it has none.

    Raises:
        FormatError: the file is damaged.
        HeadError: the head inside is not the one that the avatar is bound to.
    """
    data = read_source(source)
    _, sections = sections_of(data)
    return head_inside(sections, read_header(data, sections))


def head_inside(sections: dict[str, Section], header: Header) -> HeadModel | None:
    """Give the embedded head, or None where there is none."""
    if "head" not in sections:
        return None
    head = decode_head(sections["head"].reader())
    if head.reference.sha256 != header.head.sha256:
        raise HeadError(f"the head inside the file is not {header.head.name!r}, which its avatar is bound to")
    return head
