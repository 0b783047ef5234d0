"""Captures of the synthetic head or of an avatar, filmed and written, told how far."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from pathlib import Path
from typing import TYPE_CHECKING

from sacha_core.cli.console import Console
from sacha_core.progress import Progress

if TYPE_CHECKING:
    from sacha_core.avatar.motion import Motion
    from sacha_core.flame.model import HeadModel
    from sacha_core.interchange.capture_writer import CaptureWriter
    from sacha_core.synthesis.avatar_film import Sitter
    from sacha_core.synthesis.film import Picture, Take
    from sacha_core.synthesis.options import SynthOptions

__all__ = ["capture_avatar", "make_capture"]

HEAD_FILE = "head.npz"


def make_capture(root: Path, head: HeadModel, options: SynthOptions, console: Console) -> Path:
    """Film a capture of the synthetic head; sequences that lie there complete, made from the same options, are kept.

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

    origin = options.origin(head.reference.sha256)
    writer = CaptureWriter(root, f"synthetic-{options.seed}", head.reference, origin=origin)
    return write_takes(writer, plan_takes(head, options), lambda take: film(head, take, options), console)


def capture_avatar(
    root: Path, subject: str, sitter: Sitter, options: SynthOptions, motion: Motion | None, console: Console
) -> Path:
    """Film a capture of an avatar; as `make_capture`, and puts the head beside it, so that training finds it.

    Args:
        root: the folder that it goes to.
        subject: name of the person.
        sitter: who performs.
        options: what shall be filmed.
        motion: to cut the sequences out of, or None.
        console: told how far it is.

    Returns:
        The union folder, which is what one trains on.
    """
    from sacha_core.flame.head_file import save_head
    from sacha_core.interchange.capture_writer import CaptureWriter
    from sacha_core.raster.rasteriser import Rasteriser
    from sacha_core.synthesis.avatar_film import film_avatar, plan_avatar_takes

    takes = plan_avatar_takes(sitter, options, motion)
    head_file = root / HEAD_FILE
    writer = CaptureWriter(root, subject, sitter.head.reference, head_file, origin=sitter.origin(options))
    rasteriser = Rasteriser()
    union = write_takes(writer, takes, lambda take: film_avatar(sitter, take, options, rasteriser), console)
    save_head(sitter.head, head_file)
    return union


def write_takes(
    writer: CaptureWriter, takes: Sequence[Take], film: Callable[[Take], Iterable[Picture]], console: Console
) -> Path:
    """Film takes and write them; give the union folder."""
    sequences = {take.name: writer.sequence(take.name, take.tracked, tuple(take.cameras)) for take in takes}
    missing = [take for take in takes if not sequences[take.name].is_complete()]
    total = sum(len(take.truth) * len(take.cameras) for take in missing)
    done = 0
    for take in missing:
        sequence = sequences[take.name]
        for picture in film(take):
            sequence.add(picture.timestep, picture.camera_index, picture.camera, picture.image, picture.mask)
            done += 1
            console.report(Progress("film", done, total))
        sequence.finish()
    if len(missing) < len(takes):
        console.say(f"kept         {len(takes) - len(missing)} of {len(takes)} sequences that were there already")
    trained_on = [sequences[take.name] for take in takes if not take.held_out]
    return writer.finish(trained_on, [sequences[take.name] for take in takes if take.held_out])
