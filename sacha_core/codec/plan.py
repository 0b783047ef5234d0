"""What an encoder decides before it codes: step rules, hidden classes, and what errors are worth against bits.

By the rules of the level alone, or with what every number of the avatar was measured to be worth (`allocation`).

Source: own.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from jaxtyping import Float, Int

from sacha_core.avatar.gaussians import Gaussians
from sacha_core.codec import levels as rules
from sacha_core.codec.allocation import FINER, hidden_classes
from sacha_core.codec.choice import Worth
from sacha_core.codec.colour import TO_RGB
from sacha_core.codec.colour import UNIT as COLOUR_UNIT
from sacha_core.codec.importance import GaussianImportance
from sacha_core.codec.levels import Level
from sacha_core.codec.opacity import MAX_STEPS, opacity_table
from sacha_core.codec.order import Layout
from sacha_core.codec.position import TRIANGLE, position_steps
from sacha_core.codec.position import UNIT as POSITION_UNIT
from sacha_core.codec.rotation import steps_of as rotation_steps
from sacha_core.codec.scale import UNIT as SCALE_UNIT
from sacha_core.codec.scale import classes_of, known_classes, triangle_log_size
from sacha_core.codec.steps import PER_OCTAVE, Classes, StepRule
from sacha_core.codec.turning import UNIT as ROTATION_UNIT

__all__ = ["Plan", "Prepared", "plan_by_rules", "plan_by_worth"]

SLOPE = 2 * np.log(2) / 12  # squared steps that a bit is worth, at a high rate
EVENING = 0.5  # how far attributes are evened out
MOST_SHIFT = 1.5  # octaves
MOST_LIFT = 2.0  # octaves
BETTER = 0.6  # octaves by which measured levels are finer, since they save so much
LEAST = 1e-30
WORTH_RANGE = 4.0  # weights of the chooser stay within this factor of 1


@dataclass(frozen=True)
class Prepared:
    """Gaussians in coding order, as they enter the sections.

    Args:
        layout: where they lie.
        gaussians: themselves.
        index: (n,) opacity indices of the level.
        log_scale: (n, 3) sorted, largest first.
        quaternion: (n, 4) that match.
        numbers: (m,) Gaussians at every place, in coding order.
        by_vertex: whether places are vertices rather than triangles.
    """

    layout: Layout
    gaussians: Gaussians
    index: Int[np.ndarray, " n"]
    log_scale: Float[np.ndarray, "n 3"]
    quaternion: Float[np.ndarray, "n 4"]
    numbers: Int[np.ndarray, " m"]
    by_vertex: bool

    def classes(self, n_steps: int) -> Classes:
        """Classes before anything is quantised; nothing is hidden."""
        known = known_classes(opacity_table(n_steps).transparency[self.index], np.zeros_like(self.index))
        scale = np.rint(self.log_scale / SCALE_UNIT).astype(np.int64) + triangle_log_size(self.layout)[:, None]
        return classes_of(known, scale)


@dataclass(frozen=True)
class Plan:
    """Decisions.

    Args:
        hidden: (n,) classes.
        opacity_steps: from transparent to opaque.
        opacity_weight: of hidden classes in the spacing of opacities.
        scale, rotation, position, colour, harmonic: step rules.
        worth: of the errors and bits of each of these.
        price: squared picture error that a bit is worth; None where nothing was measured.
    """

    hidden: Int[np.ndarray, " n"]
    opacity_steps: int
    opacity_weight: int
    scale: tuple[StepRule, ...]
    rotation: tuple[StepRule, ...]
    position: StepRule
    colour: tuple[StepRule, ...]
    harmonic: StepRule
    worth: dict[str, Worth]
    price: float | None = None


def plan_by_rules(prepared: Prepared, level: Level) -> Plan:
    """Decide by the rules of a level."""
    size = prepared.classes(level.opacity_steps).size
    reference = min(max(int(np.median(size)) if len(size) else 0, -128), 127)

    def at(rule: StepRule, attribute: str) -> StepRule:
        return replace(rule, reference=reference).moved(level.exponent(attribute))

    return Plan(
        hidden=np.zeros_like(prepared.index),
        opacity_steps=level.opacity_steps,
        opacity_weight=0,
        scale=tuple(at(rule, "scale") for rule in rules.SCALE_RULES),
        rotation=tuple(at(rule, "rotation") for rule in rules.ROTATION_RULES),
        position=at(rules.POSITION_RULE, "position"),
        colour=tuple(at(rule, "colour") for rule in rules.COLOUR_RULES),
        harmonic=at(rules.HARMONIC_RULE, "harmonic"),
        worth=dict.fromkeys(("scale", "rotation", "position", "colour"), Worth(level.lagrangian)),
    )


def plan_by_worth(prepared: Prepared, level: Level, importance: GaussianImportance, plain: Plan) -> Plan:
    """Add to a plan by rules how hidden each Gaussian is, and what every number is worth."""
    costs = costs_of(prepared, level, importance, plain)
    roots = {name: np.sqrt(cost) for name, cost in costs.items()}  # whose means no single number that costs much rules
    hidden = hidden_classes(np.square(np.concatenate(list(roots.values()), axis=1).mean(axis=1)))
    coarser = 2.0 ** (hidden - FINER)[:, None]
    shifts = as_costly(costs, coarser, even_out({name: root * coarser for name, root in roots.items()}))
    scaled = {name: roots[name] * coarser * 2.0 ** (np.array(shifts[name]) / PER_OCTAVE) for name in costs}
    price = SLOPE * max(float(np.square(np.concatenate(list(scaled.values()), axis=1).mean())), LEAST)

    def spread(rule: StepRule, name: str, component: int) -> StepRule:
        return replace(rule, hidden=PER_OCTAVE).moved(shifts[name][component] - FINER * PER_OCTAVE)

    def worth(name: str) -> Worth:
        return Worth(level.lagrangian, np.clip(scaled[name] ** 2 * (SLOPE / price), 1 / WORTH_RANGE, WORTH_RANGE))

    return replace(
        plain,
        hidden=hidden,
        opacity_steps=min(round(plain.opacity_steps * 2.0 ** (FINER - shifts["opacity"][0] / PER_OCTAVE)), MAX_STEPS),
        opacity_weight=PER_OCTAVE,
        scale=tuple(spread(rule, "scale", axis) for axis, rule in enumerate(plain.scale)),
        rotation=tuple(spread(rule, "rotation", axis) for axis, rule in enumerate(plain.rotation)),
        position=spread(plain.position, "position", 0),
        colour=tuple(spread(rule, "colour", channel) for channel, rule in enumerate(plain.colour)),
        harmonic=spread(plain.harmonic, "colour", 0),  # whose errors the mean colour takes over
        worth={name: worth(name) for name in plain.worth},
        price=price,
    )


def even_out(roots: dict[str, Float[np.ndarray, "n c"]]) -> dict[str, list[int]]:
    """Give eighths of octaves to add to the steps of each component, so that errors cost more nearly alike.

    Args:
        roots: of what an error of a step of each component of each Gaussian costs.
    """
    octaves = {name: np.log2(np.maximum(root.mean(axis=0), LEAST)) for name, root in roots.items()}
    octaves["position"][:] = octaves["position"].mean()  # which has one rule
    middle = np.concatenate(list(octaves.values())).mean()
    return {
        name: np.rint(np.clip((middle - found) * EVENING, -MOST_SHIFT, MOST_SHIFT) * PER_OCTAVE).astype(int).tolist()
        for name, found in octaves.items()
    }


def as_costly(
    costs: dict[str, Float[np.ndarray, "n c"]], coarser: Float[np.ndarray, "n 1"], shifts: dict[str, list[int]]
) -> dict[str, list[int]]:
    """Add the same to all shifts, so that errors cost about as much in all as before: a level keeps its meaning.

    Args:
        costs: of an error of a step by the rules.
        coarser: factor on the steps of each Gaussian.
        shifts: of the steps of each component, eighths of an octave.
    """
    before = sum(float(cost.sum()) for cost in costs.values())
    factors = {name: 4.0 ** (np.array(shift) / PER_OCTAVE) for name, shift in shifts.items()}
    after = sum(float((cost * coarser**2 * factors[name]).sum()) for name, cost in costs.items())
    octaves = np.log2(max(before, LEAST) / max(after, LEAST)) / 2 - BETTER
    lift = round(PER_OCTAVE * min(max(octaves, -MOST_LIFT), MOST_LIFT))
    return {name: [shift + lift for shift in shifts[name]] for name in shifts}


def costs_of(
    prepared: Prepared, level: Level, importance: GaussianImportance, plan: Plan
) -> dict[str, Float[np.ndarray, "n c"]]:
    """Give what an error of a step of each component costs."""
    classes = prepared.classes(level.opacity_steps)
    scales = np.stack([rule.steps(classes) for rule in plan.scale], axis=1) * SCALE_UNIT
    turns = rotation_steps(plan.rotation, classes) * (2 * ROTATION_UNIT)  # a quaternion's vector is half the angle
    moves = position_steps(prepared.layout, classes, plan.position, TRIANGLE) * POSITION_UNIT
    colours = np.stack([rule.steps(classes) for rule in plan.colour], axis=1) * COLOUR_UNIT
    return {
        "opacity": importance.opacity[:, None] * (np.pi / 2 / level.opacity_steps) ** 2,
        "scale": importance.log_scale * scales**2,
        "rotation": importance.rotation * turns**2,
        "position": importance.position.mean(axis=1, keepdims=True) * np.ones(3) * moves**2,
        "colour": importance.sh_dc @ TO_RGB**2 * colours**2,
    }
