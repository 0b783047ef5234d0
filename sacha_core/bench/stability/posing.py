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
from sacha_core.flame.posing import TURNS, Poser, joint_vectors
from sacha_core.flame.synthetic import synthetic_head

__all__ = ["WAYS", "cases", "drift_mm"]

F = np.float32
EPS = float(np.finfo(F).eps)
# Roundings of the largest coordinate that a vertex may be off, whatever the pose: sums of some tens of terms
DRIFT = 8.0
TURNED = 4.0  # the same for each radian of the longest rotation vector, where it is turned in float32
WAYS = ("compiled", "plain")
AMPLITUDES_RAD = (0.1, 0.5, 1.0, float(np.pi), 10.0, 100.0)
POSES = 12  # random ones of each amplitude

TENS = (10.1, -10.1)  # a little beyond: what the head is made of is exact in float32, and so are tens of it
TURNS_RAD = {"half a turn": np.pi, "a turn": 2 * np.pi, "a thousand radians": 1e3, "a million": 1e6}
PLACES_M = (1.0, 1e3, 1e6, LARGEST)

POSED = "be as near to float64 as float32 can be, every triangle's frame finite; or be refused by name"
REFUSED = "be refused by name"


def cases(full: bool = False) -> Iterator[Case]:
    """Give the family; `full` poses the head of FLAME's size."""
    size = "full" if full else "small"
    yield Case("expression +-10", "every component in turn, and all at once", POSED, partial(_expression, size))
    yield Case("identity +-10", "every component of the shape at once", POSED, partial(_identity, size))
    given = f"{', '.join(TURNS_RAD)}; every joint and axis in turn, and all"
    yield Case("large turns", given, POSED, partial(_large_turns, size))
    given = "1e-8, -1e-8 (which cancels FLAME's offset), 1e-20, 1e-45 rad; all joints and axes"
    yield Case("tiny turns", given, POSED, partial(_tiny_turns, size))
    given = f"{', '.join(f'{place:.3g}' for place in PLACES_M)} m along every axis"
    yield Case("far away", given, POSED, partial(_far_away, size))
    for name in ("expression", "rotation", "jaw", "translation"):
        yield Case(
            f"{name} that is none", "NaN, inf, or beyond all bounds in one frame", REFUSED, partial(_refused, name)
        )
    given = f"every joint of random poses turned by {AMPLITUDES_RAD[0]:g} to {AMPLITUDES_RAD[-1]:g} rad"
    yield Case(
        "drift along chains of joints", given, "stay within float32's rounding of float64", partial(_drift, size)
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
    posers = Posers(head, motion)
    return np.array([1e3 * posers.error_m(way, frame) for frame in range(POSES)])


class Posers:
    """The ways to pose the frames of a motion.

    Args:
        head: the head.
        motion: its motion.
    """

    def __init__(self, head: HeadModel, motion: Motion) -> None:
        self._motion = motion
        self._exact, self._plain, self._compiled = ExactHead(head, motion), Poser(head, motion), PosedHead(head, motion)

    def exact(self, frame: int) -> Float[np.ndarray, "v 3"]:
        """Give the vertices in float64."""
        names = ("expression", *TURNS, "translation")
        leaves = {name: torch.from_numpy(getattr(self._motion, name)[frame].astype(np.float64)) for name in names}
        vertices: np.ndarray = self._exact.vertices(leaves).numpy()
        return vertices

    def shipped(self, way: str, frame: int) -> Float[np.ndarray, "v 3"]:
        """Give the vertices in float32; not a number where a triangle's frame that was not refused is none.

        Raises:
            GeometryError: a triangle has no frame in this pose.
        """
        motion = self._motion
        if way == "plain":
            return self._plain(frame)
        vectors = joint_vectors(motion, frame)
        pose = self._compiled.pose(motion.expression[frame], vectors, motion.translation[frame])
        sound = all(np.isfinite(array).all() for array in (*vars(pose.frames).values(), pose.quaternions))
        return pose.vertices if sound else np.full_like(pose.vertices, np.nan)

    def error_m(self, way: str, frame: int) -> float:
        """Give how far the worst vertex is from float64, metres."""
        return float(np.abs(self.shipped(way, frame) - self.exact(frame)).max())


def _expression(size: str, findings: Findings) -> None:
    head = synthetic_head(size)
    n = head.exprdirs.shape[2]
    for value in findings.each(TENS):
        _hold(findings, head, _motion(head, {"expression": value * np.concatenate([np.eye(n), np.ones((1, n))])}))


def _identity(size: str, findings: Findings) -> None:
    head = synthetic_head(size)
    for value in findings.each(TENS):
        _hold(findings, head, replace(_motion(head, {}), shape=np.full(head.shapedirs.shape[2], value, F)))


def _large_turns(size: str, findings: Findings) -> None:
    head = synthetic_head(size)
    axes = np.concatenate([np.eye(15), np.ones((1, 15))]).reshape(-1, 5, 3)
    for angle in findings.each(TURNS_RAD):
        _hold(findings, head, _motion(head, _by_joint(np.concatenate([angle * axes, -angle * axes]))))


def _tiny_turns(size: str, findings: Findings) -> None:
    head = synthetic_head(size)
    for angle in findings.each((1e-8, -1e-8, 1e-20, 1e-45)):
        _hold(findings, head, _motion(head, _by_joint(np.full((1, 5, 3), angle))))


def _far_away(size: str, findings: Findings) -> None:
    head = synthetic_head(size)
    for place in findings.each(PLACES_M):
        _hold(findings, head, _motion(head, {"translation": np.full((1, 3), place)}))


def _refused(name: str, findings: Findings) -> None:
    """At the door, as whoever reads a motion checks it; and by the pose itself where nobody did."""
    head = synthetic_head("small")
    for value in findings.each((np.nan, np.inf, 2 * LARGEST)):
        motion = _motion(head, {})
        getattr(motion, name)[0, 0] = value
        findings.refused(motion.validate, FormatError, f"motion parameter {name}")
        if not np.isfinite(value):
            action = partial(Posers(head, motion).shipped, "compiled", 0)
            findings.refused(action, GeometryError, "a vertex that is not finite")


def _drift(size: str, findings: Findings) -> None:
    extent_m = float(np.abs(synthetic_head(size).v_template).max())
    for way in WAYS:
        for amplitude in findings.each(AMPLITUDES_RAD):
            limit = 1e3 * _allowed(way, amplitude) * EPS * extent_m
            findings.below(f"{way}: off by", float(drift_mm(size, amplitude, way).max()), limit, " mm")


def _hold(findings: Findings, head: HeadModel, motion: Motion) -> None:
    """Pose every frame both ways, and require what must be."""
    longest = max(float(np.abs(getattr(motion, name)).max()) for name in TURNS)
    posers = Posers(head, motion)
    for way in WAYS:
        for frame in range(len(motion)):
            try:
                error = posers.error_m(way, frame)
            except GeometryError as refusal:
                findings.require(str(refusal).startswith("triangle"), f"{way}: refused by name")
                continue
            roundings = error / EPS / float(np.abs(posers.exact(frame)).max())
            findings.below(f"{way}: roundings of the largest coordinate", roundings, _allowed(way, longest))


def _allowed(way: str, longest_rad: float) -> float:
    return DRIFT + (TURNED * longest_rad if way == "plain" else 0.0)


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
