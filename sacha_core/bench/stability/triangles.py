"""Hard cases of triangle frames: degenerate, inverted, vanishing. The plain and the compiled frames are both held to them."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from functools import partial

import numpy as np
from jaxtyping import Float

from sacha_core.animation.posed import PosedHead
from sacha_core.avatar.motion import Motion
from sacha_core.bench.stability.case import Case, Findings
from sacha_core.errors import GeometryError
from sacha_core.flame.model import HeadModel
from sacha_core.geometry.triangle import TriangleFrames, degenerate_limit, triangle_frames

__all__ = ["cases"]

F = np.float32
EPS = float(np.finfo(F).eps)
FACES = np.array([[0, 1, 2]], np.int32)
SLIVER = 4.0  # rounding of a few products, in units of EPS over the sine of the corner
ORDINARY = 20 * EPS / 0.05  # random triangles have corners down to a sine of 0.05
TRIES = 24  # triangles in random places and directions

# Where the third vertex lies on the line through the others, from the first in edges
NO_AREA = {"on the first": 0.0, "on the second": 1.0, "between them": 1 / 3, "beyond": -7.7}

Vertices = Float[np.ndarray, "3 3"]
REFUSED = "be refused by name"
FINITE_OR_REFUSED = "have a proper frame, as precise as float32 allows, or be refused by name"


def cases(full: bool = False) -> Iterator[Case]:  # noqa: ARG001 (there is nothing to look closer at)
    """Give the family."""
    yield Case("no area", f"the third vertex {', '.join(NO_AREA)}", REFUSED, _no_area)
    yield Case("vertices that are none", "one coordinate NaN, inf or -inf", REFUSED, _not_finite)
    yield Case("inverted", "two vertices exchanged", "have the opposite normal and a proper frame", _inverted)
    yield Case("sliver", "the third vertex comes to the edge: sine 1 to 1e-12", FINITE_OR_REFUSED, _sliver)
    yield Case("vanishing", "edges from a centimetre down to 1e-40 m", FINITE_OR_REFUSED, partial(_sizes, -1))
    yield Case("growing", "edges from a centimetre up to 1e36 m", FINITE_OR_REFUSED, partial(_sizes, 1))
    yield Case("far away", "a centimetre of triangle, 1 to 1e9 m from the origin", FINITE_OR_REFUSED, _far_away)


def plain(vertices: Vertices) -> TriangleFrames:
    """Frame by NumPy."""
    return triangle_frames(vertices, FACES)


def compiled(vertices: Vertices) -> TriangleFrames:
    """Frame as training and playing have it: by a head that is nothing but this triangle."""
    head = HeadModel(
        name="triangle",
        v_template=np.asarray(vertices, F),
        faces=FACES,
        shapedirs=np.zeros((3, 3, 0), F),
        exprdirs=np.zeros((3, 3, 0), F),
        J_regressor=np.zeros((1, 3), F),
        weights=np.ones((3, 1), F),
        parents=np.array([-1]),
    )
    return PosedHead(head, Motion.rest(0, 0)).pose(np.zeros(0, F), np.zeros((5, 3), F), np.zeros(3, F)).frames


WAYS: dict[str, Callable[[Vertices], TriangleFrames]] = {"plain": plain, "compiled": compiled}


def _no_area(findings: Findings) -> None:
    ends = np.array([[0.1, 0.2, -0.3], [0.4, -0.1, 0.2]], F)
    for third in findings.each(NO_AREA):
        vertices = np.array([*ends, ends[0] + F(third) * (ends[1] - ends[0])], F)
        for way in WAYS.values():
            findings.refused(partial(way, vertices), GeometryError, "triangle 0 has zero area")


def _not_finite(findings: Findings) -> None:
    for poison in findings.each((np.nan, np.inf, -np.inf)):
        vertices = np.array([[0, 0, 0], [1, 0, 0], [0, 1, poison]], F)
        for way in WAYS.values():
            with np.errstate(invalid="ignore"):
                findings.refused(partial(way, vertices), GeometryError, "triangle 0 has a vertex that is not finite")


def _inverted(findings: Findings) -> None:
    worst = 0.0
    for vertices in _random_triangles():
        for way in WAYS.values():
            frame, turned = way(vertices), way(vertices[[0, 2, 1]])
            worst = max(
                worst, _improper(turned), float(np.abs(turned.rotation[0, :, 1] + frame.rotation[0, :, 1]).max())
            )
    findings.below("error", worst, ORDINARY)


def _sliver(findings: Findings) -> None:
    worst, wrong = 0.0, 0
    limit = degenerate_limit(np.dtype(F))
    for sine in 2.0 ** -np.arange(41):
        for vertices in _random_triangles(sine):
            true_sine = _sine(vertices.astype(np.float64))
            for way in WAYS.values():
                error = _frame_error(way, vertices)
                wrong += error is None and true_sine > 2 * limit
                wrong += error is not None and true_sine < limit / 2
                worst = max(worst, 0.0 if error is None else error * true_sine / EPS)
    findings.require(wrong == 0, f"refused where the sine is below {limit:.2g} and not where it is above")
    findings.below("error in roundings over the sine", worst, SLIVER)


def _sizes(sign: int, findings: Findings) -> None:
    worst, least, most, split = 0.0, np.inf, 0.0, 0
    for halvings in range(140):
        size = 0.01 * 2.0 ** (sign * halvings)
        for vertices in _random_triangles(size=size):
            with np.errstate(over="ignore"):
                errors = [_frame_error(way, vertices) for way in WAYS.values()]
            split += (errors[0] is None) != (errors[1] is None)
            if errors[0] is not None:
                worst, least, most = (
                    max(worst, *(e for e in errors if e is not None)),
                    min(least, size),
                    max(most, size),
                )
    findings.require(split == 0, "both ways refuse the same")
    findings.below("error", worst, ORDINARY)
    findings.seen("carried down to" if sign < 0 else "carried up to", least if sign < 0 else most, " m")


def _far_away(findings: Findings) -> None:
    worst, farthest = 0.0, 0.0
    for power in range(10):
        for vertices in _random_triangles():
            moved = vertices + F(10.0**power)
            for way in WAYS.values():
                error = _frame_error(way, moved)
                if error is not None:
                    worst, farthest = (
                        max(worst, error * _sine(moved.astype(np.float64)) / EPS),
                        max(farthest, 10.0**power),
                    )
    findings.below("error in roundings over the sine", worst, SLIVER)
    findings.seen("carried at", farthest, " m")


def _random_triangles(sine: float | None = None, size: float = 0.01) -> list[Vertices]:
    """Give float32 triangles with a corner of this sine, or none below 0.05, in random directions."""
    rng = np.random.default_rng(3)
    triangles = []
    for _ in range(TRIES):
        corner = rng.uniform(0.05, 1) if sine is None else sine
        turn = np.linalg.qr(rng.normal(size=(3, 3)))[0]
        flat = np.array([[0, 0, 0], [1, 0, 0], [np.sqrt(1 - corner**2), corner, 0]])
        with np.errstate(over="ignore"):  # what is too large for float32 shall be refused
            triangles.append((size * flat @ turn).astype(F))
    return triangles


def _sine(vertices: Vertices) -> float:
    edge, second = vertices[1] - vertices[0], vertices[2] - vertices[0]
    lengths = np.linalg.norm(edge) * np.linalg.norm(second)
    return float(np.linalg.norm(np.cross(edge, second)) / lengths) if lengths > 0 else 0.0


def _frame_error(way: Callable[[Vertices], TriangleFrames], vertices: Vertices) -> float | None:
    """Give how far a frame is from that of the same vertices in float64, its scale relative; None where it is refused by name."""
    try:
        frame = way(vertices)
    except GeometryError as refusal:
        if "triangle 0 has" not in str(refusal):
            raise
        return None
    exact = triangle_frames(vertices.astype(np.float64), FACES)
    by_scale = abs(float(frame.scale[0] / exact.scale[0]) - 1)
    return max(float(np.abs(frame.rotation - exact.rotation).max()), by_scale)


def _improper(frames: TriangleFrames) -> float:
    """Give how far a frame's rotation is from being one."""
    rotation = frames.rotation[0].astype(np.float64)
    return max(float(np.abs(rotation @ rotation.T - np.eye(3)).max()), abs(float(np.linalg.det(rotation)) - 1))
