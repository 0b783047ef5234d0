"""All checks of a capture, in the order in which one makes sense of the next."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from jaxtyping import Bool

from sacha_core.evaluate.checkup.alternatives import Posed, judge_cameras, mean_agreement
from sacha_core.evaluate.checkup.finding import Finding
from sacha_core.evaluate.checkup.heads import judge_head, kept_heads
from sacha_core.evaluate.checkup.parameters import judge_parameters
from sacha_core.evaluate.checkup.pictures import judge_cameras_of_file, judge_masks
from sacha_core.evaluate.checkup.silhouette import coarse_mask, surface_points
from sacha_core.flame.model import HeadModel
from sacha_core.flame.posing import Poser
from sacha_core.interchange.capture import Capture, View
from sacha_core.progress import Report, silent

__all__ = ["Examination", "examine"]


@dataclass(frozen=True)
class Examination:
    """What was found.

    Args:
        findings: errors and warnings, in the order of the checks.
        masks: where each view that was looked at shows the person.
        agreement: mean area that head and masks share over the area that either has; None where the head could not be posed.
        held_against: how many other heads that take the same parameters it was held against; None where that made no sense.
    """

    findings: list[Finding]
    masks: list[Bool[np.ndarray, "h w"]]
    agreement: float | None
    held_against: int | None = None

    @property
    def sound(self) -> bool:
        """Whether training makes sense: there may be warnings, but no errors."""
        return not any(finding.severity == "error" for finding in self.findings)


def examine(capture: Capture, head: HeadModel, views: Sequence[View], report: Report = silent) -> Examination:
    """Check parameters, masks, cameras and the head of a capture.

    Args:
        capture: that was read.
        head: that it was tracked with, as far as is known.
        views: some of its views, spread over cameras and timesteps; those alone are decoded.
        report: told after each view.

    Raises:
        DatasetError: an image or a mask cannot be decoded.
    """
    findings = judge_parameters(capture.motion, head)
    about_masks, masks = judge_masks(capture, views, report)
    findings += about_masks + judge_cameras_of_file((*capture.train, *capture.val, *capture.test))
    if any(finding.about == "head" for finding in findings):
        return Examination(findings, masks, None)
    pose, coarse = Poser(head, capture.motion), [coarse_mask(mask) for mask in masks]
    posed = [
        Posed(surface_points(pose(view.timestep), head.faces), view.camera, mask)
        for view, mask in zip(views, coarse, strict=True)
    ]
    about_cameras = judge_cameras(posed)
    findings += about_cameras
    if about_cameras:
        return Examination(findings, masks, mean_agreement(posed))
    others = kept_heads(head)
    findings += judge_head(capture.motion, head, others, views, coarse)
    return Examination(findings, masks, mean_agreement(posed), len(others))
