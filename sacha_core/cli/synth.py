"""`sacha synth`: a capture made of nothing but code, or of an avatar that somebody has already."""

from __future__ import annotations

import re
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import tyro

from sacha_core.cli.common import Common, FileOption, HeadSource, MaybePath, MaybeText
from sacha_core.cli.console import Console
from sacha_core.errors import HeadError, OptionError

if TYPE_CHECKING:
    from sacha_core.flame.model import HeadModel
    from sacha_core.synthesis.options import SynthOptions

__all__ = ["OUTPUT_FOLDERS", "Options", "run"]

OUTPUT_FOLDERS = ("out",)


@dataclass(frozen=True)
class Tracking:
    """Errors of a pretended tracker on the parameters that are written; the images show the truth."""

    expression_noise: float = 0.0
    """Standard deviation on the expression coefficients."""

    pose_noise: Annotated[float, tyro.conf.arg(metavar="RADIANS")] = 0.0
    """On the joints' rotations."""

    translation_noise: Annotated[float, tyro.conf.arg(metavar="METRES")] = 0.0
    """On the translation."""


@dataclass(frozen=True)
class Performer:
    """An avatar to film instead of the synthetic head: training on its pictures distils it."""

    avatar: Annotated[MaybePath, tyro.conf.arg(metavar="AVATAR", help_behavior_hint="")] = None
    """A PLY of bound Gaussians (with --head), a model folder, or a .sacha file."""

    motion: FileOption = None
    """Motion (.npz: FLAME parameters, or weights of blend shapes) to cut the sequences out of; by default one made by seed."""

    masks: FileOption = None
    """Vertex masks (FLAME_masks.npz or .pkl), for a head that brings none; training needs them to tell regions apart."""


@dataclass(frozen=True)
class Options:
    """Make a multi-view capture of the synthetic head or of an avatar, in the layout of GaussianAvatars and NeRSemble.

    Sixteen cameras, several sequences of expression and head motion, white background, FLAME parameters for each timestep; camera 8 and the
    last sequence are held out. The same command again continues where it was interrupted.

    sacha synth out/data

    sacha synth out/data --avatar AVATAR.ply --head RIG.npz --masks FLAME_masks.npz --width 550 --height 802
    """

    out: Annotated[Path, tyro.conf.Positional, tyro.conf.arg(metavar="FOLDER")]
    """Where the capture goes."""

    width: Annotated[int, tyro.conf.arg(metavar="PIXELS")] = 275
    """Image width."""

    height: Annotated[int, tyro.conf.arg(metavar="PIXELS")] = 401
    """Image height."""

    timesteps: Annotated[int, tyro.conf.arg(metavar="N")] = 13
    """How many each sequence to train on has."""

    test_timesteps: Annotated[int, tyro.conf.arg(metavar="N")] = 10
    """How many the held-out sequence has."""

    sequences: Annotated[tuple[str, ...], tyro.conf.arg(metavar="NAME...")] = ("EMO-1", "EXP-2", "EXP-3", "EXP-5")
    """Sequences to train on."""

    test_sequence: Annotated[str, tyro.conf.arg(metavar="NAME")] = "FREE"
    """The sequence that is held out."""

    cameras: Annotated[tuple[int, ...], tyro.conf.arg(metavar="INDEX...", help_behavior_hint="(default: all 16)")] = ()
    """Which cameras of the rig; 8 must be among them."""

    head: Annotated[MaybeText, tyro.conf.arg(metavar="HEAD", help_behavior_hint="")] = None
    """Who performs: "synthetic" (the default), "synthetic:small", or one of these with a seed ("synthetic:full:3") for another person. With
    --avatar the head that it is bound to: a head model or rig (.npz), or a FLAME pickle."""

    seed: int = 0
    """Of appearance and motion."""

    supersample: Annotated[int, tyro.conf.arg(metavar="N")] = 2
    """Samples along each axis of a pixel."""

    performer: Performer = field(default_factory=Performer)
    tracking: Tracking = field(default_factory=Tracking)
    common: Common = field(default_factory=Common)


