"""Which head was a capture tracked with? Exports do not say it, and FLAME 2020 and 2023 take the same number of parameters.

The same coefficients give another face with another model, so that the outline of the right one agrees better with the masks.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path

import numpy as np

from sacha_core.avatar.motion import Motion
from sacha_core.errors import SachaError
from sacha_core.evaluate.checkup.finding import Finding
from sacha_core.evaluate.checkup.silhouette import CoarseMask, agreement, surface_points
from sacha_core.flame.head_file import load_head
from sacha_core.flame.model import HeadModel
from sacha_core.flame.posing import Poser
from sacha_core.flame.shelf import shelf_folder
from sacha_core.interchange.capture import View

__all__ = ["judge_head", "kept_heads"]

BETTER = 0.01  # mean agreement by which another head must be better to be named
OF_VIEWS = 0.8  # of the views, on which it must be better


def kept_heads(like: HeadModel) -> dict[Path, HeadModel]:
    """Give other heads of the user's folder that take the same parameters, by file; damaged ones are left out: nobody named them."""
    folder = shelf_folder()
    found = {}
    for path in sorted(folder.glob("*.npz")) if folder.is_dir() else ():
        try:
            head = load_head(path)
        except (SachaError, OSError):
            continue
        sizes = [(one.n_vertices, one.shapedirs.shape[2], one.exprdirs.shape[2]) for one in (head, like)]
        if sizes[0] == sizes[1] and head.reference.sha256 != like.reference.sha256:
            found[path] = head
    return found


def judge_head(
    motion: Motion,
    head: HeadModel,
    others: Mapping[Path, HeadModel],
    views: Sequence[View],
    masks: Sequence[CoarseMask],
) -> list[Finding]:
    """Say where the capture looks as if it was tracked with another of the heads that are at hand.

    Args:
        motion: of the capture.
        head: that it is taken to be tracked with.
        others: heads that take the same parameters, by file.
        views: some views.
        masks: of the views.
    """
    ours = _agreements(motion, head, views, masks)
    found = []
    for path, other in others.items():
        theirs = _agreements(motion, other, views, masks)
        if (theirs - ours).mean() > BETTER and (theirs > ours).mean() >= OF_VIEWS:
            what = (
                f"it looks as if it was tracked with {other.name!r}, whose outline agrees with the masks by {100 * theirs.mean():.1f} %, "
                f"{head.name!r} by {100 * ours.mean():.1f} %"
            )
            remedy = f"FLAME 2020 and 2023 take parameters of the same size that mean other faces: try --head {path}"
            found.append(Finding("warning", "head", what, remedy))
    return found


def _agreements(motion: Motion, head: HeadModel, views: Sequence[View], masks: Sequence[CoarseMask]) -> np.ndarray:
    pose = Poser(head, motion)
    return np.array(
        [
            agreement(surface_points(pose(view.timestep), head.faces), view.camera, mask)
            for view, mask in zip(views, masks, strict=True)
        ]
    )
