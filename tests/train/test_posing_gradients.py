"""Oracles: the numpy twins for values; finite differences in float64 (torch's gradcheck) for gradients."""

from __future__ import annotations

import numpy as np
import pytest
import torch
from torch import Tensor

from sacha_core.avatar.binding import initial_gaussians
from sacha_core.avatar.binding import to_world as numpy_to_world
from sacha_core.avatar.gaussians import Gaussians
from sacha_core.avatar.motion import Motion
from sacha_core.errors import GeometryError
from sacha_core.flame.model import HeadModel
from sacha_core.flame.posing import Poser
from sacha_core.geometry import quaternion
from sacha_core.geometry.triangle import triangle_frames as numpy_frames
from sacha_core.train.binding import to_world, triangle_frames
from sacha_core.train.posing import DifferentiablePoser

ROUNDING_64 = 1e-12
ROUNDING_32 = 2e-5  # float32 on coordinates of a few metres through a chain of three joints
GRADIENT_32 = 1e-4  # relative to the largest entry; sums of some hundred float32 terms that partly cancel
PARAMETERS = ("expression", "rotation", "neck", "jaw", "eyes", "translation")


def random_head(n_joints: int, correctives: bool, v: int = 12) -> HeadModel:
    rng = np.random.default_rng(n_joints)
    weights, regressor = rng.random((v, n_joints)), rng.random((n_joints, v))
    weights[0, 1:] = 0
    return HeadModel(
        name="random",
        v_template=rng.normal(size=(v, 3)).astype(np.float32),
        faces=np.array([[0, 1, 2], [3, 4, 5], [6, 7, 8], [9, 10, 11], [2, 1, 7], [0, 8, 4]], np.int32),
        shapedirs=rng.normal(size=(v, 3, 2)).astype(np.float32),
        exprdirs=(rng.normal(size=(v, 3, 4)) / 10).astype(np.float32),
        J_regressor=(regressor / regressor.sum(axis=1, keepdims=True)).astype(np.float32),
        weights=(weights / weights.sum(axis=1, keepdims=True)).astype(np.float32),
        parents=np.array([-1, 0, 1, 1, 1], np.int32)[:n_joints],
        posedirs=(rng.normal(size=(v, 3, 9 * (n_joints - 1))) / 10).astype(np.float32) if correctives else None,
    )


def random_motion(rest: bool = False) -> Motion:
    rng = np.random.default_rng(7)
    size = 0.0 if rest else 1.0
    dynamic = {
        name: (size * rng.normal(size=(1, width))).astype(np.float32)
        for name, width in (
            ("expression", 4),
            ("rotation", 3),
            ("neck", 3),
            ("jaw", 3),
            ("eyes", 6),
            ("translation", 3),
        )
    }
    return Motion(shape=rng.normal(size=2).astype(np.float32), static_offset=np.zeros((0, 3), np.float32), **dynamic)


def tensors(motion: Motion, dtype: torch.dtype) -> list[Tensor]:
    return [torch.tensor(getattr(motion, name)[0], dtype=dtype, requires_grad=True) for name in PARAMETERS]


@pytest.mark.parametrize("n_joints", [1, 2, 5])
@pytest.mark.parametrize("correctives", [True, False])
def test_posing_agrees_with_numpy(n_joints: int, correctives: bool) -> None:
    head, motion = random_head(n_joints, correctives), random_motion()
    expected = Poser(head, motion, np.float64)(0)
    double = DifferentiablePoser(head, motion, np.float64)(*tensors(motion, torch.float64))
    single = DifferentiablePoser(head, motion)(*tensors(motion, torch.float32))
    assert (double.dtype, single.dtype) == (torch.float64, torch.float32)
    np.testing.assert_allclose(double.detach(), expected, atol=ROUNDING_64)
    np.testing.assert_allclose(single.detach(), expected, atol=ROUNDING_32)


@pytest.mark.parametrize("rest", [False, True], ids=["posed", "at rest, where Rodrigues' angle vanishes"])
@pytest.mark.parametrize(("n_joints", "correctives"), [(5, True), (5, False), (3, True), (1, False)])
def test_posing_gradients(n_joints: int, correctives: bool, rest: bool) -> None:
    motion = random_motion(rest)
    pose = DifferentiablePoser(random_head(n_joints, correctives), motion, np.float64)
    assert torch.autograd.gradcheck(pose, tensors(motion, torch.float64))


def random_vertices(n: int = 12) -> Tensor:
    return torch.tensor(np.random.default_rng(3).normal(size=(n, 3)), requires_grad=True)


FACES = np.array(
    [[0, 1, 2], [3, 4, 5], [6, 7, 8], [9, 10, 11], [2, 1, 7], [0, 8, 4], [5, 4, 3], [7, 2, 0], [11, 3, 1]], np.int32
)


def test_frames_agree_with_numpy() -> None:
    vertices = random_vertices(600).detach()
    faces = np.arange(600, dtype=np.int32).reshape(200, 3)
    frames, expected = triangle_frames(vertices, faces), numpy_frames(vertices.numpy(), faces)
    for name in ("rotation", "scale", "origin"):
        np.testing.assert_array_equal(getattr(frames, name), getattr(expected, name))
    np.testing.assert_allclose(frames.quaternion, quaternion.from_matrix(expected.rotation), atol=ROUNDING_64)


