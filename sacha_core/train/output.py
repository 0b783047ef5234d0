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
from sacha_core.interchange.gaussian_avatars import PARAMETERS_NAME, PLY_NAME, model_iterations, write_model
from sacha_core.train.faults import Faults
from sacha_core.train.options import TrainOptions

__all__ = [
    "CHECKPOINT",
    "EVENTS",
    "SCORES",
    "WARM_UP_CHECKPOINT",
    "TrainedModel",
    "discard",
    "write_outcome",
    "write_plan",
]

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
        faults: steps that were not taken.
        device: where it was trained.
    """

    folder: Path
    iteration: int
    gaussians: Gaussians
    motion: Motion
    events: tuple[Event, ...]
    faults: Faults
    device: str


def discard(folder: Path) -> None:
    """Remove what an earlier run left in a folder and the next would not overwrite, so that nobody takes it for the next one's.

    The checkpoint at the end of warm-up stays: it says itself whose it is, and other runs may begin with it.

    Raises:
        OSError: a file cannot be removed.
    """
    iterations = model_iterations(folder).values()
    models = [place / name for place in iterations for name in (PLY_NAME, PARAMETERS_NAME)]
    for path in (*(folder / name for name in (CHECKPOINT, EVENTS, SCORES)), *models):
        path.unlink(missing_ok=True)
    for place in iterations:
        if not any(place.iterdir()):
            place.rmdir()


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
