"""What a run looks at before it begins: the scene's extent, poses, and devices."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from sacha_core.errors import DatasetError, OptionError
from sacha_core.train import devices
from sacha_core.train.checkpoint import read_checkpoint, write_checkpoint
from sacha_core.train.loop import train
from sacha_core.train.options import TrainOptions
from sacha_core.train.output import CHECKPOINT
from sacha_core.train.presets import scaled
from sacha_core.train.scene import scene_extent


def test_the_extent_is_that_of_the_ring_of_cameras(tiny) -> None:
    assert scene_extent(tiny.capture, tiny.head) == pytest.approx(1.1 * 0.5 * np.hypot(1, 0.3), rel=1e-6)


def test_one_camera_before_a_head_that_moves_has_half_its_distance(tiny) -> None:
    view = tiny.capture.train[0]
    translation = np.array([[0, 0, 0], [0, 0, 0.2], [9, 9, 9]], np.float32)
    capture = replace(
        tiny.capture,
        train=(view, replace(view, timestep=1)),
        motion=replace(tiny.capture.motion, translation=translation),
    )
    centre = view.camera.centre - tiny.head.v_template.mean(axis=0)
    far = [np.linalg.norm(centre - moved) for moved in translation[:2]]
    assert scene_extent(capture, tiny.head) == pytest.approx(0.5 * np.mean(far), rel=1e-6)


def test_no_view_and_a_camera_nowhere_are_refused(tiny) -> None:
    with pytest.raises(DatasetError, match="no view to train on"):
        scene_extent(replace(tiny.capture, train=()), tiny.head)
    view = tiny.capture.train[0]
    nowhere = replace(view, camera=replace(view.camera, translation=np.full(3, np.nan)))
    with pytest.raises(DatasetError, match="extent of the scene is nan m"):
        scene_extent(replace(tiny.capture, train=(nowhere,)), tiny.head)


def test_auto_is_the_processor_without_a_gpu_and_cuda_is_refused_with_the_reason(monkeypatch) -> None:
    monkeypatch.setattr(devices, "missing", lambda: "gsplat is not installed: get it")
    monkeypatch.setattr(devices, "available", lambda: False)
    assert devices.find_device("auto") == "cpu"
    assert devices.find_device("cpu") == "cpu"
    with pytest.raises(OptionError, match="device is cuda, but gsplat is not installed: get it"):
        devices.find_device("cuda")
    monkeypatch.setattr(devices, "missing", lambda: None)
    monkeypatch.setattr(devices, "available", lambda: True)
    assert devices.find_device("auto") == devices.find_device("cuda") == "cuda"


def test_absolute_gradients_are_refused_on_the_processor(tiny, tmp_path) -> None:
    options = scaled(40, "default", TrainOptions(device="cpu"))
    with pytest.raises(OptionError, match=r"density\.gradient is absolute"):
        train(
            tiny.capture, tiny.head, replace(options, density=replace(options.density, gradient="absolute")), tmp_path
        )


def test_a_run_goes_on_where_it_was_unless_told_otherwise(tiny, tmp_path, monkeypatch) -> None:
    options = scaled(20, "default", TrainOptions(threads=1, sh_degree=0))
    monkeypatch.setattr("sacha_core.train.devices.available", lambda: False)
    model = train(tiny.capture, tiny.head, options, tmp_path)
    path = tmp_path / CHECKPOINT
    checkpoint = read_checkpoint(path)
    assert checkpoint.options.device == "cpu"  # not auto: the next run shall know

    monkeypatch.setattr("sacha_core.train.devices.available", lambda: True)  # a GPU has come
    again = train(tiny.capture, tiny.head, options, tmp_path)
    assert read_checkpoint(path).options.device == "cpu"
    assert np.array_equal(again.gaussians.position, model.gaussians.position)

    write_checkpoint(path, replace(checkpoint, options=replace(checkpoint.options, device="cuda")))
    monkeypatch.setattr("sacha_core.train.loop.missing", lambda: "there is no GPU")
    with pytest.raises(OptionError, match="is of a run on cuda, but there is no GPU; choose the device cpu"):
        train(tiny.capture, tiny.head, options, tmp_path)
    deliberate = train(tiny.capture, tiny.head, replace(options, device="cpu"), tmp_path)
    assert np.array_equal(deliberate.gaussians.position, model.gaussians.position)
