"""Scores of an avatar that is there already: against training's own, brute force, and the laws of relabelling."""

from __future__ import annotations

from dataclasses import fields, replace
from pathlib import Path

import numpy as np
import pytest

from sacha_core.avatar.binding import sigmoid, to_world
from sacha_core.avatar.gaussians import Gaussians
from sacha_core.avatar.motion import Motion
from sacha_core.density.scores_file import read_scores
from sacha_core.errors import HeadError, OptionError
from sacha_core.evaluate.importance import estimated_sensitivity, score_avatar
from sacha_core.evaluate.rig_views import rig_round, rig_targets, spread_frames
from sacha_core.flame.posing import Poser
from sacha_core.geometry.triangle import triangle_frames
from sacha_core.perception.sensitivity_map import sensitivity_map
from sacha_core.raster.rasteriser import Rasteriser, Splats
from sacha_core.raster.scene import render_avatar
from sacha_core.synthesis.cameras import N_CAMERAS, TARGET_M, camera_rig
from sacha_core.train.loop import train
from sacha_core.train.options import TrainOptions
from sacha_core.train.presets import scaled

SMALL = TrainOptions(width=48, height=70, threads=1, device="cpu")
ROUNDING = 1e-5  # float32 weights of one pass against those of another that sums in another order


@pytest.fixture(scope="module")
def trained(subject, tmp_path_factory: pytest.TempPathFactory):
    """Give training's own scores, made at its last calibration, and the options of that run."""
    base = TrainOptions(threads=1, sh_degree=1, device="cpu", fine_tune=False)
    options = scaled(20, "sacha", base)
    folder: Path = tmp_path_factory.mktemp("scored")
    train(subject.capture, subject.head, options, folder)
    return read_scores(folder / "avatar.scores.npz"), options


def test_a_trained_avatar_scores_what_training_gave_it_to_the_bit(subject, trained) -> None:
    stored, options = trained
    found = score_avatar(stored.gaussians, subject.head, None, subject.capture, options)
    assert found.learned
    assert np.array_equal(found.scores.score, stored.score)
    for f in fields(Gaussians):
        assert np.array_equal(getattr(found.scores.gaussians, f.name), getattr(stored.gaussians, f.name))
    assert found.calibration.counts == stored.events[-2].counts
    assert found.n_views == len(subject.capture.train)


def test_the_order_of_gaussians_does_not_matter(subject) -> None:
    shuffle = np.random.default_rng(3).permutation(len(subject.gaussians))
    one = score_avatar(subject.gaussians, subject.head, None, subject.capture, SMALL).scores
    other = score_avatar(subject.gaussians.select(shuffle), subject.head, None, subject.capture, SMALL).scores
    # equal but for the order in which float32 weights of equally deep Gaussians are blended and summed
    assert other.score == pytest.approx(one.score[shuffle], rel=1e-3, abs=1e-3 * one.score.mean())
    assert np.array_equal(other.gaussians.binding, one.gaussians.binding[shuffle])


def test_sensitivities_are_means_of_the_map_by_blending_weight(subject) -> None:
    """The chain again, image by image, with nothing of training's in it."""
    found = score_avatar(subject.gaussians, subject.head, None, subject.capture, SMALL)
    n = len(subject.gaussians)
    weight, sensitive = np.zeros(n), np.zeros(n)
    pose, rasteriser = Poser(subject.head, subject.motion), Rasteriser(1)
    for view in subject.capture.train:
        world = to_world(subject.gaussians, triangle_frames(pose(view.timestep), subject.head.faces))
        splats = Splats(world.means, world.scales, world.quaternions, world.opacities, np.zeros((n, 1), np.float32))
        frame = rasteriser.forward(splats, view.camera, np.zeros(1, np.float32))
        marked = sensitivity_map(subject.capture.image(view)).astype(np.float32)
        sums = rasteriser.colour_weights(frame, np.stack([np.ones_like(marked), marked]))
        weight, sensitive = weight + sums[:, 0], sensitive + sums[:, 1]
    assert not found.learned
    assert found.scores.sums is not None
    assert found.scores.sums.weight == pytest.approx(weight, rel=ROUNDING, abs=1e-4)
    a = sigmoid(found.scores.gaussians.sensitivity_logit.astype(np.float64))
    hidden = weight <= len(subject.capture.train) / 12
    expected = np.clip(sensitive / np.maximum(weight, 1e-9), 1e-3, 1 - 1e-3)
    assert a[~hidden] == pytest.approx(expected[~hidden], abs=1e-5)
    assert a[hidden] == pytest.approx(0.1, abs=1e-6)
    assert np.array_equal(found.visible, ~hidden)
    assert 0 < hidden.sum() < n


