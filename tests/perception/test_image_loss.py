"""The fused loss: value and gradient against torch's autograd in float64, a crop against the whole, threads against one."""

from __future__ import annotations

import numpy as np
import pytest
import torch

from sacha_core.errors import OptionError
from sacha_core.parallel.pool import Pool
from sacha_core.perception.image_loss import ImageLoss

VALUE = 3e-7  # float32 sums over rows; the rest is added in float64
GRADIENT = 3e-5  # relative to the largest: blurred float32 derivatives, twice
ORDER = 1e-6  # relative: the same float32 terms added in another order
WEIGHTS = (0.8, 0.2, 0.01)


def material(seed: int, height: int = 23, width: int = 37) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    rng = np.random.default_rng(seed)
    image = rng.uniform(-0.05, 1.05, (4, height, width)).astype(np.float32)
    return image, rng.integers(0, 256, (3, height, width), np.uint8), rng.integers(0, 256, (height, width), np.uint8)


def reference(image: np.ndarray, target: np.ndarray, sensitivity: np.ndarray) -> tuple[torch.Tensor, torch.Tensor]:
    """Give the total and its gradient by torch's autograd in float64."""
    x = torch.tensor(image, dtype=torch.float64, requires_grad=True)
    y = torch.tensor(target, dtype=torch.float64) / 255
    taps = torch.exp(-(torch.arange(-5, 6, dtype=torch.float64) ** 2) / (2 * 1.5**2))
    window = (torch.outer(taps, taps) / taps.sum() ** 2).expand(3, 1, 11, 11)
    blur = lambda z: torch.nn.functional.conv2d(z[None], window, padding=5, groups=3)[0]  # noqa: E731
    a, b = blur(x[:3]), blur(y)
    contrast = (2 * (blur(x[:3] * y) - a * b) + 9e-4) / (blur(x[:3] ** 2) - a**2 + blur(y**2) - b**2 + 9e-4)
    similarity = (2 * a * b + 1e-4) / (a**2 + b**2 + 1e-4) * contrast
    wanted = torch.tensor(sensitivity, dtype=torch.float64) / 255
    bounds = float(np.float32(1e-6)), float(np.float32(1 - 1e-6))
    entropy = torch.nn.functional.binary_cross_entropy(x[3].clamp(*bounds), wanted)
    total = WEIGHTS[0] * (x[:3] - y).abs().mean() + WEIGHTS[1] * (1 - similarity.mean()) + WEIGHTS[2] * entropy
    total.backward()
    return total.detach(), x.grad


# (3, 300), (9, 129): several strips of columns; (23, 37): rows and columns that fill no group
@pytest.mark.parametrize("size", [(23, 37), (1, 1), (3, 300), (9, 129), (40, 16), (30, 5)])
def test_value_and_gradient_are_those_of_autograd(size) -> None:
    image, target, sensitivity = material(0, *size)
    total, gradient = reference(image, target, sensitivity)
    result = ImageLoss(*WEIGHTS)(image, target, sensitivity)
    assert result.total == pytest.approx(float(total), abs=VALUE)
    largest = gradient.abs().amax(dim=(1, 2), keepdim=True).numpy()
    assert (np.abs(result.gradient - gradient.numpy()) <= GRADIENT * largest).all()


def test_islands_of_differences_are_those_of_autograd() -> None:
    """Where images agree nothing is computed: islands near borders, corners and seams of strips must not lose their surroundings."""
    _, target, sensitivity = material(7, 61, 290)
    image = np.zeros((4, 61, 290), np.float32)
    image[:3] = target * np.float32(1 / 255)
    sensitivity[20:], image[3, 20:] = 0, 0
    rng = np.random.default_rng(8)
    for row, column in ((0, 0), (60, 289), (30, 95), (33, 96), (31, 191), (12, 200), (45, 3)):
        image[rng.integers(3), row, column] += 0.3
    total, gradient = reference(image, target, sensitivity)
    result = ImageLoss(*WEIGHTS)(image, target, sensitivity)
    assert result.total == pytest.approx(float(total), abs=VALUE)
    # not compared where images agree: float64 has no difference of 0 there, and an L1 of either slope
    differing = np.abs(image[:3] - target * np.float32(1 / 255)) > 0
    ours, exact = result.gradient[:3][differing], gradient.numpy()[:3][differing]
    assert np.abs(ours - exact).max() < GRADIENT * np.abs(exact).max()
    around = np.zeros_like(differing)
    for channel, row, column in np.argwhere(differing):
        around[channel, max(row - 10, 0) : row + 11, max(column - 10, 0) : column + 11] = True
    assert not result.gradient[:3][~around].any()
    assert (result.gradient[:3][around & ~differing] != 0).mean() > 0.5


