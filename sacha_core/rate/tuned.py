"""Encoding with fine-tuning: what is worth its bits, fitted through the quantiser.

Source: own.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

from sacha_core.avatar.avatar import Avatar
from sacha_core.codec import encode
from sacha_core.codec.levels import Level
from sacha_core.flame.model import HeadModel
from sacha_core.progress import Report, silent
from sacha_core.rate.encoding import Prepared, RenderingEncoder
from sacha_core.rate.finetune import TuningOptions, finetune
from sacha_core.rate.pictures import own_pictures
from sacha_core.train.views import Target

__all__ = ["encode_tuned", "tuned"]


def encode_tuned(
    avatar: Avatar,
    level: int | Level = 2,
    *,
    head: HeadModel,
    steps: Sequence[Sequence[Target]] | None = None,
    embed_head: bool = False,
    options: TuningOptions | None = None,
    report: Report = silent,
) -> bytes:
    """Compress an avatar as `encode_by_rendering` does, after fitting it to pictures as it will look when it is decoded.

    Args:
        avatar: what to compress.
        level: 1 (smallest) to 4 (best), or a `Level` of one's own.
        head: the head model that it is bound to.
        steps: pictures to look like, with timesteps of the avatar's motion, as `pictures.CaptureSteps` gives them; None for pictures of
            the avatar itself before compression.
        embed_head: add the head model itself to the file.
        options: how long, how fast and towards what.
        report: told about progress.

    Raises:
        FormatError, HeadError, OptionError: as `sacha_core.encode` does.
        DatasetError: a picture cannot be decoded.
        GeometryError: a frame of the motion makes a triangle degenerate.
    """
    left = RenderingEncoder(avatar, head).prepare(level)
    found = tuned(avatar, left, head, steps, options, report)
    return encode(found, left.level, head=head, embed_head=embed_head, importance=left.importance)


def tuned(
    avatar: Avatar,
    left: Prepared,
    head: HeadModel,
    steps: Sequence[Sequence[Target]] | None = None,
    options: TuningOptions | None = None,
    report: Report = silent,
) -> Avatar:
    """Fit what is left of an avatar.

    Args:
        avatar: all of it, which is what its own pictures show.
        left: what is to be encoded.
        head: see `encode_tuned`.
        steps: likewise.
        options: likewise.
        report: likewise.
    """
    posed = left.avatar
    if steps is None:
        motion, steps = own_pictures(avatar, head)
        posed = replace(posed, motion=motion)
    gaussians = finetune(posed, head, left.level, steps, left.importance, options, report)
    return replace(left.avatar, gaussians=gaussians)
