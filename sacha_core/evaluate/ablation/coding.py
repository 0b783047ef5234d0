"""A trained avatar as it is, and as each level of the codec gives it back."""

from __future__ import annotations

import time
from collections.abc import Sequence
from dataclasses import dataclass, fields
from pathlib import Path

import numpy as np

from sacha_core.avatar.avatar import Avatar
from sacha_core.avatar.gaussians import PLY_BYTES_PER_GAUSSIAN
from sacha_core.avatar.motion import Motion
from sacha_core.codec import decode, encode, inspect
from sacha_core.evaluate.ablation.plan import level_file
from sacha_core.evaluate.ablation.result import UNCOMPRESSED, SizeBytes
from sacha_core.files import write_aside
from sacha_core.flame.model import HeadModel

__all__ = ["Coded", "code"]


@dataclass(frozen=True)
class Coded:
    """An avatar that came out of the codec, or never went in.

    Args:
        level: of the codec, or `UNCOMPRESSED`.
        avatar: what one would play.
        n: Gaussians in it.
        bytes: what it takes.
        encode_s: seconds that encoding took.
        decode_s: seconds that decoding took.
    """

    level: int
    avatar: Avatar
    n: int
    bytes: SizeBytes
    encode_s: float
    decode_s: float


def code(avatar: Avatar, head: HeadModel, levels: Sequence[int], folder: Path) -> tuple[Coded, ...]:
    """Give an avatar at some levels; nothing is left out by the codec, whose own sparing would hide what density control spares.

    Args:
        avatar: Gaussians and motion.
        head: that it is bound to.
        levels: `UNCOMPRESSED` for the avatar itself.
        folder: where the files go.

    Raises:
        SachaError: the avatar holds numbers that the codec does not take.
        OSError: a file cannot be written.
    """
    return tuple(_raw(avatar) if level == UNCOMPRESSED else _coded(avatar, head, level, folder) for level in levels)


def _raw(avatar: Avatar) -> Coded:
    n = len(avatar.gaussians)
    motion = 0 if avatar.motion is None else float32_bytes(avatar.motion)
    size = SizeBytes(PLY_BYTES_PER_GAUSSIAN * n, motion, PLY_BYTES_PER_GAUSSIAN * n + motion)
    return Coded(UNCOMPRESSED, avatar, n, size, 0.0, 0.0)


def _coded(avatar: Avatar, head: HeadModel, level: int, folder: Path) -> Coded:
    begun_s = time.perf_counter()
    data = encode(avatar, level, head=head, drop_invisible=False)
    encoded_s = time.perf_counter()
    decoded = decode(data, head=head)
    decoded_s = time.perf_counter()
    with write_aside(level_file(folder, level)) as aside:
        aside.write_bytes(data)
    found = inspect(data)
    size = SizeBytes(found.gaussian_bytes, found.motion_bytes, found.gaussian_bytes + found.motion_bytes)
    return Coded(level, decoded, found.n_gaussians, size, encoded_s - begun_s, decoded_s - encoded_s)


def float32_bytes(motion: Motion) -> int:
    """Give the bytes that the numbers of a motion take as float32."""
    arrays = [getattr(motion, field.name) for field in fields(motion)]
    return sum(4 * array.size for array in arrays if isinstance(array, np.ndarray))