def test_parts_add_up() -> None:
    image, target, sensitivity = material(1)
    r = ImageLoss(*WEIGHTS)(image, target, sensitivity)
    assert r.total == pytest.approx(0.8 * r.l1 + 0.2 * (1 - r.ssim) + 0.01 * r.entropy, rel=1e-12)
    assert r.l1 == pytest.approx(np.abs(image[:3] - target / 255).mean(), abs=VALUE)


def test_a_clamped_prediction_has_no_gradient() -> None:
    image, target, sensitivity = material(2)
    image[3, 0], image[3, 1] = 0, 1.2
    gradient = ImageLoss()(image, target, sensitivity).gradient
    assert not gradient[3, :2].any()
    assert (gradient[3, 2:][(image[3, 2:] > 0) & (image[3, 2:] < 1)] != 0).mean() > 0.9


def test_without_a_map_the_fourth_channel_gets_no_gradient() -> None:
    image, target, _ = material(3)
    result = ImageLoss()(image, target)
    assert result.entropy == 0
    assert not result.gradient[3].any()
    assert result.gradient[:3].any()


def test_equal_images_cost_nothing_and_pull_nowhere() -> None:
    _, target, _ = material(4)
    result = ImageLoss()(target * np.float32(1 / 255), target)
    assert (result.total, result.l1, result.ssim) == (0, 0, 1)
    assert not result.gradient.any()


def test_a_crop_with_a_margin_costs_what_the_whole_costs() -> None:
    image, target, sensitivity = material(5, 60, 70)
    whole = np.ones((4, 60, 70), np.float32)
    whole[3] = 0
    white, nothing = np.full((3, 60, 70), 255, np.uint8), np.zeros((60, 70), np.uint8)
    inside = (slice(20, 40), slice(25, 50))
    for array, content in ((whole, image), (white, target), (nothing, sensitivity)):
        array[..., inside[0], inside[1]] = content[..., inside[0], inside[1]]
    all_of_it = ImageLoss()(whole, white, nothing)
    crop = (slice(10, 50), slice(15, 60))
    part = ImageLoss()(whole[:, crop[0], crop[1]], white, nothing, (15, 10, 60, 50))
    assert part.total == pytest.approx(all_of_it.total, rel=ORDER)
    assert np.array_equal(part.gradient, all_of_it.gradient[:, crop[0], crop[1]])
    rest = all_of_it.gradient.copy()
    rest[:, crop[0], crop[1]] = 0
    assert not rest.any()


def test_images_in_pieces_and_of_floats_count_the_same() -> None:
    image, target, sensitivity = material(9)
    plain = ImageLoss()(image, target, sensitivity)
    mirrored = ImageLoss()(image, target[:, ::-1][:, ::-1], np.asfortranarray(sensitivity))
    floats = ImageLoss()(image, target * np.float32(1 / 255), sensitivity)
    for other in (mirrored, floats):
        assert other.total == plain.total
        assert np.array_equal(other.gradient, plain.gradient)


@pytest.mark.parametrize("channel", [0, 3])
def test_what_is_not_a_number_is_not_lost(channel) -> None:
    image, target, sensitivity = material(10)
    image[:3] = target * np.float32(1 / 255)
    image[channel, 11, 13] = np.nan
    result = ImageLoss()(image, target, sensitivity)
    assert np.isnan(result.total)
    assert np.isnan(result.gradient[channel, 11, 13])


def test_threads_change_no_bit() -> None:
    image, target, sensitivity = material(6, 50, 333)
    alone = ImageLoss()(image, target, sensitivity)
    shared = ImageLoss(pool=Pool(3))(image, target, sensitivity)
    assert alone.total == shared.total
    assert np.array_equal(alone.gradient, shared.gradient)


def test_shapes_that_do_not_go_together_are_refused() -> None:
    image, target, sensitivity = material(11)
    for wrong in (
        (image[:, :-1], target, sensitivity),
        (image[:3], target, sensitivity),
        (image[:2], target, None),
        (image, target, sensitivity[:, 1:]),
    ):
        with pytest.raises(OptionError, match="as the target's"):
            ImageLoss()(*wrong)
    for box in ((0, 0, 1, 1), (-1, 0, image.shape[2] - 1, image.shape[1]), (0, 1, image.shape[2], image.shape[1] + 1)):
        with pytest.raises(OptionError, match="target"):
            ImageLoss()(image, target, sensitivity, box)
