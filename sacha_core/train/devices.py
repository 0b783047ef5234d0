"""Which engine a run computes with."""

from __future__ import annotations

import importlib
from typing import Literal

from sacha_core.errors import OptionError
from sacha_core.flame.model import HeadModel
from sacha_core.flame.posing import HeadMotion
from sacha_core.train.cuda.available import available, missing
from sacha_core.train.engine import Engine
from sacha_core.train.options import TrainOptions

__all__ = ["Device", "find_device", "open_engine"]

Device = Literal["cpu", "cuda"]


def find_device(wanted: Literal["auto", "cpu", "cuda"]) -> Device:
    """Give the device to compute on: what is wanted, or for `auto` CUDA where it can be had.

    Raises:
        OptionError: CUDA is wanted and cannot be had; the message says why.
    """
    if wanted == "cuda" and (lack := missing()) is not None:
        raise OptionError(f"device is cuda, but {lack}")
    if wanted == "auto":
        return "cuda" if available() else "cpu"
    return wanted


def open_engine(device: Device, head: HeadModel, motion: HeadMotion, options: TrainOptions) -> Engine:
    """Make the engine of a device; torch is imported for CUDA alone.

    Raises:
        HeadError: the motion has components or vertex offsets that the head lacks.
        OptionError: an option is not for this device.
    """
    module, kind = {"cpu": ("cpu_engine", "CpuEngine"), "cuda": ("cuda.engine", "CudaEngine")}[device]
    engine: Engine = getattr(importlib.import_module(f"sacha_core.train.{module}"), kind)(head, motion, options)
    return engine
