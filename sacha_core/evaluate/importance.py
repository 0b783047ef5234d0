"""Scores for an avatar that is there already, trained here or elsewhere: what re-budgeting needs."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass, replace

import numpy as np
from jaxtyping import Bool, Float

from sacha_core.avatar.gaussians import Gaussians
from sacha_core.avatar.motion import Motion
from sacha_core.density.events import Calibration
from sacha_core.density.scores.table import KNOWN_SCORES
from sacha_core.density.scores_file import BlendingSums, Scores
from sacha_core.errors import HeadError, OptionError
from sacha_core.evaluate.rig_views import rig_targets, spread_frames
from sacha_core.evaluate.views import evaluation_motion
from sacha_core.flame.model import HeadModel
from sacha_core.geometry.triangle import triangle_frames
from sacha_core.interchange.capture import Capture
from sacha_core.progress import Report, silent
from sacha_core.regions.partition import Partition
from sacha_core.synthesis.cameras import N_CAMERAS
from sacha_core.train.density_control import calibrate
from sacha_core.train.devices import find_device, open_engine
from sacha_core.train.importance import importance, look
from sacha_core.train.options import TrainOptions
from sacha_core.train.regions import Regions, head_regions
from sacha_core.train.state import initial_state
from sacha_core.train.views import Target, TrainingViews, decoded_ahead, grouped, spread_views

__all__ = ["DEFAULT_SIZE", "Scored", "estimated_sensitivity", "score_avatar"]

DEFAULT_SIZE = (550, 802)  # the paper's images
INITIAL_SENSITIVITY = 0.1  # of what no view shows, as of a Gaussian that training has not touched
MARGIN = 1e-3  # an estimate keeps this far from 0 and 1, whose logits are infinite


@dataclass(frozen=True)
class Scored:
    """An avatar's scores and how they came about.

    Args:
        scores: for the scores file; the Gaussians in the avatar's own order.
        calibration: the regions as measured: the last of the scores' events.
        visible: (n,) Gaussians that the views show.
        n_views: how many views were drawn.
        learned: whether the avatar brought sensitivities of its own; if not, they were estimated.
    """

    scores: Scores
    calibration: Calibration
    visible: Bool[np.ndarray, " n"]
    n_views: int
    learned: bool


def score_avatar(
    gaussians: Gaussians,
    head: HeadModel,
    motion: Motion | None = None,
    capture: Capture | None = None,
    options: TrainOptions | None = None,
    report: Report = silent,
    partition: Partition | None = None,
) -> Scored:
    """Score the Gaussians of an avatar as training does at its last pruning.

    The views are those of a capture, whose own images say where the eye would notice; without one, the avatar's own pictures from the
    calibrated rig. An avatar that brings no sensitivities gets estimates: the mean reference sensitivity of the pixels that a Gaussian
    shows in, weighted by how much of it shows there, and the initial 0.1 for what shows nowhere.

    Args:
        gaussians: n, the avatar's.
        head: the head that they are bound to; with masks, by which regions are told apart.
        motion: what the avatar does; by default the capture's, or the head at rest.
        capture: to look through its training cameras, at most about as many views as `options` says.
        options: which views, which score, which means of sensitivities, which size of images, which device.
        report: told about progress.
        partition: the head's regions, where they are not to be made from masks.

    Raises:
        HeadError: the head lacks masks, or is not the capture's.
        DatasetError: the capture's images cannot be decoded, or the motion is another capture's.
        GeometryError: a frame makes a triangle degenerate.
        OptionError: the avatar has no Gaussians, or the device cannot be had.

    Source: SACHA, importance score q; the estimate of sensitivities is our own.
    """
    options = replace(options or TrainOptions(), fine_tune=False)
    if not len(gaussians):
        raise OptionError("the avatar has no Gaussians; there is nothing to score")
    regions = head_regions(head, options.scheme) if partition is None else Regions.of_partition(partition)
    motion = _motion(head, motion, capture)
    targets, n_views = _targets(gaussians, head, motion, capture, options)
    order = np.argsort(gaussians.binding, kind="stable")  # training has them sorted by triangle
    state = initial_state(
        gaussians.select(order), motion, regions.n_regions, options.density.threshold, options.pruning.ratio
    )
    engine = open_engine(find_device(options.device), head, motion, options)
    engine.put(state)
    passes = KNOWN_SCORES[options.pruning.score].passes
    seen = look(engine, targets, n_views, gaussians.sh_degree, passes, report)
    learned = gaussians.sensitivity_logit is not None
    if not learned:
        least_weight = options.importance.visible_pixels * n_views
        state.values["sensitivity_logit"] = estimated_sensitivity(seen.weights, least_weight)
    calibration = calibrate(state, options, regions, seen)
    rest_scale = triangle_frames(head.v_template, head.faces).scale
    score = importance(state, options, seen, rest_scale)
    back = np.argsort(order)
    scored = replace(gaussians, sensitivity_logit=state.values["sensitivity_logit"][back])
    sums = BlendingSums(seen.weights[back, 0], seen.weights[back, 1], n_views)
    scheme = options.scheme if partition is None else partition.name
    scores = Scores(scored, score[back], head.n_faces, scheme, (calibration,), sums)
    return Scored(scores, calibration, sums.visible(options.importance.visible_pixels), n_views, learned)


def estimated_sensitivity(weights: Float[np.ndarray, "n 2"], least_weight: float) -> Float[np.ndarray, " n"]:
    """Give the logit of each Gaussian's mean reference sensitivity over the pixels that it shows in.

    Args:
        weights: (n, 2) blending weight summed over pixels: plain, and by reference sensitivity.
        least_weight: of what shows; less is hidden, and gets the initial sensitivity.
    """
    plain, sensitive = weights.T
    shows = (plain > least_weight) & (plain > 0)
    mean = np.divide(sensitive, plain, out=np.full(len(plain), INITIAL_SENSITIVITY), where=shows)
    mean = np.clip(mean, MARGIN, 1 - MARGIN)
    logit: np.ndarray = np.log(mean / (1 - mean)).astype(np.float32)
    return logit


def _motion(head: HeadModel, motion: Motion | None, capture: Capture | None) -> Motion:
    """Give what the avatar does in the views."""
    if capture is None:
        return motion or Motion.rest(head.shapedirs.shape[2], head.exprdirs.shape[2])
    if capture.head is not None and capture.head.sha256 != head.reference.sha256:
        raise HeadError(
            f"{capture.root} was tracked with head {capture.head.name!r} (SHA-256 {capture.head.sha256[:12]}...),"
            f" but the avatar is bound to {head.name!r} ({head.reference.sha256[:12]}...)"
        )
    return evaluation_motion(capture, motion)


def _targets(
    gaussians: Gaussians, head: HeadModel, motion: Motion, capture: Capture | None, options: TrainOptions
) -> tuple[Iterable[tuple[Target, ...]], int]:
    """Give the views, those of one timestep together, and how many they are."""
    n, pad = options.importance.views, options.sensitivity_pad
    if capture is None:
        width, height = options.width or DEFAULT_SIZE[0], options.height or DEFAULT_SIZE[1]
        frames = spread_frames(len(motion), n or len(motion) * N_CAMERAS)
        targets = rig_targets(gaussians, head, motion, frames, width, height, pad, options.threads)
        return targets, len(frames) * N_CAMERAS
    views = TrainingViews(capture, options.width, options.height, pad, cache_bytes=0)
    chosen = spread_views(views.views, n or len(views.views))
    return decoded_ahead(views, grouped(views.views, chosen, len(chosen))), len(chosen)
