"""Targets on a device: brought there once where they fit, and without waiting."""

from __future__ import annotations

import weakref
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import torch
from jaxtyping import Float, UInt8
from torch import Tensor

from sacha_core.raster.camera import Camera
from sacha_core.train.cuda.drawing import Cameras
from sacha_core.train.views import Target

__all__ = ["DeviceTargets", "TargetBatch", "upload"]


@dataclass(frozen=True)
class TargetBatch:
    """c targets of one image size.

    Args:
        cameras: theirs.
        image: (c, 3, h, w) RGB.
        sensitivity: (c, h, w) reference sensitivity, 255 stands for 1.
    """

    cameras: Cameras
    image: UInt8[Tensor, "c 3 h w"]
    sensitivity: UInt8[Tensor, "c h w"]

    def __len__(self) -> int:
        """Give the number of targets."""
        return len(self.image)


@dataclass(frozen=True)
class Kept:
    """One target on the device, for as long as the one on the host lives."""

    host: weakref.ref[Target]
    image: UInt8[Tensor, "3 h w"]
    sensitivity: UInt8[Tensor, "h w"]
    camera: Float[Tensor, "28"]

    @property
    def n_bytes(self) -> int:
        return self.image.nbytes + self.sensitivity.nbytes + self.camera.nbytes


class DeviceTargets:
    """Keeps targets on a device.

    One is kept while its host copy lives and as long as there is room: a target that the host decodes anew each time would fill the
    device with what is never asked for again.

    Args:
        device: where to.
        room_bytes: at most to be kept.
    """

    def __init__(self, device: torch.device, room_bytes: int) -> None:
        self._device, self._room = device, room_bytes
        self._kept: dict[int, Kept] = {}

    def batches(self, targets: Sequence[Target]) -> list[TargetBatch]:
        """Give the targets by image size, in the order in which sizes first occur."""
        by_size: dict[tuple[int, ...], list[Target]] = {}
        for target in targets:
            by_size.setdefault(target.sensitivity.shape, []).append(target)
        return [self._batch(group) for group in by_size.values()]

    def _batch(self, targets: Sequence[Target]) -> TargetBatch:
        kept = [self._bring(target) for target in targets]
        numbers = stacked([one.camera for one in kept])
        height, width = targets[0].sensitivity.shape
        matrices, intrinsics, centres = numbers.split_with_sizes([16, 9, 3], 1)
        cameras = Cameras(matrices.view(-1, 4, 4), intrinsics.view(-1, 3, 3), centres, width, height)
        return TargetBatch(cameras, stacked([one.image for one in kept]), stacked([one.sensitivity for one in kept]))

    def _bring(self, target: Target) -> Kept:
        key = id(target)
        if key in self._kept:
            return self._kept[key]
        arrays = (target.image, target.sensitivity, camera_numbers(target.camera))
        one = Kept(weakref.ref(target, lambda _: self._forget(key)), *(upload(array, self._device) for array in arrays))
        if one.n_bytes <= self._room:
            self._room -= one.n_bytes
            self._kept[key] = one
        return one

    def _forget(self, key: int) -> None:
        if key in self._kept:
            self._room += self._kept.pop(key).n_bytes


def stacked(tensors: Sequence[Tensor]) -> Tensor:
    """Give tensors under one another; a single one is not copied."""
    return tensors[0][None] if len(tensors) == 1 else torch.stack(list(tensors))


def upload(array: np.ndarray, device: torch.device) -> Tensor:
    """Give an array on a device, without waiting for it: the copy goes by way of memory that the device can reach."""
    tensor = torch.from_numpy(np.array(array, order="C"))
    return tensor.pin_memory().to(device, non_blocking=True) if device.type == "cuda" else tensor.to(device)


def camera_numbers(camera: Camera) -> Float[np.ndarray, "28"]:
    """Give a camera as float32: world to camera (4 x 4), intrinsics (3 x 3), and where it stands."""
    matrix = np.eye(4)
    matrix[:3, :3], matrix[:3, 3] = camera.rotation, camera.translation
    intrinsics = np.array([[camera.fx, 0, camera.cx], [0, camera.fy, camera.cy], [0, 0, 1]])
    return np.concatenate([matrix.ravel(), intrinsics.ravel(), np.ravel(camera.centre)]).astype(np.float32)
