"""Posing, frames, binding and colours on a device: against the plain NumPy functions, and gradients against finite differences."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
import torch
from cuda_scenes import CPU, DEGREE
from scipy.spatial.transform import Rotation

from sacha_core.avatar.binding import to_world
from sacha_core.avatar.gaussians import Gaussians
from sacha_core.errors import GeometryError
from sacha_core.flame.posing import Poser
from sacha_core.geometry import triangle
from sacha_core.geometry.quaternion import from_matrix
from sacha_core.raster.harmonics import sh_colours
from sacha_core.train.cuda.binding import Binder
from sacha_core.train.cuda.harmonics import Harmonics
from sacha_core.train.cuda.posing import DeviceHead
from sacha_core.train.cuda.scene import Scene
from sacha_core.train.state import ATTRIBUTES, FITTED_MOTION

EXACT = 1e-12  # float64 sums in another order
SINGLE = 3e-7  # float32 sums of numbers of about 1 in another order; places are around 0.1 m
COLOURS = 2e-6  # float32, sums of sixteen terms
STEP = 1e-6  # of finite differences in float64
GRADIENTS = {"eps": STEP, "atol": 1e-7, "rtol": 1e-5}  # a slope's truncation is about the step, relative


def double(array: np.ndarray) -> torch.Tensor:
    return torch.tensor(np.asarray(array, np.float64), requires_grad=True)


def row_of(stage, frame: int) -> np.ndarray:
    return np.concatenate([getattr(stage.motion, name)[frame] for name in FITTED_MOTION])


@pytest.fixture(params=["five joints", "a root alone", "no correctives"])
def head(stage, request):
    if request.param == "a root alone":
        one = {"weights": np.ones((len(stage.head.v_template), 1), np.float32), "parents": np.array([-1], np.int32)}
        return replace(stage.head, **one, J_regressor=stage.head.J_regressor[:1], posedirs=None)
    return replace(stage.head, posedirs=None) if request.param == "no correctives" else stage.head


def test_a_pose_is_that_of_the_plain_poser(stage, head) -> None:
    poser = Poser(head, stage.motion)
    device = DeviceHead(head, stage.motion, CPU)
    for frame in range(len(poser)):
        posed = device.pose(torch.from_numpy(row_of(stage, frame)))
        assert np.abs(posed.numpy() - poser(frame)).max() < SINGLE


def test_joints_may_come_in_any_order_and_hang_on_each_other_as_they_like(stage) -> None:
    for parents in ([-1, 0, 1, 2, 3], [-1, 0, 1, 0, 2], [-1, -1, 1, 0, 3], [-1, 0, 1, 1, 0]):
        head = replace(stage.head, parents=np.array(parents, np.int32))
        posed = DeviceHead(head, stage.motion, CPU).pose(torch.from_numpy(row_of(stage, 1)))
        assert np.abs(posed.numpy() - Poser(head, stage.motion)(1)).max() < SINGLE, parents


def test_coefficients_without_a_direction_are_ignored(stage) -> None:
    device = DeviceHead(stage.head, stage.motion, CPU)
    row = torch.from_numpy(row_of(stage, 1))
    assert torch.equal(device.pose(torch.cat([row, torch.tensor([5.0, -3.0])])), device.pose(row))


def test_gradients_of_a_pose_are_those_of_finite_differences(stage, head) -> None:
    device = DeviceHead(head, stage.motion, CPU, torch.float64)
    assert torch.autograd.gradcheck(device.pose, [double(row_of(stage, 1))], fast_mode=True, **GRADIENTS)


def test_the_gradient_at_rest_is_finite(stage) -> None:
    device = DeviceHead(stage.head, stage.motion, CPU)
    still = torch.zeros(len(row_of(stage, 0)), requires_grad=True)
    (found,) = torch.autograd.grad(device.pose(still).square().sum(), [still])
    assert found.isfinite().all()
    assert found.all()


def test_frames_are_those_of_the_plain_function(stage) -> None:
    vertices = Poser(stage.head, stage.motion, np.float64)(2)
    expected = triangle.triangle_frames(vertices, stage.head.faces)
    frames = Binder(stage.head.faces, CPU, torch.float64).frames(torch.from_numpy(vertices))
    rotation, scale, origin, quaternion = (part.numpy() for part in frames.table.split([9, 1, 3, 4], 1))
    assert frames.sound.all()
    assert np.abs(rotation.reshape(-1, 3, 3) - expected.rotation).max() < EXACT
    assert np.abs(scale[:, 0] - expected.scale).max() < EXACT
    assert np.abs(origin - expected.origin).max() < EXACT
    assert np.abs(quaternion - from_matrix(expected.rotation)).max() < EXACT


def test_quaternions_are_right_whichever_component_is_largest() -> None:
    turns = Rotation.random(400, 0).as_matrix()
    vertices = np.stack([np.zeros((400, 3)), turns[:, :, 0], turns[:, :, 0] - turns[:, :, 2]], 1).reshape(-1, 3)
    frames = Binder(np.arange(1200).reshape(-1, 3), CPU, torch.float64).frames(torch.from_numpy(vertices))
    rotation, quaternion = frames.table[:, :9].view(-1, 3, 3).numpy(), frames.table[:, 13:].numpy()
    assert len(set(np.abs(quaternion).argmax(1))) == 4
    assert np.abs(quaternion - from_matrix(rotation)).max() < EXACT


@pytest.mark.parametrize(
    "corners",
    [
        [[0, 0, 0], [1, 0, 0], [2, 0, 0]],
        [[0, 0, 0], [0, 0, 0], [1, 1, 0]],
        [[0, 0, 0], [1, 0, 0], [1, 1e-7, 0]],
        [[0, 0, 0], [np.nan, 0, 0], [1, 1, 0]],
        [[0, 0, 0], [np.inf, 0, 0], [1, 1, 0]],
        [[0, 0, 0], [1e-20, 0, 0], [0, 1e-20, 0]],
        [[0, 0, 0], [1e-9, 0, 0], [0, 1e-9, 0]],
        [[0, 0, 0], [3e-10, 0, 0], [0, 3e-10, 0]],
        [[0, 0, 0], [1, 0, 0], [1, 1e-4, 0]],
    ],
)
def test_a_triangle_is_unsound_where_the_plain_function_refuses_it(corners) -> None:
    vertices, faces = np.array(corners, np.float32), np.array([[0, 1, 2]], np.int32)
    try:
        triangle.triangle_frames(vertices, faces)
        refused = False
    except GeometryError:
        refused = True
    frames = Binder(faces, CPU).frames(torch.from_numpy(vertices))
    assert bool(frames.sound[0]) != refused


def test_gaussians_are_carried_as_the_plain_function_carries_them(stage, state) -> None:
    vertices = torch.from_numpy(Poser(stage.head, stage.motion)(1))
    binder = Binder(stage.head.faces, CPU)
    plain = triangle.triangle_frames(vertices.numpy(), stage.head.faces)
    attributes = {
        name: state.values[name]
        for name in ("position", "log_scale", "quaternion", "opacity_logit", "sh_dc", "sh_rest")
    }
    expected = to_world(Gaussians(**attributes, binding=state.binding), plain)
    local = (torch.from_numpy(state.values[name]) for name in ("position", "log_scale", "quaternion"))
    means, scales, quaternions = binder.carry(*local, torch.from_numpy(state.binding), binder.frames(vertices))
    assert np.abs(means.numpy() - expected.means).max() < SINGLE
    assert np.abs(scales.numpy() - expected.scales).max() < SINGLE
    assert np.abs(quaternions.numpy() - expected.quaternions).max() < SINGLE


def test_gradients_of_carrying_are_those_of_finite_differences(stage, state) -> None:
    rows = slice(0, 12)
    binding = torch.from_numpy(state.binding[rows])
    binder = Binder(stage.head.faces[:6], CPU, torch.float64)

    def carried(vertices, position, log_scale, quaternion):
        return binder.carry(position, log_scale, quaternion, binding, binder.frames(vertices))

    local = [double(state.values[name][rows]) for name in ("position", "log_scale", "quaternion")]
    vertices = double(stage.head.v_template * 10)
    assert torch.autograd.gradcheck(carried, [vertices, *local], **GRADIENTS)


@pytest.mark.parametrize("degree", range(DEGREE + 1))
def test_colours_are_those_of_the_cpu(state, stage, degree) -> None:
    rng = np.random.default_rng(0)
    dc, rest = state.values["sh_dc"], state.values["sh_rest"]
    means = rng.normal(0, 0.1, (len(state), 3)).astype(np.float32)
    centres = np.array([target.camera.centre for target in stage.targets[:3]], np.float32)
    means[0], means[1] = np.nan, centres[0]
    found = Harmonics(CPU).colours(*(torch.from_numpy(a) for a in (dc, rest, means, centres)), degree)
    assert found.isfinite().all()
    for one, centre in zip(found.numpy(), centres, strict=True):
        expected = sh_colours(dc, rest, means, centre, degree)
        assert np.abs(one - expected)[2:].max() < COLOURS


def test_gradients_of_colours_are_those_of_finite_differences() -> None:
    rng = np.random.default_rng(1)
    harmonics = Harmonics(CPU, torch.float64)
    inputs = [
        double(rng.normal(0, spread, shape))
        for spread, shape in ((1, (6, 3)), (0.3, (6, 15, 3)), (0.1, (6, 3)), (1, (2, 3)))
    ]
    assert torch.autograd.gradcheck(
        lambda *given: harmonics.colours(*given, DEGREE), inputs, fast_mode=True, **GRADIENTS
    )


def test_a_whole_pose_tells_whether_it_has_an_area_everywhere(stage, state) -> None:
    values = {name: torch.from_numpy(state.values[name]) for name in ATTRIBUTES}
    scene, row = Scene(stage.head, stage.motion, CPU), torch.from_numpy(row_of(stage, 1))
    binding = torch.from_numpy(state.binding)
    assert scene.place(values, row, binding)[2]
    row[15] = torch.nan
    assert not scene.place(values, row, binding)[2]
