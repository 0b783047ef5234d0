"""How much a bench measures, and on what."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Literal, TypeVar

from sacha_core.avatar.avatar import Avatar
from sacha_core.avatar.gaussians import Gaussians
from sacha_core.flame.model import HeadModel
from sacha_core.interchange.capture import Capture

__all__ = ["Comparison", "Extent", "Preset", "Subject"]

T = TypeVar("T")
Extent = Literal["tiny", "quick", "full"]


@dataclass(frozen=True)
class Subject:
    """An avatar that the user named.

    Args:
        avatar: Gaussians and motion.
        head: what they are bound to.
        path: where from.
        bound: whether the Gaussians belong to the head; else they stand in the world, and the head is none (`train.static.world_head`).
        note: what a reader has to know about it; empty for nothing.
    """

    avatar: Avatar
    head: HeadModel
    path: Path
    bound: bool = True
    note: str = ""


@dataclass(frozen=True)
class Comparison:
    """Avatars to run every codec on.

    Args:
        subjects: the avatars, each with a motion unless it is bound to no head.
        only: names of the codecs; none for all there are.
        require: names of those that must not be missing.
        sheet: where to put a picture of what each codec makes of an avatar; None for none.
        truth: a capture of the avatar's person, whose image stands beside it there; None for none.
        frames: splats that were trained for single frames of the motion, by frame, to be coded as a sequence; of one avatar alone.
    """

    subjects: tuple[Subject, ...]
    only: tuple[str, ...] = ()
    require: tuple[str, ...] = ()
    sheet: Path | None = None
    truth: Capture | None = None
    frames: Mapping[int, Gaussians] = field(default_factory=dict)


@dataclass(frozen=True)
class Preset:
    """One run of a bench.

    Args:
        extent: `tiny` for tests, `quick` for `make bench`, `full` by hand.
        threads: how many threads at most; None for one on each processor.
        subject: an avatar to measure on instead of the made one, where a bench takes one (codec, playback).
        film: a capture to train on, with its head, instead of a made one (train).
        seed: of everything random.
        compared: avatars to compare codecs on (codec).
    """

    extent: Extent = "quick"
    threads: int | None = None
    subject: Subject | None = None
    film: tuple[Capture, HeadModel] | None = None
    seed: int = 0
    compared: Comparison | None = None

    def of(self, tiny: T, quick: T, full: T) -> T:
        """Give what belongs to this extent."""
        return {"tiny": tiny, "quick": quick, "full": full}[self.extent]
