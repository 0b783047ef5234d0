"""Targets on a device: the right numbers, kept as long as they may be."""

from __future__ import annotations

import gc
from dataclasses import replace

import numpy as np
import torch
from cuda_scenes import CPU

from sacha_core.train.cuda.targets import DeviceTargets

PLENTY = 1 << 30


def test_targets_come_by_size_with_their_cameras(stage) -> None:
    targets = [stage.targets[i] for i in (0, 3, 2)]
    wide, tall = DeviceTargets(CPU, 0).batches(targets)
    assert (len(wide), len(tall)) == (2, 1)
    for batch, group in ((wide, (targets[0], targets[2])), (tall, (targets[1],))):
        for i, target in enumerate(group):
            camera, seen = target.camera, batch.cameras
            assert np.array_equal(batch.image[i].numpy(), target.image)
            assert np.array_equal(batch.sensitivity[i].numpy(), target.sensitivity)
            assert (seen.width, seen.height) == (camera.width, camera.height)
            x = np.array([0.02, -0.03, 0.01])
            point = seen.world_to_camera[i].double().numpy() @ [*x, 1]
            assert np.allclose(point[:3], camera.rotation @ x + camera.translation, atol=1e-7)
            u, v, depth = seen.intrinsics[i].double().numpy() @ point[:3]
            assert np.allclose((u / depth, v / depth), (
                camera.fx * point[0] / point[2] + camera.cx, camera.fy * point[1] / point[2] + camera.cy))  # fmt: skip
            assert np.allclose(seen.centres[i], camera.centre, atol=1e-7)


def test_a_target_is_brought_once_while_there_is_room(stage) -> None:
    one, other = (replace(target) for target in stage.targets[:2])
    first = DeviceTargets(CPU, PLENTY)
    assert first.batches([one])[0].image.data_ptr() == first.batches([one])[0].image.data_ptr()
    none = DeviceTargets(CPU, 0)
    kept = none.batches([one])[0].image
    assert none.batches([one])[0].image.data_ptr() != kept.data_ptr()
    just = DeviceTargets(CPU, one.image.nbytes + one.sensitivity.nbytes + 28 * 4)
    assert just.batches([one])[0].image.data_ptr() == just.batches([one])[0].image.data_ptr()
    assert not torch.equal(just.batches([one])[0].image, just.batches([other])[0].image)


def test_room_is_given_back_when_the_host_lets_a_target_go(stage) -> None:
    one = replace(stage.targets[0])
    targets = DeviceTargets(CPU, one.image.nbytes + one.sensitivity.nbytes + 28 * 4)
    targets.batches([one])
    assert targets._room == 0
    del one
    gc.collect()
    assert targets._room > 0
    assert not targets._kept
