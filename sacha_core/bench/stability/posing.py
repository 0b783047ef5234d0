"""Hard cases of posing: extreme FLAME parameters, and what float32 loses along a chain of joints."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace
from functools import partial
from typing import Any

import numpy as np
import torch
from jaxtyping import Float

from sacha_core.animation.posed import PosedHead
from sacha_core.avatar.motion import LARGEST, Motion
from sacha_core.bench.stability.case import Case, Findings
from sacha_core.bench.stability.exact_head import ExactHead
from sacha_core.errors import FormatError, GeometryError
from sacha_core.flame.model import HeadModel
from sacha_core.flame.posing import Poser
from sacha_core.flame.synthetic import synthetic_head

__all__ = ["WAYS", "cases", "drift_mm"]

F = np.float32
EPS = float(np.finfo(F).eps)
ROTATIONS = ("rotation", "neck", "jaw", "eyes")
# Roundings of the largest coordinate that a vertex may be off, whatever the pose: sums of some tens of terms
DRIFT = 8.0
TURNED = 4.0  # the same for each radian of the longest rotation vector, where it is turned in float32
WAYS = ("compiled", "plain")
AMPLITUDES_RAD = (0.1, 0.5, 1.0, float(np.pi), 10.0, 100.0)
POSES = 12  # random ones of each amplitude

POSED = "be finite and proper, as near to float64 as float32 can be; or be refused by name"


def cases(full: bool = False) -> Iterator[Case]:
    """Give the family; `full` poses the head of FLAME's size."""
    size = "full" if full else "small"
    for value in (10.1, -10.1):
        yield Case(
            f"expression {value:+.0f}, each alone",
            "every component in turn",
            POSED,
            partial(_each_expression, size, value),
        )
        yield Case(
            f"expression {value:+.0f}, all",
            "every component at once",
            POSED,
            partial(_all_of, size, "expression", value),
        )
        yield Case(
            f"identity {value:+.0f}, all", "every component of the shape", POSED, partial(_identity, size, value)
        )
    turns = {"half a turn": np.pi, "a whole turn": 2 * np.pi, "a thousand radians": 1e3, "a million radians": 1e6}
    for name, angle in turns.items():
        yield Case(
            name, f"every joint about every axis, {angle:.4g} rad both ways", POSED, partial(_each_turn, size, angle)
        )
    for angle in (1e-8, -1e-8, 1e-20, 1e-45):
        given = f"every joint and axis {angle:g} rad" + (", which cancels FLAME's offset" if angle == -1e-8 else "")
        yield Case(f"turned by {angle:g}", given, POSED, partial(_every_turn, size, angle))
    yield Case(
        "all joints by half a turn",
        "every component of every rotation vector pi",
        POSED,
        partial(_every_turn, size, np.pi),
    )
    for place in (1.0, 1e3, 1e6, LARGEST):
        yield Case(
            f"{place:.3g} m away", "translation along every axis", POSED, partial(_all_of, size, "translation", place)
        )
    for name in ("expression", "rotation", "jaw", "translation"):
        for value in (np.nan, np.inf, 2 * LARGEST):
            yield Case(
                f"{name} {value:.3g}", "one number of one frame", "be refused by name", partial(_refused, name, value)
            )
    for amplitude in AMPLITUDES_RAD:
        given = f"random poses, every joint turned by {amplitude:.3g} rad"
        yield Case(
            f"drift at {amplitude:.3g} rad",
            given,
            "stay within float32's rounding of float64",
            partial(_drift, size, amplitude),
        )


def drift_mm(size: str, amplitude_rad: float, way: str) -> Float[np.ndarray, " p"]:
    """Give how far the worst vertex is from float64 in random poses, mm: of each pose in which every joint is turned by so much.

    Args:
        size: of the synthetic head.
        amplitude_rad: length of every rotation vector.
        way: `compiled`, as training and playing pose, or `plain`, in NumPy.
    """
    head, rng = synthetic_head(size), np.random.default_rng(0)
    vectors = rng.normal(size=(POSES, 5, 3))
    vectors *= amplitude_rad / np.linalg.norm(vectors, axis=2, keepdims=True)
    motion = _motion(head, {"expression": rng.normal(size=(POSES, head.exprdirs.shape[2])), **_by_joint(vectors)})
    return np.array([1e3 * np.abs(posed - exact).max() for posed, exact in _posed(head, way, motion)])


def _each_expression(size: str, value: float, findings: Findings) -> None:
    head = synthetic_head(size)
    _hold(findings, head, _motion(head, {"expression": value * np.eye(head.exprdirs.shape[2])}))


