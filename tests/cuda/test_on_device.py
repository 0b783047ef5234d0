"""What only a device can show; where there is none, the parts that need no device run with the stand-in, and the others are skipped.

SACHA_REQUIRE_CUDA=1 turns the skips into failures.
"""

from __future__ import annotations

import copy
import importlib
import os
import warnings
from dataclasses import dataclass, replace
from typing import Any

import gsplat_stand_in
import numpy as np
import pytest
import torch
from cuda_scenes import DEGREE

from sacha_core.bench import exact
from sacha_core.raster.camera import Camera
from sacha_core.raster.rasteriser import NEAR
from sacha_core.raster.splats import Splats
from sacha_core.train.cpu_engine import CpuEngine
from sacha_core.train.cuda.available import missing
from sacha_core.train.cuda.drawing import BACKGROUND, Cameras, Drawer, World
from sacha_core.train.cuda.engine import CudaEngine
from sacha_core.train.cuda.targets import camera_numbers
from sacha_core.train.options import TrainOptions
from sacha_core.train.state import ATTRIBUTES

# Relative distance of a decision (alpha at 1/255, transmittance at 1e-4) from its threshold within which float32, with the device's quick
# exponential, may decide otherwise
BAND = 1e-4
IMAGE = 2e-5  # outside the band: float32 sums of a hundred terms, and a quick exponential
FLIP = 2 / 255  # inside it: one Gaussian at the threshold more or less, and what lies behind it
FLIPS = 0.02  # share of pixels that may be in the band at all, so that the band explains and does not excuse
COSINE = 1e-5  # short of 1: a gradient crosses the band, too
STEP_COSINE = 1e-4  # of a whole step, posing included
DRIFT = 1e-4  # of two runs of the same step, relative to the largest gradient: sums of some thousand float32 numbers in any order
RECORDED = 1e-5  # graphs change no arithmetic, only the order of atomic additions differs from run to run
RATES = dict.fromkeys((*ATTRIBUTES, "rotation", "neck", "jaw", "eyes", "translation", "expression"), 0.001)


@dataclass(frozen=True)
class Place:
    """Where to draw, and by what."""

    device: str
    gsplat: Any

    def engine(self, stage, graphs: bool = False, **options) -> CudaEngine:
        return CudaEngine(
            stage.head, stage.motion, TrainOptions(threads=1, **options), self.device, self.gsplat, graphs
        )


def device() -> Place:
    """Give the device, or skip."""
    if (lack := missing()) is not None:
        if os.environ.get("SACHA_REQUIRE_CUDA") == "1":
            pytest.fail(f"SACHA_REQUIRE_CUDA is set, but {lack}")
        pytest.skip(lack)
    return Place("cuda", importlib.import_module("gsplat"))


@pytest.fixture(params=["stand-in", "device"])
def place(request: pytest.FixtureRequest) -> Place:
    """Give the stand-in on the CPU, and gsplat on the device."""
    return Place("cpu", gsplat_stand_in) if request.param == "stand-in" else device()


@pytest.fixture
def gpu() -> Place:
    """Give gsplat on the device."""
    return device()


def splats(seed: int, n: int = 60, opaque: bool = False) -> Splats:
    """Give n Gaussians around the origin; if wanted some so opaque that alpha is held at its highest."""
    rng = np.random.default_rng(seed)
    arrays = (
        rng.normal(size=(n, 3)) * 0.15,
        0.02 * np.exp(rng.normal(size=(n, 3)) * 0.6),
        rng.normal(size=(n, 4)),
        rng.uniform(0.02, 0.97, n),
        rng.uniform(0, 1, (n, 4)),
    )
    if opaque:
        arrays[3][::7] = 1
        arrays[1][::7] *= 3
    return Splats(*(array.astype(np.float32) for array in arrays))


def camera() -> Camera:
    looking = Camera.look_at(np.array([0.3, 0.2, 0.95]), np.array([0.01, -0.02, 0.0]), 45, 70, 75.0)
    return Camera(45, 70, 75.0, 82.0, 23.8, 34.3, looking.rotation, looking.translation)


def world_of(scene: Splats, where: str, learn: bool = False) -> tuple[World, torch.Tensor]:
    names = ("means", "scales", "quaternions", "opacities", "colours")
    *world, colours = (torch.tensor(getattr(scene, name), device=where, requires_grad=learn) for name in names)
    return World(*world), colours


