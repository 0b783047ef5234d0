"""Judging an avatar. Oracles: a capture of the very avatar, and the metrics called by hand."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from sacha_core.avatar.motion import Motion
from sacha_core.errors import DatasetError
from sacha_core.evaluate.views import evaluate_avatar, evaluation_motion, score_views
from sacha_core.flame.posing import Poser
from sacha_core.geometry.triangle import triangle_frames
from sacha_core.perception.psnr import psnr
from sacha_core.perception.ssim import ssim
from sacha_core.progress import Progress
from sacha_core.raster.scene import render_avatar

EIGHT_BITS = (
    58.0  # dB: rounding to 1/255 has a mean square error of 1/12 steps, which is 58.9 dB; white pixels only add to it
)


def test_the_avatar_itself_is_judged_perfect_but_for_eight_bits(subject) -> None:
    found = evaluate_avatar(subject.gaussians, subject.head, subject.capture)
    assert len(found.novel_view.images) == 3
    assert len(found.novel_expression.images) == 4
    for scores in (found.novel_view, found.novel_expression):
        assert min(one.psnr for one in scores.images) > EIGHT_BITS
        assert scores.ssim > 0.999


def test_figures_are_those_of_the_metrics_on_the_drawn_image(subject) -> None:
    faded = replace(subject.gaussians, opacity_logit=subject.gaussians.opacity_logit - 1)
    views = subject.capture.test
    heard: list[Progress] = []
    found = score_views(faded, subject.head, subject.motion, subject.capture, views, 24, 35, heard.append, "draw")
    pose = Poser(subject.head, subject.motion)
    for view, score in zip(views, found.images, strict=True):
        frames = triangle_frames(pose(view.timestep), subject.head.faces)
        drawn = render_avatar(faded, frames, view.camera.resized(24, 35)).colour
        truth = subject.capture.image(view, 24, 35)
        assert (score.timestep, score.camera_index) == (view.timestep, view.camera_index)
        assert score.psnr == psnr(drawn, truth)
        assert score.ssim == ssim(drawn, truth)
    assert found.psnr == pytest.approx(np.mean([score.psnr for score in found.images]))
    assert [(one.stage, one.done, one.total) for one in heard] == [("draw", i, 4) for i in (1, 2, 3, 4)]
    assert found.to_json()["images"][0].keys() == {"timestep", "camera_index", "psnr", "ssim"}


def test_a_wrong_motion_costs(subject) -> None:
    still = Motion.rest(len(subject.motion.shape), subject.motion.expression.shape[1], len(subject.motion))
    found = evaluate_avatar(subject.gaussians, subject.head, subject.capture, still)
    for scores in (found.novel_view, found.novel_expression):
        assert scores.psnr < EIGHT_BITS - 20  # judged with the avatar's own motion, which is wrong
    trained = evaluate_avatar(subject.gaussians, subject.head, subject.capture, still.frames(slice(0, 3)))
    assert trained.novel_view.psnr == found.novel_view.psnr
    assert trained.novel_expression.psnr > EIGHT_BITS  # where it has ended, judged with the tracked one


def test_an_avatar_moves_by_its_own_motion_to_its_end_and_then_as_tracked(subject) -> None:
    fitted = replace(
        subject.motion,
        shape=subject.motion.shape + 1,
        jaw=subject.motion.jaw + 2,
        expression=subject.motion.expression + 3,
    )
    for n_frames in (3, 4, 5):  # from the training timesteps alone, which are three, to all
        mixed = evaluation_motion(subject.capture, fitted.frames(slice(0, n_frames)))
        np.testing.assert_array_equal(mixed.shape, fitted.shape)
        for name in ("jaw", "expression", "neck"):
            np.testing.assert_array_equal(getattr(mixed, name)[:n_frames], getattr(fitted, name)[:n_frames])
            np.testing.assert_array_equal(getattr(mixed, name)[n_frames:], getattr(subject.motion, name)[n_frames:])
    twice = fitted.frames(np.arange(10) % 5)  # one that goes on after the capture's end
    np.testing.assert_array_equal(evaluation_motion(subject.capture, twice).jaw, fitted.jaw)
    assert evaluation_motion(subject.capture, None) is subject.capture.motion


def test_another_captures_motion_is_refused(subject) -> None:
    with pytest.raises(DatasetError, match="2 frames"):
        evaluation_motion(subject.capture, subject.motion.frames(slice(0, 2)))
    narrow = replace(subject.motion, expression=subject.motion.expression[:, :5])
    with pytest.raises(DatasetError, match="5 numbers of expression"):
        evaluation_motion(subject.capture, narrow)


def test_no_views_are_refused(subject) -> None:
    with pytest.raises(DatasetError, match="no held-out views"):
        score_views(subject.gaussians, subject.head, subject.motion, subject.capture, ())
