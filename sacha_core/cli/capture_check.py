"""`sacha doctor DATASET`: is this capture fit for training?"""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

from sacha_core.cli.common import HeadSource
from sacha_core.cli.console import Console
from sacha_core.errors import DatasetError, OptionError

if TYPE_CHECKING:
    import numpy as np

    from sacha_core.evaluate.checkup.examine import Examination
    from sacha_core.evaluate.checkup.finding import Finding
    from sacha_core.evaluate.coverage import Coverage
    from sacha_core.flame.model import HeadModel
    from sacha_core.interchange.capture import Capture, View

__all__ = ["check_capture"]

LOOKED_AT = 24  # views of a capture whose pixels are decoded
ENOUGH_COVERED = (
    0.8  # of the vertices inside the mask: captures are masked below a line through the neck, which hides some
)
COLUMNS = 6  # of the picture


def check_capture(root: Path, source: HeadSource, picture: Path | None, console: Console) -> dict[str, Any]:
    """Read a capture, and see whether an avatar can be trained on it.

    Raises:
        SachaError: the capture is broken, or its head is not to be found.
        OSError: the picture cannot be written.
    """
    from sacha_core.cli.sources import capture_head
    from sacha_core.evaluate.checkup.examine import examine
    from sacha_core.evaluate.splits import spread

    if picture is not None and picture.suffix.lower() != ".png":
        raise OptionError(f"--picture {picture}: expected the name of a PNG, such as {picture.stem}.png")
    capture = read(root)
    summary = summarise(capture)
    console.say(f"capture      {capture.root}")
    console.say(f"images       {summary['n_images']} of {' and '.join(summary['sizes'])}, all there")
    console.say(f"timesteps    {summary['n_timesteps']}, parameters finite")
    console.say(f"cameras      {len(summary['cameras'])}")
    console.say("splits       " + ", ".join(f"{name} {count}" for name, count in summary["splits"].items()))
    head = capture_head(capture, source)
    console.say(f"head         {head.name}: {head.n_vertices} vertices, {head.n_faces} triangles")
    views = spread((*capture.train, *capture.val, *capture.test), LOOKED_AT)
    found = examine(capture, head, views, console.report)
    covered = () if found.agreement is None else covering(capture, head, views, found.masks, console)
    tell(found.findings, any(one.inside < ENOUGH_COVERED for one in covered), console)
    if picture is not None and found.agreement is not None:
        draw(picture, capture, head, views, found.masks)
        console.wrote("picture", picture, "blue: tracked mesh, orange: edge of the mask")
    if found.held_against == 0 and capture.head is None:
        console.say(
            "versions     not compared: FLAME 2020 and 2023 take the same parameters; convert the other one, too (sacha convert-head),"
            " and both are held against the masks"
        )
    if found.sound:
        console.hint(f"sacha train {root} -o MODEL")
    elif picture is None:
        console.hint(f"sacha doctor {root} --picture tracking.png")
    return {**summary, **report(found, head, covered)}


def read(root: Path) -> Capture:
    """Read a capture; say of a folder that is none what it seems to be instead.

    Raises:
        DatasetError: it is none, or is broken.
    """
    from sacha_core.evaluate.checkup.layout import guess_folder
    from sacha_core.interchange.capture import capture_folder, read_capture

    try:
        capture_folder(root)
    except DatasetError as error:
        guess = guess_folder(root)
        if guess is None:
            raise
        raise DatasetError(guess) from error
    return read_capture(root)


def covering(
    capture: Capture, head: HeadModel, views: Sequence[View], masks: Sequence[np.ndarray], console: Console
) -> tuple[Coverage, ...]:
    """Say how much of the tracked head lies where it is seen."""
    from sacha_core.evaluate.coverage import mesh_coverage

    covered = mesh_coverage(capture, head, views, masks)
    worst, mean = min(covered, key=lambda one: one.inside), sum(one.inside for one in covered) / len(covered)
    console.say(
        f"tracking     {100 * mean:.1f} % of the head's vertices lie inside the mask over {len(covered)} views, "
        f"at worst {100 * worst.inside:.1f} % ({worst.view.image_path.name})"
    )
    poor = [one for one in covered if one.inside < ENOUGH_COVERED]
    if poor:
        console.say(
            f"warning      {len(poor)} of {len(covered)} views show the head elsewhere than tracked (under "
            f"{100 * ENOUGH_COVERED:.0f} %): wrong head, wrong cameras, or a lost track"
        )
    return covered


def tell(findings: Sequence[Finding], warned: bool, console: Console) -> None:
    """Say what was found and what to do about it, and count it together with the warning about coverage, if there was one."""
    for finding in findings:
        console.say(f"{finding.severity:12} {finding.about}: {finding.what}\n{'':12} {finding.remedy}")
    n_errors = sum(finding.severity == "error" for finding in findings)
    n_warnings = len(findings) - n_errors + warned
    verdict = "not fit for training" if n_errors else "fit for training"
    counts = [f"{n} {word}{'s' * (n > 1)}" for n, word in ((n_errors, "error"), (n_warnings, "warning")) if n]
    console.say(f"verdict      {verdict}" + (f": {', '.join(counts)}" if counts else ""))


def draw(path: Path, capture: Capture, head: HeadModel, views: Sequence[View], masks: Sequence[np.ndarray]) -> None:
    """Draw the mesh over half of the views that were looked at."""
    from sacha_core.evaluate.checkup.overlay import write_overlay

    shown = views[::2]
    rows = [shown[first : first + COLUMNS] for first in range(0, len(shown), COLUMNS)]
    by_image = {view.image_path: mask for view, mask in zip(views, masks, strict=True)}
    write_overlay(path, capture, head, rows, by_image)


def report(found: Examination, head: HeadModel, covered: Sequence[Coverage]) -> dict[str, Any]:
    """Give the report for machines."""
    from dataclasses import asdict

    poor = [one for one in covered if one.inside < ENOUGH_COVERED]
    return {
        "head": {"name": head.name, "n_vertices": head.n_vertices, "n_faces": head.n_faces},
        "findings": [asdict(finding) for finding in found.findings],
        "agreement": found.agreement,
        "heads_held_against": found.held_against,
        "coverage": [
            {
                "image": one.view.image_path,
                "timestep": one.view.timestep,
                "camera_index": one.view.camera_index,
                "inside": one.inside,
                "in_image": one.in_image,
                "mask_area": one.mask_area,
            }
            for one in covered
        ],
        "coverage_mean": sum(one.inside for one in covered) / len(covered) if covered else None,
        "coverage_worst": min((one.inside for one in covered), default=None),
        "warnings": [f"{one.view.image_path}: {100 * one.inside:.1f} % inside the mask" for one in poor],
        "broken": not found.sound,
    }


def summarise(capture: Capture) -> dict[str, Any]:
    """Count what a capture has."""
    splits: dict[str, tuple[View, ...]] = {"train": capture.train, "val": capture.val, "test": capture.test}
    everything = [view for views in splits.values() for view in views]
    return {
        "capture": capture.root,
        "n_images": len(everything),
        "sizes": sorted({f"{view.camera.width}x{view.camera.height}" for view in everything}),
        "n_timesteps": len(capture.motion),
        "cameras": sorted({view.camera_index for view in everything}),
        "splits": {name: len(views) for name, views in splits.items()},
    }
