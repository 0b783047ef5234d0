"""Coding attributes in turn, where what is not coded yet may move to make up for what was rounded: the encoder's business.

Opacities are coded first, then sizes, rotations, places, harmonics and colours. Whoever can draw pictures is told after each what a decoder
will have of it, and gives all the others anew. Of what comes early little is lost in the end then, so it may be coarser; harmonics, whose
levels are mostly zero, are also fitted through their own quantiser.

Source: own; rounding in turn with the rest refitted as in Frantar et al., GPTQ, 2023, by gradients of pictures.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from typing import Protocol

import numpy as np

from sacha_core.avatar.gaussians import Gaussians
from sacha_core.codec.colour import encode_colour
from sacha_core.codec.container import Section
from sacha_core.codec.harmonic_encoder import encode_harmonics
from sacha_core.codec.harmonic_metric import metric_of
from sacha_core.codec.hidden import encode_hidden
from sacha_core.codec.importance import GaussianImportance
from sacha_core.codec.opacity import MAX_STEPS, encode_opacity, opacity_index, opacity_table
from sacha_core.codec.plan import Plan, Prepared
from sacha_core.codec.position import encode_position
from sacha_core.codec.rotation import encode_rotation, sort_axes
from sacha_core.codec.scale import classes_of, encode_scale, known_classes, scales_in_triangles
from sacha_core.codec.steps import PER_OCTAVE
from sacha_core.flame.model import HeadModel

__all__ = ["Remaining", "encode_in_turn", "for_coding_in_turn"]

OPACITY_SHIFT, SCALE_SHIFT, COLOUR_SHIFT = 8, 8, -3  # eighths of octaves by which steps are coarser
HARMONIC_PRICE = 0.7  # of the price of a bit elsewhere: nothing but the mean colour comes after harmonics


class Remaining(Protocol):
    """Moves what is not coded yet."""

    def after(self, gaussians: Gaussians, coded: frozenset[str]) -> Gaussians:
        """Give Gaussians of which all but `coded`, attributes by name, made up for what these lost."""
        ...

    def through(
        self, gaussians: Gaussians, coded: frozenset[str], decode: Callable[[Gaussians], Gaussians]
    ) -> Gaussians:
        """Give Gaussians that look better as `decode` gives them."""
        ...


def for_coding_in_turn(plan: Plan) -> Plan:
    """Spend fewer bits on what others make up for, and more on what comes late."""
    return replace(
        plan,
        opacity_steps=max(min(round(plan.opacity_steps * 2.0 ** (-OPACITY_SHIFT / PER_OCTAVE)), MAX_STEPS), 1),
        scale=tuple(rule.moved(SCALE_SHIFT) for rule in plan.scale),
        colour=tuple(rule.moved(COLOUR_SHIFT) for rule in plan.colour),
        price=None if plan.price is None else HARMONIC_PRICE * plan.price,
    )


def encode_in_turn(
    prepared: Prepared, plan: Plan, head: HeadModel | None, importance: GaussianImportance, remaining: Remaining
) -> list[Section]:
    """Code all attributes as planned, and let what remains after each move."""
    layout, worth = prepared.layout, plan.worth
    index = opacity_index(prepared.gaussians.opacity_logit, plan.opacity_steps)
    opacity, index = encode_opacity(layout, index, plan.opacity_steps, plan.hidden, plan.opacity_weight)
    opacities = opacity_table(plan.opacity_steps)
    now = with_columns(
        prepared.gaussians,
        opacity_logit=opacities.logit[index],
        log_scale=prepared.log_scale,
        quaternion=prepared.quaternion,
    )
    coded = frozenset({"opacity_logit"})
    now = remaining.after(now, coded)

    known = known_classes(opacities.transparency[index], plan.hidden)
    log_scale, quaternion = sort_axes(now.log_scale, now.quaternion)
    scale, scale_values = encode_scale(layout, log_scale, known, plan.scale, worth["scale"])
    classes = classes_of(known, scale_values)
    now = with_columns(now, log_scale=scales_in_triangles(layout, scale_values), quaternion=quaternion)
    coded |= {"log_scale"}
    now = remaining.after(now, coded)

    turns = now.quaternion / np.linalg.norm(now.quaternion, axis=1, keepdims=True)
    rotation, turned = encode_rotation(layout, turns, classes, plan.rotation, worth["rotation"])
    now, coded = with_columns(now, quaternion=turned), coded | {"quaternion"}
    now = remaining.after(now, coded)

    position, moved = encode_position(layout, now.position, classes, plan.position, worth["position"])
    now, coded = with_columns(now, position=moved), coded | {"position"}
    now = remaining.after(now, coded)

    harmonic = []
    if now.sh_degree:
        metric = metric_of(now, head, importance, plan.harmonic, classes)

        def decoded(given: Gaussians) -> tuple[bytes, Gaussians]:
            data, rest = encode_harmonics(layout, given.sh_rest, classes, plan.harmonic, metric, plan.price)
            return data, with_columns(given, sh_rest=rest, sh_dc=metric.folded(given.sh_dc, given.sh_rest - rest))

        data, now = decoded(remaining.through(now, coded, lambda given: decoded(given)[1]))
        now, harmonic = remaining.after(now, coded | {"sh_rest"}), [Section("Harmonic", data)]
    return [
        Section("Hidden", encode_hidden(layout, plan.hidden)),
        Section("Opacity", opacity),
        Section("Scale", scale),
        Section("Rotation", rotation),
        Section("Position", position),
        Section("Colour", encode_colour(layout, now.sh_dc, classes, plan.colour, worth["colour"])[0]),
        *harmonic,
    ]


def with_columns(gaussians: Gaussians, **columns: np.ndarray) -> Gaussians:
    """Give Gaussians with other columns, as float32."""
    return replace(gaussians, **{name: np.ascontiguousarray(value, np.float32) for name, value in columns.items()})
