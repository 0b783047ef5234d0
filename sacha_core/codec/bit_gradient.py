r"""How the bits of a file change with the numbers that are coded: what fitting through the quantiser can make cheaper.

Levels are coded under contexts in which they are about Laplacian, so a level's bits grow with its magnitude, by $-\log_2 \theta$ where
$\theta$ follows from the mean magnitude in its context. A number is also what others are predicted from: a step of it changes what they are
off by, by the weight of the prediction. So the gradient is that of the numbers' own levels, carried back through the linear predictor. The
decisions of the encoder - contexts, weights, steps - count as given; they are made anew with every file.

Source: own; the rate of a Laplacian source as in Sullivan, Efficient scalar quantization of exponential and Laplacian random variables,
1996.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float, Int

from sacha_core.avatar.gaussians import Gaussians
from sacha_core.codec.colour import TO_YUV, component_steps, rgb_to_yuv
from sacha_core.codec.colour import UNIT as COLOUR_UNIT
from sacha_core.codec.contexts import SIZE_CLASSES, Sizes
from sacha_core.codec.encoder import prepare, visible
from sacha_core.codec.fitting import fit_plan
from sacha_core.codec.importance import GaussianImportance
from sacha_core.codec.levels import Level, level_named
from sacha_core.codec.opacity import opacity_index, opacity_table
from sacha_core.codec.order import Layout
from sacha_core.codec.places import FULL_TRUST
from sacha_core.codec.plan import plan_by_rules, plan_by_worth
from sacha_core.codec.position import choose_domain, gradient_by_position
from sacha_core.codec.prediction import WEIGHT_BITS, Linear, Mixture, fit_mixture, lists_of
from sacha_core.codec.scale import UNIT as SCALE_UNIT
from sacha_core.codec.scale import classes_of, coded_scales, known_classes, steps_of
from sacha_core.codec.template import template_of
from sacha_core.flame.model import HeadModel

__all__ = ["BitGradient", "bit_gradient", "level_slopes", "through_prediction"]

SOFT = 0.5  # levels: below, a difference is as likely to be rounded to 0 as not
LEAST_MEAN = 0.02  # of magnitudes in a context: a level that hardly ever occurs costs some 6 bits


@dataclass(frozen=True)
class BitGradient:
    """Gradient of the bits of a file.

    Args:
        position: (n, 3) by means in triangle units.
        log_scale: (n, 3) by logarithms of standard deviations.
        sh_dc: (n, 3) by coefficients of degree 0.
        price: squared error of pictures that the level trades for a bit, summed over pixels and channels, mean over views.
    """

    position: Float[np.ndarray, "n 3"]
    log_scale: Float[np.ndarray, "n 3"]
    sh_dc: Float[np.ndarray, "n 3"]
    price: float


def bit_gradient(
    gaussians: Gaussians, head: HeadModel, level: int | Level, importance: GaussianImportance
) -> BitGradient:
    """Differentiate the bits that Gaussians take, as far as they are coded as differences from linear predictions.

    Args:
        gaussians: n of them.
        head: that they are bound to.
        level: that they will be encoded at.
        importance: likewise.
    """
    chosen = level if isinstance(level, Level) else level_named(level)
    keep = visible(gaussians.opacity_logit, chosen.opacity_steps)
    template = template_of(head.v_template, head.faces)
    prepared, known, order = prepare(gaussians.select(keep), template, chosen, importance.select(keep))
    zero = np.zeros((3, len(gaussians), 3))
    if known is None or not len(order):
        return BitGradient(zero[0], zero[1], zero[2], 0.0)
    plan = plan_by_worth(prepared, chosen, known, plan_by_rules(prepared, chosen))
    layout, rows = prepared.layout, np.flatnonzero(keep)[order]
    index = opacity_index(prepared.gaussians.opacity_logit, plan.opacity_steps)
    seen = known_classes(opacity_table(plan.opacity_steps).transparency[index], plan.hidden)
    scales = coded_scales(layout, prepared.log_scale)
    classes = classes_of(seen, scales)
    by_scale = slopes_by_values(layout, scales, steps_of(plan.scale, seen)) / SCALE_UNIT
    axes = np.argsort(-gaussians.log_scale[rows], axis=1, kind="stable")
    domain, _, values, steps = choose_domain(layout, prepared.gaussians.position, classes, plan.position)
    by_position = gradient_by_position(layout, slopes_by_values(layout, values, steps), domain)
    yuv = np.rint(rgb_to_yuv(prepared.gaussians.sh_dc) / COLOUR_UNIT).astype(np.int64)
    by_yuv = slopes_by_values(layout, yuv, component_steps(plan.colour, classes)) / COLOUR_UNIT
    position, log_scale, sh_dc = zero
    position[rows], sh_dc[rows] = by_position, by_yuv @ TO_YUV
    unsorted = np.empty_like(by_scale)
    np.put_along_axis(unsorted, axes, by_scale, axis=1)
    log_scale[rows] = unsorted
    return BitGradient(position, log_scale, sh_dc, plan.price or 0.0)


def slopes_by_values(
    layout: Layout, values: Int[np.ndarray, "n c"], steps: Int[np.ndarray, "n w"]
) -> Float[np.ndarray, "n c"]:
    """Give the gradient of the bits by integers that `encode_predicted` would be given, per fine unit."""
    steps = np.broadcast_to(steps, values.shape)
    mixture = fit_mixture(layout, values, steps)
    known, off = Linear(mixture, values), np.zeros(values.shape)
    for step in layout.passes:
        known.enter(step)
        for component in range(values.shape[1]):
            exact = known.residual(component) / steps[step.rows, component]
            off[step.rows, component] = exact
            known.learn(component, np.rint(exact).astype(np.int64) * steps[step.rows, component])
    return through_prediction(layout, mixture, level_slopes(layout, off, steps) / steps)


def level_slopes(
    layout: Layout, off: Float[np.ndarray, "n c"], steps: Int[np.ndarray, "n c"]
) -> Float[np.ndarray, "n c"]:
    """Give the bits for each step that a difference of `off` steps grows by."""
    levels = np.rint(off).astype(np.int64)
    plan, sizes = fit_plan(layout, levels, steps), Sizes(steps)
    contexts = np.zeros(off.shape, np.int64)
    for step in layout.passes:
        sizes.enter(step)
        for component in range(off.shape[1]):
            contexts[step.rows, component] = sizes.contexts(plan, component)
            sizes.learn(component, levels[step.rows, component])
    magnitudes = np.bincount(contexts.ravel(), np.abs(levels).ravel(), SIZE_CLASSES)
    mean = np.maximum(magnitudes / np.maximum(np.bincount(contexts.ravel(), minlength=SIZE_CLASSES), 1), LEAST_MEAN)
    bits_for_one = -np.log2((np.sqrt(1 + mean * mean) - 1) / mean)  # the mean magnitude is 2 theta / (1 - theta^2)
    return np.asarray(bits_for_one[contexts] * off / np.sqrt(off * off + SOFT * SOFT))


def through_prediction(layout: Layout, mixture: Mixture, slopes: Float[np.ndarray, "n c"]) -> Float[np.ndarray, "n c"]:
    """Carry a gradient by what predictions are off by back to the numbers, which are also what others are predicted from."""
    one = 1 << WEIGHT_BITS
    own = slopes - slopes @ (mixture.across / one)
    total = own.copy()
    for step in layout.passes:
        for weights, (rows, trust) in zip(mixture.weights[step.kind], lists_of(step), strict=True):
            if rows.size and weights.any():
                told = (own[step.rows] * (weights / one))[:, None] * (trust / FULL_TRUST)[:, :, None]
                for component in range(slopes.shape[1]):
                    given = told[:, :, component].ravel()
                    total[:, component] -= np.bincount(rows.ravel(), given, len(total))
    return total
