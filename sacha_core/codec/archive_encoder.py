"""An avatar into a `.sacha` file that keeps every bit, checked after writing.

Source: own.
"""

from __future__ import annotations

from dataclasses import fields, replace

import numpy as np

from sacha_core.avatar.avatar import Avatar
from sacha_core.codec.archive import encode_archive_motion, encode_archive_sections
from sacha_core.codec.container import Section, pack_sections
from sacha_core.codec.decoder import decode
from sacha_core.codec.encoder import check_head, check_offsets, pad
from sacha_core.codec.head import encode_head
from sacha_core.codec.header import ARCHIVE, Header
from sacha_core.errors import FormatError
from sacha_core.flame.model import HeadModel

__all__ = ["difference", "encode_archive"]


def encode_archive(avatar: Avatar, *, head: HeadModel | None = None, embed_head: bool = False) -> bytes:
    """Compress an avatar without losing a bit: all attributes in their order, sensitivity logits and motion included.

    Args:
        avatar: what to compress.
        head: the head model that it is bound to; only needed to embed it, checked where given.
        embed_head: add the head model itself to the file.

    Returns:
        The bytes of the file. They were decoded and compared with what was given.

    Raises:
        FormatError: the avatar is not finite, not of float32 numbers, or bound outside its head.
        HeadError: `head` is not the one that the avatar names, or is missing where it shall be embedded.
    """
    check_head(avatar, head, embed_head)
    gaussians, motion = avatar.gaussians, avatar.motion
    gaussians.validate(avatar.head.n_faces)
    header = Header(
        level=0,
        n_gaussians=len(gaussians),
        sh_degree=gaussians.sh_degree,
        head=avatar.head,
        scheme=avatar.scheme,
        profile=ARCHIVE,
        has_sensitivity=gaussians.sensitivity_logit is not None,
    )
    sections = encode_archive_sections(gaussians)
    if motion is not None:
        motion.validate()
        header = header.telling(motion)
        check_offsets(header)
        sections += encode_archive_motion(motion)
    if embed_head and head is not None:
        sections.append(Section("head", encode_head(head)))
    data = pack_sections(pad([Section("Header", header.pack()), *sections], header))
    changed = difference(avatar, decode(data, head=head))
    if changed:
        raise FormatError(f"the archive gives back another {changed} than it was given")
    return data


def difference(given: Avatar, back: Avatar) -> str:
    """Name the first part of an avatar that differs from another one's by any bit; nothing where none does."""
    for part in ("gaussians", "motion"):
        ours, theirs = getattr(given, part), getattr(back, part)
        if (ours is None) != (theirs is None):
            return part
        for field in fields(ours) if ours is not None else ():
            a, b = getattr(ours, field.name), getattr(theirs, field.name)
            if isinstance(a, np.ndarray) and isinstance(b, np.ndarray):
                same = a.shape == b.shape and a.astype(b.dtype).tobytes() == b.tobytes()
            else:
                same = a is b or a == b
            if not same:
                return field.name
    return "" if replace(given, gaussians=back.gaussians, motion=back.motion) == back else "head or scheme"
