"""Fine-tuning through the quantiser. The oracle are pictures of what the decoder gives, by cameras that it never learnt from."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from sacha_core.codec import decode, encode
from sacha_core.errors import OptionError
from sacha_core.geometry.triangle import triangle_frames
from sacha_core.perception.psnr import psnr
from sacha_core.raster.scene import render_avatar
from sacha_core.rate.curvature import importance_of
from sacha_core.rate.finetune import TuningOptions, finetune
from sacha_core.rate.pictures import own_pictures
from sacha_core.rate.quantised import quantised
from sacha_core.rate.views import protocol_shots

LEVEL = 1
GAINED_DB = 0.5  # at least; about 2 dB are typical
SAME_SIZE = 1.03  # of the file, at most
SAVED = 0.995  # of the bytes, by a few steps on Gaussians that have nothing in common
SAME_PICTURE_DB = 75.0  # quaternions rounded another way, which may move an edge at 1/255 by a pixel


def test_tuned_file_looks_more_like_the_avatar_at_the_same_size(avatar, head):
    poses, steps = own_pictures(avatar, head, 4, 3, 0, 0.5)
    posed = replace(avatar, motion=poses)
    tuned = replace(avatar, gaussians=finetune(posed, head, LEVEL, steps, options=TuningOptions(80)))
    files = [encode(one, LEVEL, head=head) for one in (avatar, tuned)]
    shots = protocol_shots(posed, head, 2, 0.25)

    def picture_quality(data):
        back = decode(data, head=head).gaussians
        found = []
        for shot in shots:
            for camera in shot.cameras[::5]:
                pictures = [render_avatar(one, shot.frames, camera).colour for one in (avatar.gaussians, back)]
                found.append(psnr(*pictures))
        return np.mean(found)

    assert picture_quality(files[1]) > picture_quality(files[0]) + GAINED_DB
    assert len(files[1]) < SAME_SIZE * len(files[0])


def test_file_is_smaller_where_its_bits_count(avatar, head):
    """Oracle: the encoder. Bits that count a hundred times what they are worth are saved, whatever becomes of pictures."""
    poses, steps = own_pictures(avatar, head, 2, 2, 0, 0.5)
    posed, importance = replace(avatar, motion=poses), importance_of(avatar, head)
    sizes = []
    for rate in (0.0, 100.0):
        found = finetune(posed, head, LEVEL, steps, importance, TuningOptions(30, rate=rate))
        sizes.append(len(encode(replace(avatar, gaussians=found), LEVEL, head=head, importance=importance)))
    assert sizes[1] < SAVED * sizes[0]


def test_threads_change_nothing(avatar, head):
    poses, steps = own_pictures(avatar, head, 2, 1, 0, 0.5)
    posed = replace(avatar, motion=poses)
    one, two = (finetune(posed, head, LEVEL, steps, options=TuningOptions(6, 3, threads=n)) for n in (1, 2))
    for name in ("position", "log_scale", "quaternion", "opacity_logit", "sh_dc", "sh_rest"):
        np.testing.assert_array_equal(getattr(one, name), getattr(two, name))


def test_quantised_gaussians_are_the_decoded_ones_in_the_order_given(avatar, head):
    found = quantised(avatar, head, LEVEL)
    back = decode(encode(avatar, LEVEL, head=head), head=head).gaussians
    assert found.kept.sum() == len(back)
    frames = triangle_frames(head.v_template, head.faces)
    camera = protocol_shots(avatar, head, 1, 0.25)[0].cameras[3]
    pictures = [render_avatar(one, frames, camera).colour for one in (found.gaussians, back)]
    assert psnr(*pictures) > SAME_PICTURE_DB
    moved = np.abs(found.gaussians.quaternion - avatar.gaussians.quaternion)[found.kept]
    assert np.median(moved) < 0.1 * np.median(
        np.abs(avatar.gaussians.quaternion)
    )  # not another description of the same turn


@pytest.mark.parametrize("rate", [-1.0, float("nan"), float("inf")])
def test_what_is_no_rate_is_refused(rate):
    with pytest.raises(OptionError, match="the rate counts"):
        TuningOptions(rate=rate)


def test_nothing_to_look_at_is_refused(avatar, head):
    with pytest.raises(OptionError, match="needs a motion and pictures"):
        finetune(avatar, head, LEVEL, [])
