"""Attributes that have their default cost the file next to nothing. Oracle: the same avatar without them."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from sacha_core.avatar.avatar import Avatar
from sacha_core.bench.scenes import made_avatar
from sacha_core.codec import decode, encode, inspect
from sacha_core.flame.model import HeadModel

N_FRAMES = 60
FIXED_BYTES = (
    64  # rules and tables of a section, and its place in the file: 33 and 16 bytes of harmonics, at every level
)
BEST = 4  # the level that spends most on harmonics: 12,035 bytes here


@pytest.fixture(scope="module")
def made() -> tuple[Avatar, HeadModel]:
    return made_avatar(2000, 3, N_FRAMES)


def size_of(made: tuple[Avatar, HeadModel], section: str | None = None, level: int = 2, **changes: object) -> int:
    avatar, head = made
    found = inspect(encode(replace(avatar, **changes), level, head=head))
    return found.total_bytes if section is None else {s.name: s.n_bytes for s in found.sections}.get(section, 0)


def test_harmonics_that_are_zero(made: tuple[Avatar, HeadModel]) -> None:
    avatar, head = made
    zero = replace(avatar.gaussians, sh_rest=np.zeros_like(avatar.gaussians.sh_rest))
    absent = replace(avatar.gaussians, sh_rest=avatar.gaussians.sh_rest[:, :0])
    for level in range(1, BEST + 1):
        spent = size_of(made, level=level, gaussians=zero) - size_of(made, level=level, gaussians=absent)
        assert spent < FIXED_BYTES, level
        assert not decode(encode(replace(avatar, gaussians=zero), level, head=head), head=head).gaussians.sh_rest.any()
    assert size_of(made, "Harmonic", BEST) > 100 * FIXED_BYTES


def test_sensitivity(made: tuple[Avatar, HeadModel]) -> None:
    """It belongs to training; a file has no trace of it."""
    avatar, head = made
    logits = np.random.default_rng(0).normal(size=len(avatar.gaussians)).astype(np.float32)
    learned = replace(avatar.gaussians, sensitivity_logit=logits)
    assert encode(replace(avatar, gaussians=learned), head=head) == encode(avatar, head=head)


def test_vertex_offsets(made: tuple[Avatar, HeadModel]) -> None:
    avatar, head = made
    assert avatar.motion is not None
    zero = replace(avatar.motion, static_offset=np.zeros((head.n_vertices, 3), np.float32))
    assert size_of(made, motion=zero) == size_of(made)


def test_motion_that_rests(made: tuple[Avatar, HeadModel]) -> None:
    """Parameters that no frame uses, or that never change, cost less than a byte a frame, all of them together."""
    avatar, _ = made
    assert avatar.motion is not None
    moving = size_of(made, "Motion")
    dynamic = ("expression", "rotation", "neck", "jaw", "eyes", "translation")
    still = {name: np.repeat(getattr(avatar.motion, name)[:1], N_FRAMES, axis=0) for name in dynamic}
    unused = {name: np.zeros_like(value) for name, value in still.items()}
    for name, rest in (("still", still), ("unused", unused)):
        assert (
            size_of(made, "Motion", motion=replace(avatar.motion, **rest)) < N_FRAMES + FIXED_BYTES / 2 < moving / 5
        ), name
    assert size_of(made, "Motion", motion=None) == size_of(made, "Static", motion=None) == 0
