"""`sacha synth`: a capture made of nothing but code."""

from __future__ import annotations

from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import tyro

from sacha_core.cli.common import Common
from sacha_core.cli.console import Console
from sacha_core.errors import HeadError
from sacha_core.progress import Progress

if TYPE_CHECKING:
    from sacha_core.flame.model import HeadModel
    from sacha_core.synthesis.options import SynthOptions

__all__ = ["Options", "make_capture", "run"]


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
class Options:
    """Make a multi-view capture of the synthetic head, in the layout of GaussianAvatars and NeRSemble.

    Sixteen cameras, several sequences of expression and head motion, white background, FLAME parameters for each timestep; camera 8 and the
    last sequence are held out. The same command again continues where it was interrupted.

    sacha synth out/data
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

    head: Annotated[str, tyro.conf.arg(metavar="HEAD")] = "synthetic"
    """Who performs: "synthetic", "synthetic:small", or one of these with a seed ("synthetic:full:3") for another person."""

    seed: int = 0
    """Of appearance and motion."""

    supersample: Annotated[int, tyro.conf.arg(metavar="N")] = 2
    """Samples along each axis of a pixel."""

    tracking: Tracking = field(default_factory=Tracking)
    common: Common = field(default_factory=Common)


def run(options: Options, console: Console) -> dict[str, Any]:
    """Make the capture.

    Raises:
        SachaError: an option makes no sense.
        OSError: a file cannot be written.
    """
    from sacha_core.cli.sources import keep
    from sacha_core.flame.open import open_head
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
    head = open_head(options.head)
    if not head.name.startswith("synthetic-"):
        raise HeadError(f"--head {options.head} is not a synthetic head; only those come with an appearance to film")
    keep(head)
    union = make_capture(options.out, head, chosen, console)
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


def make_capture(root: Path, head: HeadModel, options: SynthOptions, console: Console) -> Path:
    """Film a capture; sequences that lie there complete, made from the same options, are kept.

    Args:
        root: the folder that it goes to.
        head: who performs.
        options: what shall be filmed.
        console: told how far it is.

    Returns:
        The union folder, which is what one trains on.
    """
    from sacha_core.interchange.capture_writer import CaptureWriter
    from sacha_core.synthesis.film import film, plan_takes

    takes = plan_takes(head, options)
    origin = options.origin(head.reference.sha256)
    writer = CaptureWriter(root, f"synthetic-{options.seed}", head.reference, origin=origin)
    sequences = {take.name: writer.sequence(take.name, take.tracked, tuple(take.cameras)) for take in takes}
    missing = [take for take in takes if not sequences[take.name].is_complete()]
    total = sum(len(take.truth) * len(take.cameras) for take in missing)
    done = 0
    for take in missing:
        sequence = sequences[take.name]
        for picture in film(head, take, options):
            sequence.add(picture.timestep, picture.camera_index, picture.camera, picture.image, picture.mask)
            done += 1
            console.report(Progress("film", done, total))
        sequence.finish()
    if len(missing) < len(takes):
        console.say(f"kept         {len(takes) - len(missing)} of {len(takes)} sequences that were there already")
    return writer.finish([sequences[name] for name in options.train], [sequences[options.test]])
