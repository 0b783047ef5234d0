"""Figures over many images and within regions. Oracles: the metrics called by hand, and a loop over pixels."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from sacha_core.errors import OptionError
from sacha_core.evaluate import picture_metrics
from sacha_core.evaluate.picture_metrics import PictureMetrics
from sacha_core.evaluate.region_masks import NOWHERE, RegionMasks
from sacha_core.evaluate.views import evaluate_avatar, score_views
from sacha_core.flame.posing import Poser
from sacha_core.geometry.triangle import triangle_frames
from sacha_core.perception.flip import flip_map
from sacha_core.perception.psnr import psnr
from sacha_core.raster.scene import render_avatar
from sacha_core.regions.scheme import PAPER

SUMMED_IN_ANOTHER_ORDER = 1e-9  # relative; float64 sums of some thousand figures


def test_regions_against_a_loop_over_pixels(subject) -> None:
    faded = replace(subject.gaussians, opacity_logit=subject.gaussians.opacity_logit - 1)
    masks = RegionMasks(subject.capture, subject.head)
    views = subject.capture.test
    metrics = ("psnr", "ssim", "flip")
    found = score_views(
        faded, subject.head, subject.motion, subject.capture, views, metrics=metrics, masks=masks
    ).quality
    pose = Poser(subject.head, subject.motion)
    pixels: dict[str, list[tuple[float, float]]] = {name: [] for name in PAPER.regions}
    flips = []
    for view in views:
        frames = triangle_frames(pose(view.timestep), subject.head.faces)
        drawn = np.clip(render_avatar(faded, frames, view.camera).colour.astype(np.float64), 0, 1)
        truth = subject.capture.image(view)
        errors, mask = flip_map(drawn, truth), masks.region_of_pixel(view)
        flips.append(errors.mean(dtype=np.float64))
        for y, x in np.argwhere(mask != NOWHERE):
            squared = float(np.mean((drawn[y, x] - truth[y, x] / 255) ** 2))
            pixels[PAPER.regions[mask[y, x]]].append((squared, float(errors[y, x])))
    assert found.n_images == len(views)
    assert found.flip == pytest.approx(np.mean(flips), rel=SUMMED_IN_ANOTHER_ORDER)
    for name, region in found.regions.items():
        assert region.pixels == len(pixels[name])
        if region.pixels:
            squared, flip = np.mean(pixels[name], axis=0)
            assert region.psnr == pytest.approx(-10 * np.log10(squared), rel=SUMMED_IN_ANOTHER_ORDER)
            assert region.flip == pytest.approx(flip, rel=SUMMED_IN_ANOTHER_ORDER)
    assert sum(region.pixels for region in found.regions.values()) > 1000


def test_one_region_that_is_everything_has_the_images_own_figures(subject) -> None:
    view = subject.capture.val[0]
    truth = subject.capture.image(view)
    drawn = np.clip(truth / np.float32(255) + np.float32(0.1), 0, 1)
    measured = PictureMetrics(("psnr", "flip"))
    measured.add(view, drawn, truth, np.full(truth.shape[:2], PAPER.label("nose"), np.uint8))
    scores = measured.scores()
    nose, ears = scores.regions["nose"], scores.regions["ears"]
    assert nose.psnr == pytest.approx(psnr(drawn, truth), rel=SUMMED_IN_ANOTHER_ORDER)
    assert nose.flip == pytest.approx(scores.quality.flip, rel=SUMMED_IN_ANOTHER_ORDER)
    assert nose.pixels == truth.shape[0] * truth.shape[1]
    assert (ears.psnr, ears.flip, ears.pixels) == (None, None, 0)


def test_a_region_in_which_nothing_differs_has_no_psnr(subject) -> None:
    view = subject.capture.val[0]
    truth = subject.capture.image(view)
    measured = PictureMetrics()
    measured.add(view, truth / 255.0, truth, np.zeros(truth.shape[:2], np.uint8))
    assert measured.scores().regions[PAPER.regions[0]].psnr is None


def test_what_is_not_asked_for_is_not_measured(subject) -> None:
    scores = evaluate_avatar(subject.gaussians, subject.head, subject.capture, limit=2, metrics=("psnr",)).novel_view
    assert np.isnan(scores.ssim)
    assert scores.quality.flip is None
    assert scores.regions == {}
    with pytest.raises(OptionError, match="'vmaf'"):
        PictureMetrics(("vmaf",))


def test_flip_without_its_package_is_refused_before_anything_is_drawn(subject, monkeypatch) -> None:
    monkeypatch.setattr(picture_metrics, "flip_lacks", lambda: "FLIP needs something")
    with pytest.raises(OptionError, match="FLIP needs something"):
        PictureMetrics(("flip",))
    PictureMetrics(("psnr", "ssim"))
