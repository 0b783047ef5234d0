"""Faults found on a device: each cause by its name and row, and the earlier cause before the later."""

from __future__ import annotations

import numpy as np
import pytest
import torch
from cuda_scenes import CPU

from sacha_core.train.cuda.faults import DeviceFaults
from sacha_core.train.cuda.layout import NAMES, Layout
from sacha_core.train.faults import LARGEST_GRADIENT, Fault, Faults

N, T = 11, 4
LAYOUT = Layout(((N, 3),) * 7, T, (5,) * 6)
ITERATION, TIMESTEP = 17, 2


class Scene:
    """What a step without fault hands over, to be spoilt."""

    def __init__(self) -> None:
        self.posed = torch.tensor(True)
        self.colours = torch.ones(2, N, 4)
        self.gradient = torch.full((LAYOUT.size,), LARGEST_GRADIENT)
        self.loss = torch.tensor(1.0)
        self.found = DeviceFaults(LAYOUT, CPU)

    def sound(self, iteration: int = ITERATION) -> bool:
        moment = torch.tensor([iteration, TIMESTEP])
        return bool(self.found.note(moment, self.posed, self.colours, self.gradient, self.loss))

    def spoil(self, name: str, row: int, value: float) -> None:
        LAYOUT.views(self.gradient)[name][row, 1] = value

    def first(self) -> Fault | None:
        return self.found.drain(Faults()).first


@pytest.fixture
def scene() -> Scene:
    return Scene()


def test_numbers_up_to_the_limit_are_no_fault(scene) -> None:
    assert scene.sound()
    assert scene.found.drain(Faults()) == Faults()


@pytest.mark.parametrize("value", [np.nan, np.inf, -np.inf, 2 * LARGEST_GRADIENT])
@pytest.mark.parametrize("name", NAMES)
def test_a_gradient_is_named_by_parameter_and_row(scene, name, value) -> None:
    motion = NAMES.index(name) >= 7
    scene.spoil(name, TIMESTEP if motion else 9, value)
    assert not scene.sound()
    assert scene.first() == Fault(ITERATION, name, TIMESTEP if motion else 9)


def test_the_lowest_row_comes_first_and_then_the_order_of_causes(scene) -> None:
    scene.spoil("position", 8, np.nan)
    scene.spoil("sh_rest", 5, np.nan)
    scene.spoil("quaternion", 5, np.nan)
    scene.spoil("expression", TIMESTEP, np.nan)
    scene.sound()
    assert scene.first() == Fault(ITERATION, "sh_rest", 5)


def test_causes_come_in_the_order_in_which_a_step_meets_them(scene) -> None:
    scene.loss = torch.tensor(torch.inf)
    assert not scene.sound()
    assert scene.first() == Fault(ITERATION, "loss", TIMESTEP)
    scene.spoil("neck", TIMESTEP, np.nan)
    scene.sound()
    assert scene.first() == Fault(ITERATION, "neck", TIMESTEP)
    scene.spoil("position", 0, np.nan)
    scene.sound()
    assert scene.first() == Fault(ITERATION, "position", 0)
    scene.colours[1, 6, 2] = scene.colours[0, 10, 3] = torch.nan
    scene.sound()
    assert scene.first() == Fault(ITERATION, "colour", 6)
    scene.posed = torch.tensor(False)
    scene.sound()
    assert scene.first() == Fault(ITERATION, "pose", TIMESTEP)


def test_all_are_counted_and_the_first_is_kept(scene) -> None:
    scene.spoil("sh_dc", 3, np.nan)
    scene.sound(4)
    scene.spoil("position", 1, np.nan)
    scene.sound(5)
    scene.sound(6)
    faults = scene.found.drain(Faults())
    assert faults == Faults(3, Fault(4, "sh_dc", 3))
    scene.sound(7)
    assert scene.found.drain(faults) == Faults(4, Fault(4, "sh_dc", 3))
    assert scene.found.drain(faults) is faults