def test_frame_gradients() -> None:
    def outputs(vertices: Tensor) -> tuple[Tensor, ...]:
        frames = triangle_frames(vertices, FACES)
        return frames.rotation, frames.scale, frames.origin, frames.quaternion

    assert torch.autograd.gradcheck(outputs, (random_vertices(),))


def test_degenerate_triangles_are_named() -> None:
    vertices = random_vertices().detach()
    vertices[11] = vertices[10]
    with pytest.raises(GeometryError, match="triangle 3 has zero area"):
        triangle_frames(vertices, FACES)


def random_gaussians(n: int, n_faces: int) -> Gaussians:
    rng = np.random.default_rng(5)
    one = initial_gaussians(1, rng)
    return Gaussians(
        position=rng.normal(size=(n, 3)),
        log_scale=rng.normal(size=(n, 3)) / 2,
        quaternion=2 * rng.normal(size=(n, 4)),
        opacity_logit=np.zeros(n),
        sh_dc=np.zeros((n, 3)),
        sh_rest=np.zeros((n, *one.sh_rest.shape[1:])),
        binding=rng.integers(n_faces, size=n).astype(np.int32),
    )


def raw(gaussians: Gaussians, dtype: torch.dtype) -> list[Tensor]:
    return [
        torch.tensor(a, dtype=dtype, requires_grad=True)
        for a in (gaussians.position, gaussians.log_scale, gaussians.quaternion)
    ]


def test_to_world_agrees_with_numpy() -> None:
    gaussians, vertices = random_gaussians(500, len(FACES)), random_vertices().detach()
    expected = numpy_to_world(gaussians, numpy_frames(vertices.numpy(), FACES))
    for dtype in (torch.float64, torch.float32):
        world = to_world(*raw(gaussians, dtype), gaussians.binding, triangle_frames(vertices.to(dtype), FACES))
        for name in ("means", "scales", "quaternions"):
            assert getattr(world, name).dtype == dtype
            np.testing.assert_allclose(
                getattr(world, name).detach(), getattr(expected, name), rtol=ROUNDING_32, atol=ROUNDING_32
            )


def world_of(gaussians: Gaussians, *inputs: Tensor) -> tuple[Tensor, ...]:
    *own, vertices = inputs
    world = to_world(*own, gaussians.binding, triangle_frames(vertices, FACES))
    return world.means, world.scales, world.quaternions


def test_to_world_gradients_down_to_the_vertices() -> None:
    gaussians = random_gaussians(15, len(FACES))
    assert torch.autograd.gradcheck(
        lambda *t: world_of(gaussians, *t), (*raw(gaussians, torch.float64), random_vertices())
    )


def test_to_world_gradients_with_a_mesh_that_stands_still() -> None:
    gaussians, vertices = random_gaussians(15, len(FACES)), random_vertices().detach()
    assert torch.autograd.gradcheck(lambda *t: world_of(gaussians, *t, vertices), raw(gaussians, torch.float64))


def test_the_whole_chain_from_pose_to_world() -> None:
    head, motion = random_head(5, True), random_motion()
    gaussians = random_gaussians(8, head.n_faces)
    pose = DifferentiablePoser(head, motion, np.float64)

    def chain(*parameters: Tensor) -> tuple[Tensor, ...]:
        world = to_world(
            *raw(gaussians, torch.float64), gaussians.binding, triangle_frames(pose(*parameters), head.faces)
        )
        return world.means, world.scales, world.quaternions

    assert torch.autograd.gradcheck(chain, tensors(motion, torch.float64))


def test_float32_gradients_agree_with_float64() -> None:
    head, motion = random_head(5, True), random_motion()
    gaussians = random_gaussians(200, head.n_faces)
    weights = [torch.tensor(np.random.default_rng(i).normal(size=(200, c))) for i, c in enumerate((3, 3, 4))]
    gradients = {}
    for dtype, numpy_dtype in ((torch.float32, np.float32), (torch.float64, np.float64)):
        own, parameters = raw(gaussians, dtype), tensors(motion, dtype)
        vertices = DifferentiablePoser(head, motion, numpy_dtype)(*parameters)
        world = to_world(*own, gaussians.binding, triangle_frames(vertices, head.faces))
        loss = sum(
            (w.to(dtype) * t).sum()
            for w, t in zip(weights, (world.means, world.scales, world.quaternions), strict=True)
        )
        gradients[dtype] = torch.autograd.grad(loss, (*own, *parameters))
    for single, double in zip(gradients[torch.float32], gradients[torch.float64], strict=True):
        np.testing.assert_allclose(single, double, atol=GRADIENT_32 * float(double.abs().max()))


def test_the_same_bits_again() -> None:
    gaussians = random_gaussians(300, len(FACES))
    runs = []
    for _ in range(2):
        inputs = (*raw(gaussians, torch.float32), random_vertices().detach().float().requires_grad_())
        outputs = world_of(gaussians, *inputs)
        runs.append((*outputs, *torch.autograd.grad(sum(o.square().sum() for o in outputs), inputs)))
    for one, other in zip(*runs, strict=True):
        assert torch.equal(one, other)
