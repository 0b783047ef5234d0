"""The folder that training writes: a model in GaussianAvatars' layout, and beside it what led there."""

from __future__ import annotations

import json
from dataclasses import asdict, dataclass
from pathlib import Path

from sacha_core.avatar.gaussians import Gaussians
from sacha_core.avatar.motion import Motion
from sacha_core.density.events import Event, write_events
from sacha_core.files import write_aside
from sacha_core.flame.model import HeadReference
from sacha_core.interchange.gaussian_avatars import write_model
from sacha_core.train.options import TrainOptions

__all__ = ["CHECKPOINT", "EVENTS", "SCORES", "WARM_UP_CHECKPOINT", "TrainedModel", "write_outcome", "write_plan"]

CHECKPOINT = "checkpoint.npz"
WARM_UP_CHECKPOINT = "checkpoint_warm_up.npz"
EVENTS = "events.jsonl"
SCORES = "avatar.scores.npz"


@dataclass(frozen=True)
class TrainedModel:
    """What training gives back; all of it also lies in `folder`.

    Args:
        folder: where it was written.
        iteration: iterations trained.
        gaussians: the canonical Gaussians, with sensitivity.
        motion: with fitted parameters at training timesteps.
        events: everything that density control did.
    """

    folder: Path
    iteration: int
    gaussians: Gaussians
    motion: Motion
    events: tuple[Event, ...]


def write_plan(folder: Path, options: TrainOptions, head: HeadReference) -> None:
    """Write options and head before training begins.

    Raises:
        OSError: the folder cannot be made or written.
    """
    for name, record in (("options.json", options.record()), ("head.json", {**asdict(head), "file": None})):
        with write_aside(folder / name) as aside:
            aside.write_text(json.dumps(record, indent=2) + "\n", encoding="utf-8")


def write_outcome(model: TrainedModel) -> None:
    """Write Gaussians, motion and events.

    Raises:
        OSError: the folder cannot be written.
    """
    write_events(model.folder / EVENTS, model.events)
    write_model(model.folder, model.iteration, model.gaussians, model.motion)
