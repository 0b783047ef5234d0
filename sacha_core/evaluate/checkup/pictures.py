"""Masks and backgrounds: training takes whatever is not white for the person."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from jaxtyping import Bool

from sacha_core.evaluate.checkup.finding import Finding
from sacha_core.evaluate.coverage import NEARLY_WHITE, foreground
from sacha_core.interchange.capture import Capture, View
from sacha_core.progress import Progress, Report, silent

__all__ = ["judge_cameras_of_file", "judge_masks", "off_centre"]

LEAST_AREA, MOST_AREA = 0.01, 0.97  # of an image that a head with hair and neck covers
BORDER = 4  # pixels along the edge of an image that show the background
WHITE_BORDER = 0.5  # of them, where shoulders and hair may cross the edge
MOST_OFF_CENTRE = 0.25  # of the image's side between its middle and the principal point


def judge_masks(
    capture: Capture, views: Sequence[View], report: Report = silent
) -> tuple[list[Finding], list[Bool[np.ndarray, "h w"]]]:
    """Look at masks and backgrounds of some views.

    Args:
        capture: where the views are from.
        views: which to look at.
        report: told after each view.

    Returns:
        What is wrong, and where each view shows the person.

    Raises:
        DatasetError: an image or a mask cannot be decoded.
    """
    masks = []
    for done, view in enumerate(views, 1):
        masks.append(foreground(capture, view))
        report(Progress("look at views", done, len(views)))
    found = []
    everything = (*capture.train, *capture.val, *capture.test)
    n_without = sum(view.mask_path is None for view in everything)
    if n_without:
        dirty = [view for view in views if not white_border(capture, view)]
        if dirty:
            what = f"the background is not white, as in {dirty[0].image_path}, and {_share(n_without, len(everything))} without a mask"
            remedy = (
                "put the person on white and export masks (fg_masks), or the background is trained as part of the head"
            )
            found.append(Finding("error", "masks", what, remedy))
        elif n_without < len(everything):
            what = f"{_share(n_without, len(everything))} without a mask"
            found.append(Finding("warning", "masks", what, "there, whatever is not white counts as the person"))
    empty = [view for view, mask in zip(views, masks, strict=True) if mask.mean() < LEAST_AREA]
    full = [view for view, mask in zip(views, masks, strict=True) if mask.mean() > MOST_AREA]
    if empty:
        what = f"{_share(len(empty), len(views))} next to nothing of the person, such as {empty[0].image_path}"
        found.append(Finding("warning", "masks", what, "a lost mask: leave such images out or mask them again"))
    if full:
        what = f"{_share(len(full), len(views))} nothing but foreground, such as {full[0].image_path}"
        found.append(Finding("error", "masks", what, "masks are white where the person is and black elsewhere"))
    return found, masks


def judge_cameras_of_file(views: Sequence[View]) -> list[Finding]:
    """Look at what intrinsics say by themselves: a principal point far from the middle is a crop or another resolution."""
    off = [view for view in views if off_centre(view) > MOST_OFF_CENTRE]
    if not off:
        return []
    camera = off[0].camera
    what = (
        f"{_share(len(off), len(views))} the principal point far from the middle, such as ({camera.cx:g}, {camera.cy:g}) of "
        f"{camera.width} by {camera.height} pixels in {off[0].image_path.name}"
    )
    remedy = "where images are shrunk or cropped, fl_x, fl_y, cx and cy change with them"
    return [Finding("warning", "cameras", what, remedy)]


def off_centre(view: View) -> float:
    """Give how far the principal point lies from the middle of the image, as a share of its side."""
    camera = view.camera
    return max(abs(camera.cx / camera.width - 0.5), abs(camera.cy / camera.height - 0.5))


def white_border(capture: Capture, view: View) -> bool:
    """Tell whether most of the upper edge and the upper halves of the sides are white: the head is in the middle, the neck below."""
    light = capture.image(view).min(axis=2) >= NEARLY_WHITE
    half = len(light) // 2
    edge = np.concatenate([light[:BORDER].ravel(), light[:half, :BORDER].ravel(), light[:half, -BORDER:].ravel()])
    return bool(edge.mean() > WHITE_BORDER)


def _share(n: int, total: int) -> str:
    """Say how many of the views have something."""
    return f"{n} of {total} views {'has' if n == 1 else 'have'}" if n < total else "all views have"
