"""Losses and penalties on a device: against those of the CPU, and gradients against finite differences."""

from __future__ import annotations

import numpy as np
import pytest
import torch
from cuda_scenes import CPU

from sacha_core.perception.image_loss import ImageLoss
from sacha_core.train.cuda.image_loss import DeviceImageLoss, cross_entropy
from sacha_core.train.cuda.penalties import penalise
from sacha_core.train.options import LossOptions

OPTIONS = LossOptions()
VALUES = 2e-6  # float32 sums in another order
SLOPES = 3e-6  # relative to the largest; SSIM's slope is a difference of blurred numbers of its own size


def images(count: int, height: int = 33, width: int = 41, seed: int = 0):
    """Give drawn images, sensitivity among them beyond 0 and 1, and their targets."""
    rng = np.random.default_rng(seed)
    drawn = rng.uniform(0, 1, (count, height, width, 4)).astype(np.float32)
    wanted = rng.integers(0, 256, (count, 3, height, width), dtype=np.uint8)
    sensitive = rng.integers(0, 256, (count, height, width), dtype=np.uint8)
    agree = height // 3
    drawn[:, :agree, :, :3] = np.moveaxis(wanted, 1, 3)[:, :agree] * np.float32(
        1 / 255
    )  # where they agree, L1 has no slope
    drawn[0, :1, :, 3], drawn[0, 1:2, :, 3] = 0, 1
    return drawn, wanted, sensitive


def losses(drawn, wanted, sensitive):
    return DeviceImageLoss(OPTIONS, CPU)(*(torch.from_numpy(array) for array in (drawn, wanted, sensitive)))


@pytest.mark.parametrize(("height", "width"), [(33, 41), (3, 5), (1, 1), (11, 60)])
def test_an_image_costs_what_it_costs_on_the_cpu(height, width) -> None:
    drawn, wanted, sensitive = images(1, height, width)
    expected = ImageLoss(OPTIONS.l1, OPTIONS.ssim, OPTIONS.sensitivity)(
        np.ascontiguousarray(drawn[0].transpose(2, 0, 1)), wanted[0], sensitive[0]
    )
    parts, slope = losses(drawn, wanted, sensitive)
    found = dict(zip(("total", "l1", "ssim", "entropy"), parts.tolist(), strict=True))
    for name, value in found.items():
        assert value == pytest.approx(getattr(expected, name), abs=VALUES, rel=VALUES), name
    gradient = slope[0].permute(2, 0, 1).numpy()
    for one, other in zip(gradient, expected.gradient, strict=True):
        assert np.abs(one - other).max() <= SLOPES * np.abs(other).max()
    assert np.array_equal(gradient[3] == 0, expected.gradient[3] == 0)


def test_several_images_cost_their_mean() -> None:
    drawn, wanted, sensitive = images(3)
    parts, slope = losses(drawn, wanted, sensitive)
    alone = [losses(*(array[i : i + 1] for array in (drawn, wanted, sensitive))) for i in range(3)]
    assert parts.numpy() == pytest.approx(torch.stack([one for one, _ in alone]).mean(0).numpy(), rel=VALUES)
    assert slope.numpy() == pytest.approx(torch.cat([one for _, one in alone]).numpy() / 3, rel=1e-4, abs=1e-12)


def test_the_gradient_is_that_of_finite_differences() -> None:
    """Along one direction, in float64 throughout; L1 left out, whose kinks are everywhere here."""
    drawn, wanted, sensitive = (torch.from_numpy(array) for array in images(2))
    loss = DeviceImageLoss(LossOptions(l1=0.0), CPU)
    loss._taps = loss._taps.double()  # the product is float32 to stay
    drawn = drawn.double() * 0.9 + 0.05
    direction = torch.randn(drawn.shape, dtype=torch.float64, generator=torch.Generator().manual_seed(0))
    step = 1e-6
    ends = [float(loss(drawn + sign * step * direction, wanted, sensitive)[0][0]) for sign in (1, -1)]
    _, slope = loss(drawn, wanted, sensitive)
    assert float((slope * direction).sum()) == pytest.approx((ends[0] - ends[1]) / (2 * step), rel=1e-5)


def test_a_clamped_prediction_has_a_finite_cost_and_no_slope() -> None:
    predicted = torch.tensor([[[-1.0, 0.0, 1.0, 2.0, 0.5]]])
    cost, slope = cross_entropy(predicted, torch.ones_like(predicted))
    assert cost.isfinite()
    assert slope[0, 0, :4].tolist() == [0, 0, 0, 0]
    assert float(slope[0, 0, 4]) == pytest.approx(-2)


def gaussians(seed: int = 0):
    rng = np.random.default_rng(seed)
    position = torch.from_numpy(rng.normal(0, 0.8, (40, 3)))
    log_scale = torch.from_numpy(rng.normal(-0.6, 0.5, (40, 3)))
    visible = torch.from_numpy(rng.random((3, 40)) < 0.6)
    return position, log_scale, visible


def summed(position, log_scale, visible) -> torch.Tensor:
    """The penalties as the method states them, view by view."""
    total = torch.zeros((), dtype=position.dtype)
    for shown in visible:
        stray = torch.relu(position[shown].norm(dim=1) - OPTIONS.position_limit)
        swell = torch.relu(log_scale[shown].exp() - OPTIONS.scale_limit).norm(dim=1)
        total = total + OPTIONS.position * stray.mean() + OPTIONS.scale * swell.mean()
    return total / len(visible)


def test_penalties_and_their_gradients_are_those_of_the_statement() -> None:
    position, log_scale, visible = gaussians()
    slopes = torch.ones_like(position), torch.zeros_like(log_scale)
    found = penalise(position, log_scale, visible, OPTIONS, *slopes)
    leaves = position.clone().requires_grad_(), log_scale.clone().requires_grad_()
    expected = summed(*leaves, visible)
    assert float(found.sum()) == pytest.approx(float(expected.detach()), rel=1e-12)
    # where nothing swells the norm's slope is that of zero: autograd has none there
    wanted = [gradient.nan_to_num() for gradient in torch.autograd.grad(expected, leaves)]
    assert slopes[0].numpy() - 1 == pytest.approx(wanted[0].numpy(), abs=1e-14)
    assert slopes[1].numpy() == pytest.approx(wanted[1].numpy(), abs=1e-14)


def test_what_no_view_shows_costs_nothing_however_large_it_is() -> None:
    position, log_scale, visible = gaussians()
    visible[:, 5], log_scale[5], position[5] = False, 1e4, torch.inf
    slopes = torch.zeros_like(position), torch.zeros_like(log_scale)
    assert penalise(position, log_scale, visible, OPTIONS, *slopes).isfinite().all()
    assert all(slope.isfinite().all() and not slope[5].any() for slope in slopes)


def test_a_view_that_shows_nothing_costs_nothing() -> None:
    position, log_scale, visible = gaussians()
    slopes = torch.zeros_like(position), torch.zeros_like(log_scale)
    assert not penalise(position, log_scale, torch.zeros_like(visible), OPTIONS, *slopes).any()
    assert not any(slope.any() for slope in slopes)