def cameras_of(view: Camera, where: str) -> Cameras:
    numbers = torch.from_numpy(camera_numbers(view))[None].to(where)
    matrix, intrinsics, centre = numbers.split([16, 9, 3], 1)
    return Cameras(matrix.view(1, 4, 4), intrinsics.view(1, 3, 3), centre, view.width, view.height)


def exact_frame(scene: Splats, view: Camera, learn: bool = False):
    depths = (scene.means @ view.rotation[2] + view.translation[2]).astype(np.float32)
    leaves = exact.leaves_of(scene, learn)
    return exact.draw(leaves, view, np.array(BACKGROUND), depths), leaves


def cosine(one: np.ndarray, other: np.ndarray) -> float:
    a, b = one.ravel().astype(float), other.ravel().astype(float)
    return float(a @ b / np.sqrt((a @ a) * (b @ b)))


@pytest.mark.parametrize("seed", range(3))
@pytest.mark.parametrize("opaque", [False, True])
def test_a_picture_is_the_exact_one_but_for_decisions_at_a_threshold(place, seed, opaque) -> None:
    scene, view = splats(seed, opaque=opaque), camera()
    frame, _ = exact_frame(scene, view)
    world, colours = world_of(scene, place.device)
    drawing = Drawer(place.gsplat, torch.device(place.device)).draw(
        world, colours[None], cameras_of(view, place.device)
    )
    error = np.abs(drawing.image[0].cpu().numpy() - frame.image.permute(1, 2, 0).numpy()).max(axis=2)
    _, row, column, _ = (index[frame.decisions.clamped].numpy() for index in frame.decisions.blended)
    held = np.zeros_like(error, bool)
    held[row, column] = True  # gsplat up to 1.5 holds alpha at 0.999 there
    band = (frame.band < BAND) & ~held
    assert error[~band & ~held].max() < IMAGE
    assert error[band].max(initial=0) < FLIP
    assert error[held].max(initial=0) < 1 - exact.ALPHA_MAX
    assert band.mean() < FLIPS
    assert held.any() == opaque


def test_what_is_too_close_is_not_drawn(place) -> None:
    scene, view = splats(0), camera()
    ahead = (0.9 * NEAR * view.rotation[2] + view.centre).astype(np.float32)
    images = []
    for opacity in (0.0, 0.9):
        near = replace(scene, means=scene.means.copy(), opacities=scene.opacities.copy())
        near.means[0], near.opacities[0] = ahead, opacity
        world, colours = world_of(near, place.device)
        drawer = Drawer(place.gsplat, torch.device(place.device))
        images.append(drawer.draw(world, colours[None], cameras_of(view, place.device)))
    assert torch.equal(images[0].image, images[1].image)
    assert not images[1].visible[0, 0]


@pytest.mark.parametrize("seed", range(3))
def test_gradients_are_the_exact_ones_and_zero_where_those_are(place, seed) -> None:
    scene, view = splats(seed), camera()
    frame, leaves = exact_frame(scene, view, learn=True)
    slope = torch.from_numpy(np.random.default_rng(seed).normal(size=(view.height, view.width, 4)))
    frame.image.backward(slope.permute(2, 0, 1))
    world, colours = world_of(scene, place.device, learn=True)
    drawing = Drawer(place.gsplat, torch.device(place.device)).draw(
        world, colours[None], cameras_of(view, place.device)
    )
    drawing.means_2d.retain_grad()
    drawing.image.backward(slope[None].float().to(place.device))
    found = {
        "means": world.means,
        "scales": world.scales,
        "quaternions": world.quaternions,
        "opacities": world.opacities,
    }
    found |= {"colours": colours, "means_2d": drawing.means_2d}
    for name, leaf in found.items():
        gradient, expected = leaf.grad.cpu().numpy().reshape(leaves[name].shape), leaves[name].grad.numpy()
        assert cosine(gradient, expected) > 1 - COSINE, name
        assert np.array_equal(gradient.any(axis=-1), expected.any(axis=-1)), name


def test_weights_are_the_exact_ones(place) -> None:
    scene, view = splats(1), camera()
    pixels = torch.rand(1, view.height, view.width, 4, generator=torch.Generator().manual_seed(0))
    world, _ = world_of(scene, place.device)
    drawer = Drawer(place.gsplat, torch.device(place.device))
    found = drawer.weights(world, pixels[..., :2].to(place.device), cameras_of(view, place.device)).cpu().numpy()
    frame, leaves = exact_frame(scene, view, learn=True)
    frame.image.backward(pixels[0].permute(2, 0, 1).double())
    expected = leaves["colours"].grad[:, :2].numpy()
    assert np.abs(found - expected).max() < BAND * np.abs(expected).max()
    assert np.array_equal(found == 0, expected == 0)