def test_what_shows_nowhere_gets_the_initial_sensitivity() -> None:
    logits = estimated_sensitivity(np.array([[0.0, 0.0], [1.0, 1.0], [4.0, 1.0], [8.0, 0.0]]), 1.5)
    assert sigmoid(logits.astype(np.float64)) == pytest.approx([0.1, 0.1, 0.25, 1e-3], rel=1e-5)


def test_without_a_capture_the_avatars_own_pictures_tell(subject) -> None:
    motion = subject.motion
    target = next(rig_targets(subject.gaussians, subject.head, motion, [1], 48, 70))[5]
    frames = triangle_frames(Poser(subject.head, motion)(1), subject.head.faces)
    picture = render_avatar(subject.gaussians, frames, target.camera).colour
    drawn = np.round(255 * np.clip(picture, 0, 1)).astype(np.uint8)
    assert np.abs(target.image.transpose(1, 2, 0).astype(int) - drawn).max() <= 1
    assert np.array_equal(target.sensitivity == 255, sensitivity_map(target.image.transpose(1, 2, 0)))
    found = score_avatar(subject.gaussians, subject.head, motion, None, replace_views(SMALL, 40))
    assert found.n_views == 2 * N_CAMERAS
    assert found.scores.score.max() > 0


def replace_views(options: TrainOptions, views: int) -> TrainOptions:
    """Give the options with another number of views."""
    return replace(options, importance=replace(options.importance, views=views))


def test_the_rig_goes_with_the_head_and_grows_with_it(subject) -> None:
    """A head moved and scaled is seen by a rig moved and scaled in the same picture: similarity."""
    vertices = subject.head.v_template.astype(np.float64)
    usual, moved = rig_round(vertices, 48, 70), rig_round(3 * vertices + [5.0, -2.0, 1.0], 48, 70)
    for ours, theirs in zip(usual, moved, strict=True):
        a = vertices @ ours.rotation.T + ours.translation
        b = (3 * vertices + [5.0, -2.0, 1.0]) @ theirs.rotation.T + theirs.translation
        assert b == pytest.approx(3 * a, abs=1e-5)
        assert (ours.fx, ours.cx) == (theirs.fx, theirs.cx)
    near = np.linalg.norm([a.centre - b.centre for a, b in zip(usual, camera_rig(48, 70), strict=True)], axis=1)
    assert near.max() < 0.02 + np.linalg.norm(vertices.mean(axis=0) - TARGET_M)


@pytest.mark.parametrize(
    ("frames", "views", "expected"), [(1, 500, [0]), (100, 1, [0]), (5, 48, [0, 2, 4]), (2, 999, [0, 1])]
)
def test_frames_are_evenly_spread(frames, views, expected) -> None:
    assert spread_frames(frames, views) == expected


def test_what_cannot_be_scored_is_refused(subject) -> None:
    none = subject.gaussians.select(np.zeros(0, int))
    with pytest.raises(OptionError, match="no Gaussians"):
        score_avatar(none, subject.head)
    other = replace(subject.head, v_template=subject.head.v_template * np.float32(2))
    with pytest.raises(HeadError, match="tracked with"):
        score_avatar(subject.gaussians, other, None, subject.capture, SMALL)
    bare = replace(subject.head, masks={})
    with pytest.raises(HeadError, match="no vertex mask"):
        score_avatar(subject.gaussians, bare)
    wide = Motion.rest(subject.head.shapedirs.shape[2], 999)
    assert score_avatar(subject.gaussians, subject.head, None, None, replace_views(SMALL, 1)).n_views == N_CAMERAS
    with pytest.raises(HeadError):
        score_avatar(subject.gaussians, subject.head, replace(wide, expression=wide.expression + 1), None, SMALL)
