"""Parameters that no tracked head has: values out of range, single frames that jump, a head that never moves."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from jaxtyping import Float

from sacha_core.avatar.motion import Motion
from sacha_core.evaluate.checkup.finding import Finding
from sacha_core.flame.model import HeadModel

__all__ = ["judge_parameters"]

# What tracked heads stay below, by far: the widest yawn opens the jaw by 0.6 rad
LARGEST_ANGLE_RAD = {"rotation": 2.0, "neck": 1.2, "jaw": 1.0, "eyes": 1.2}
LARGEST_COEFFICIENT = 8.0  # of identity and expression, in standard deviations of the people FLAME was made of
LARGEST_OFFSET_M = 0.05
LARGEST_TRANSLATION_M = 2.0
OUTLIER = 12.0  # times the median absolute deviation over the capture
LEAST_DEVIATION = {"expression": 0.25, "rotation": 0.05, "neck": 0.05, "jaw": 0.05, "eyes": 0.1, "translation": 0.01}
MOST_NAMED = 5  # timesteps in a message


def judge_parameters(motion: Motion, head: HeadModel) -> list[Finding]:
    """Look for parameters that make no sense for a head.

    Args:
        motion: of the capture, one frame a timestep, finite.
        head: that they are for.
    """
    return [
        *_out_of_range(motion),
        *_outliers(motion),
        *_unfitting(motion, head),
        *_still(motion),
    ]


def _out_of_range(motion: Motion) -> list[Finding]:
    found = []
    for name, largest in LARGEST_ANGLE_RAD.items():
        angle = np.linalg.norm(getattr(motion, name).reshape(len(motion), -1, 3), axis=2).max(axis=1)
        found += _above(name, angle, largest, "rad", "angles are axis-angle vectors in radians")
    expression = np.abs(motion.expression).max(axis=1, initial=0)
    found += _above("expression", expression, LARGEST_COEFFICIENT, "standard deviations", "a track that was lost")
    distance = np.linalg.norm(motion.translation, axis=1)
    found += _above("translation", distance, LARGEST_TRANSLATION_M, "m", "heads are tracked in metres")
    shape = float(np.abs(motion.shape).max(initial=0))
    if shape > LARGEST_COEFFICIENT:
        what = f"shape reaches {shape:.3g} standard deviations, expected at most {LARGEST_COEFFICIENT:g}"
        found.append(Finding("warning", "parameters", what, "such a face is no one's: look at the picture (--picture)"))
    offset = float(np.linalg.norm(motion.static_offset, axis=1).max(initial=0))
    if offset > LARGEST_OFFSET_M:
        what = f"static_offset moves a vertex by {1000 * offset:.0f} mm, expected at most {1000 * LARGEST_OFFSET_M:.0f}"
        found.append(
            Finding("warning", "parameters", what, "units are metres; large offsets mean that shape did not fit")
        )
    return found


def _above(name: str, value: Float[np.ndarray, " t"], largest: float, unit: str, meaning: str) -> list[Finding]:
    at = np.flatnonzero(value > largest)
    if not len(at):
        return []
    what = f"{name} reaches {value.max():.3g} {unit} at {_timesteps(at)}, expected at most {largest:g}"
    return [Finding("warning", "parameters", what, f"{meaning}: track these timesteps again or leave them out")]


def _outliers(motion: Motion) -> list[Finding]:
    """Find timesteps far from all others in one number: a capture's own spread says what is far."""
    found = []
    for name, least in LEAST_DEVIATION.items():
        values = np.asarray(getattr(motion, name), np.float64)
        if len(values) < 3 or not values.size:
            continue
        away = np.abs(values - np.median(values, axis=0))
        spread = np.maximum(np.median(away, axis=0), least)
        at = np.flatnonzero((away > OUTLIER * spread).any(axis=1))
        if len(at):
            row, column = np.unravel_index(np.argmax(away / spread), away.shape)
            what = f"{name}[{column}] is {values[row, column]:.3g} at timestep {row}, far from all others (like {_timesteps(at)})"
            found.append(Finding("warning", "parameters", what, "look at these timesteps in the picture: a lost track"))
    return found


def _unfitting(motion: Motion, head: HeadModel) -> list[Finding]:
    """Hold the numbers of components and vertices to those of the head."""
    found = []
    sizes = {
        "shape": (motion.shape, head.shapedirs.shape[2]),
        "expression": (motion.expression, head.exprdirs.shape[2]),
    }
    for name, (values, n_known) in sizes.items():
        used = np.flatnonzero(values.reshape(-1, values.shape[-1]).any(axis=0)) if values.size else np.empty(0)
        if len(used) and used[-1] >= n_known:
            what = f"{name} uses component {used[-1]}, but head {head.name!r} has {n_known}"
            remedy = (
                "convert the head model that the capture was tracked with (sacha convert-head) and name it with --head"
            )
            found.append(Finding("error", "head", what, remedy))
    n_offsets = len(motion.static_offset)
    if n_offsets not in {0, head.n_vertices}:
        what = f"static_offset is of {n_offsets} vertices, but head {head.name!r} has {head.n_vertices}"
        found.append(Finding("error", "head", what, "name the head that the capture was tracked with (--head)"))
    return found


def _still(motion: Motion) -> list[Finding]:
    if len(motion) < 2 or np.ptp(motion.expression, axis=0).any() or np.ptp(motion.jaw, axis=0).any():
        return []
    what = f"expression and jaw are the same at all {len(motion)} timesteps"
    return [
        Finding(
            "warning", "parameters", what, "an avatar of them learns no expression: was the export of a finished track?"
        )
    ]


def _timesteps(at: Sequence[int] | np.ndarray) -> str:
    named = ", ".join(str(t) for t in at[:MOST_NAMED])
    return f"timestep{'s' * (len(at) > 1)} {named}" + f" and {len(at) - MOST_NAMED} more" * (len(at) > MOST_NAMED)