def _all_of(size: str, name: str, value: float, findings: Findings) -> None:
    head = synthetic_head(size)
    width = 3 if name == "translation" else head.exprdirs.shape[2]
    _hold(findings, head, _motion(head, {name: np.full((1, width), value)}))


def _identity(size: str, value: float, findings: Findings) -> None:
    head = synthetic_head(size)
    shape = np.full(head.shapedirs.shape[2], value, F)
    _hold(findings, head, replace(_motion(head, {}), shape=shape))


def _each_turn(size: str, angle: float, findings: Findings) -> None:
    head = synthetic_head(size)
    turns = np.eye(15).reshape(15, 5, 3) * angle
    _hold(findings, head, _motion(head, _by_joint(np.concatenate([turns, -turns]))))


def _every_turn(size: str, angle: float, findings: Findings) -> None:
    head = synthetic_head(size)
    _hold(findings, head, _motion(head, _by_joint(np.full((1, 5, 3), angle))))


def _refused(name: str, value: float, findings: Findings) -> None:
    """At the door, as whoever reads a motion checks it; and by the pose itself where nobody did."""
    head = synthetic_head("small")
    motion = _motion(head, {})
    getattr(motion, name)[0, 0] = value
    findings.refused(motion.validate, FormatError, f"motion parameter {name}")
    if not np.isfinite(value):
        findings.refused(lambda: list(_posed(head, "compiled", motion)), GeometryError, "a vertex that is not finite")


def _drift(size: str, amplitude: float, findings: Findings) -> None:
    for way in WAYS:
        limit = 1e3 * _allowed(way, amplitude) * EPS * float(np.abs(synthetic_head(size).v_template).max())
        findings.below(f"{way}, at most", float(drift_mm(size, amplitude, way).max()), limit, " mm")


def _hold(findings: Findings, head: HeadModel, motion: Motion) -> None:
    """Pose every frame both ways, and require what must be."""
    longest = max(float(np.abs(getattr(motion, name)).max()) for name in ROTATIONS)
    for way in WAYS:
        worst = 0.0
        try:
            for vertices, exact in _posed(head, way, motion):
                worst = max(worst, float(np.abs(vertices - exact).max() / np.abs(exact).max()))
        except GeometryError as refusal:
            findings.require("triangle" in str(refusal), f"{type(refusal).__name__}: {refusal}")
            continue
        findings.below(f"{way}: roundings of the largest coordinate", worst / EPS, _allowed(way, longest))


def _allowed(way: str, longest_rad: float) -> float:
    return DRIFT + (TURNED * longest_rad if way == "plain" else 0.0)


def _posed(
    head: HeadModel, way: str, motion: Motion
) -> Iterator[tuple[Float[np.ndarray, "v 3"], Float[np.ndarray, "v 3"]]]:
    """Give the vertices of each frame, in float32 and exactly; not a number where a frame that was not refused is none.

    Raises:
        GeometryError: a triangle has no frame in this pose.
    """
    exact, plain, compiled = ExactHead(head, motion), Poser(head, motion), PosedHead(head, motion)
    for frame in range(len(motion)):
        parts = {name: getattr(motion, name)[frame] for name in ("expression", *ROTATIONS, "translation")}
        leaves = {name: torch.from_numpy(part.astype(np.float64)) for name, part in parts.items()}
        if way == "plain":
            vertices = plain(frame)
        else:
            vectors = np.concatenate([parts[name] for name in ROTATIONS]).reshape(5, 3)
            pose = compiled.pose(parts["expression"], vectors, parts["translation"])
            vertices = pose.vertices
            if not all(np.isfinite(array).all() for array in (*vars(pose.frames).values(), pose.quaternions)):
                vertices = np.full_like(vertices, np.nan)
        yield vertices, exact.vertices(leaves).numpy()


def _motion(head: HeadModel, parts: dict[str, Any]) -> Motion:
    """Give a motion at rest but for some parts; of one frame where there are none."""
    n_frames = max((len(part) for part in parts.values()), default=1)
    rest = Motion.rest(head.shapedirs.shape[2], head.exprdirs.shape[2], n_frames)
    return replace(rest, **{name: part.astype(F) for name, part in parts.items()})


def _by_joint(vectors: Float[np.ndarray, "t 5 3"]) -> dict[str, Float[np.ndarray, "t _"]]:
    """Give rotation vectors by the names of the motion."""
    return {
        "rotation": vectors[:, 0],
        "neck": vectors[:, 1],
        "jaw": vectors[:, 2],
        "eyes": vectors[:, 3:].reshape(-1, 6),
    }