@pytest.mark.parametrize("views", [(0,), (0, 1, 2), (0, 3, 1)])
def test_a_step_finds_what_the_cpu_finds(place, stage, state, views) -> None:
    targets, found = [stage.targets[view] for view in views], []
    for engine in (place.engine(stage), CpuEngine(stage.head, stage.motion, TrainOptions(threads=1))):
        engine.put(copy.deepcopy(state))
        engine.differentiate(1, targets, DEGREE)
        found.append((engine.losses(), engine.gradients(), engine.take()))
    (losses, gradients, taken), (losses_, gradients_, taken_) = found
    assert losses == pytest.approx(losses_, rel=1e-4)
    for name, expected in gradients_.items():
        assert cosine(gradients[name], expected) > 1 - STEP_COSINE, name
        assert np.array_equal(gradients[name] == 0, expected == 0), name
    assert cosine(taken.gradient_sum, taken_.gradient_sum) > 1 - STEP_COSINE
    assert np.array_equal(taken.gradient_count, taken_.gradient_count)


def test_the_order_of_sums_changes_little(gpu, stage, state, record_property) -> None:
    found = []
    for _ in range(2):
        engine = gpu.engine(stage)
        engine.put(copy.deepcopy(state))
        engine.differentiate(1, stage.targets[:3], DEGREE)
        found.append(engine.gradients())
    for name, gradient in found[0].items():
        apart = float(np.abs(gradient - found[1][name]).max() / np.abs(gradient).max())
        record_property(f"drift of {name}", apart)
        assert apart < DRIFT, name


def test_recorded_stages_do_what_plain_ones_do(gpu, stage, state) -> None:
    taken = []
    for graphs in (False, True):
        engine = gpu.engine(stage, graphs)
        engine.put(copy.deepcopy(state))
        for iteration in range(1, 9):  # recording begins with the third
            engine.differentiate(iteration, [stage.targets[iteration % 3]], 1 if iteration < 5 else DEGREE)
            engine.advance(RATES, frozenset())
        taken.append((engine.take(), engine.losses()))
    (plain, losses), (recorded, losses_) = taken
    assert losses_ == pytest.approx(losses, rel=RECORDED)
    assert recorded.steps == plain.steps
    for name, value in plain.values.items():
        gone = np.abs(value - state.values[name]).max()
        assert (np.abs(recorded.values[name] - value) > 0.01 * gone).mean() < 0.01, name
    assert np.array_equal(recorded.gradient_count, plain.gradient_count)


def test_an_iteration_waits_for_the_device_only_where_gsplat_does(gpu, stage, state) -> None:
    engine = gpu.engine(stage)
    engine.put(copy.deepcopy(state))
    engine.differentiate(1, stage.targets[:1], DEGREE)  # brings the target
    engine.advance(RATES, frozenset())
    torch.cuda.set_sync_debug_mode("warn")
    try:
        with warnings.catch_warnings(record=True) as waits:
            warnings.simplefilter("always")
            engine.differentiate(2, stage.targets[:1], DEGREE)
            engine.advance(RATES, frozenset())
    finally:
        torch.cuda.set_sync_debug_mode("default")
    assert len([wait for wait in waits if "synchroniz" in str(wait.message)]) <= 1  # the length of the tiles' lists


def test_memory_does_not_grow(gpu, stage, state) -> None:
    engine = gpu.engine(stage)
    engine.put(copy.deepcopy(state))
    used = []
    for iteration in range(1, 31):
        engine.differentiate(iteration, [stage.targets[iteration % 3]], DEGREE)
        engine.advance(RATES, frozenset())
        engine.losses()
        used.append(torch.cuda.memory_allocated())
    assert max(used[6:]) == pytest.approx(used[5], rel=0.05)


def test_a_fault_is_found_on_the_device(gpu, stage, state) -> None:
    state.values["neck"][1, 2] = np.inf
    engine = gpu.engine(stage)
    engine.put(copy.deepcopy(state))
    for iteration, place_ in enumerate((4, 0), 1):
        engine.differentiate(iteration, [stage.targets[place_]], DEGREE)
        engine.advance(RATES, frozenset())
    taken = engine.take()
    assert (taken.faults.count, taken.faults.first.parameter, taken.faults.first.iteration) == (1, "pose", 2)
    assert taken.steps["gaussians"] == state.steps["gaussians"] + 1