def run(options: Options, console: Console) -> dict[str, Any]:
    """Make the capture.

    Raises:
        SachaError: an option makes no sense.
        OSError: a file cannot be written.
    """
    from sacha_core.synthesis.options import SynthOptions

    everything = SynthOptions()
    chosen = SynthOptions(
        train=options.sequences,
        test=options.test_sequence,
        train_timesteps=options.timesteps,
        test_timesteps=options.test_timesteps,
        cameras=options.cameras or everything.cameras,
        width=options.width,
        height=options.height,
        seed=options.seed,
        supersample=options.supersample,
        expression_noise=options.tracking.expression_noise,
        pose_noise_rad=options.tracking.pose_noise,
        translation_noise_m=options.tracking.translation_noise,
    )
    film_it = film_synthetic if options.performer.avatar is None else film_performer
    union, head = film_it(options, chosen, console)
    n_timesteps = len(chosen.train) * chosen.train_timesteps + chosen.test_timesteps
    n_images = n_timesteps * len(chosen.cameras)
    console.wrote("capture", union)
    console.say(
        f"images       {n_images}, {chosen.width}x{chosen.height}: {n_timesteps} timesteps by {len(chosen.cameras)} cameras"
    )
    console.say(f"held out     camera 8, sequence {chosen.test}")
    console.hint(f"sacha train {options.out} -o out/model")
    return {
        "capture": union,
        "n_images": n_images,
        "n_timesteps": n_timesteps,
        "head": head.name,
        "options": chosen.as_json(),
    }


def film_synthetic(options: Options, chosen: SynthOptions, console: Console) -> tuple[Path, HeadModel]:
    """Film the synthetic head.

    Raises:
        OptionError: an option that belongs to an avatar is given.
        HeadError: the head is not a synthetic one.
    """
    from sacha_core.cli.filming import make_capture
    from sacha_core.cli.sources import keep
    from sacha_core.flame.open import open_head

    for name in ("motion", "masks"):
        if getattr(options.performer, name) is not None:
            raise OptionError(f"--{name} is for an avatar; expected --avatar AVATAR beside it")
    named = options.head or "synthetic"
    head = open_head(named)
    if not head.name.startswith("synthetic-"):
        raise HeadError(
            f"--head {named} is not a synthetic head; only those come with an appearance to film: give --avatar AVATAR for others"
        )
    keep(head)
    return make_capture(options.out, head, chosen, console), head


def film_performer(options: Options, chosen: SynthOptions, console: Console) -> tuple[Path, HeadModel]:
    """Film an avatar.

    Raises:
        SachaError: the avatar, its head or its motion cannot be used.
    """
    from sacha_core.cli.filming import capture_avatar
    from sacha_core.cli.sources import open_avatar, open_motion
    from sacha_core.synthesis.avatar_film import Sitter

    performer = options.performer
    assert performer.avatar is not None
    opened = open_avatar(performer.avatar, HeadSource(options.head, performer.masks))
    say_regions(opened.head, console)
    sitter = Sitter(opened.avatar.gaussians, opened.head, opened.avatar.motion)
    motion = None if performer.motion is None else open_motion(performer.motion, opened.head)
    return capture_avatar(options.out, subject_name(performer.avatar), sitter, chosen, motion, console), opened.head


def say_regions(head: HeadModel, console: Console) -> None:
    """Say how many triangles each region has, or why they are not known, which training would find out late."""
    from sacha_core.regions.labels import label_triangles
    from sacha_core.regions.scheme import PAPER

    try:
        labels = label_triangles(head, PAPER)
    except HeadError as error:
        console.say(f"regions      unknown: {error}")
        return
    counts = ", ".join(f"{name} {int((labels == row).sum())}" for row, name in enumerate(PAPER.regions))
    console.say(f"regions      {counts} triangles")


def subject_name(avatar: Path) -> str:
    """Give an avatar's name as it may stand in a folder's name, which has `_` between its parts."""
    name = re.sub(r"[^A-Za-z0-9.]+", "-", avatar.resolve().with_suffix("").name).strip("-.")
    return name or "avatar"
