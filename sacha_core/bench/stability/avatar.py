"""Hard values of an avatar's own parameters, on their way through triangles, harmonics and sigmoids to the picture."""

from __future__ import annotations

from collections.abc import Iterator
from functools import lru_cache, partial

import numpy as np

from sacha_core.animation.carry import carry
from sacha_core.animation.posed import Pose, PosedHead
from sacha_core.avatar.binding import to_world
from sacha_core.avatar.gaussians import Gaussians
from sacha_core.avatar.motion import Motion
from sacha_core.bench.stability.case import Case, Findings
from sacha_core.bench.stability.drawing import BACKGROUND, drawn, hold_to_exact, watch
from sacha_core.errors import SachaError
from sacha_core.flame.synthetic import synthetic_head
from sacha_core.raster.camera import Camera
from sacha_core.raster.harmonics import sh_colours
from sacha_core.raster.splats import Splats

__all__ = ["cases"]

F = np.float32
LARGEST, SMALLEST = float(np.finfo(F).max), float(np.finfo(F).smallest_subnormal)
N_GOOD, DEGREE = 40, 3
PLACES = np.array([0, 3, 15, 16, 44])  # first and last of a block of sixteen, and in the last, incomplete one

VANISHES = "vanish: the others unchanged to the bit"
DRAWN = "be drawn as by the exact compositor"
REFUSED = "be refused by name"
TITLES = {VANISHES: " of no Gaussian", DRAWN: " at the ends of float32", REFUSED: " of no colour"}

VANISHING = {
    "position": (np.nan, np.inf, -np.inf, LARGEST),
    "log_scale": (80.0, 90.0, LARGEST, np.nan, np.inf),
    "quaternion": (0.0, 1e-30, np.nan, np.inf, LARGEST),
    "opacity_logit": (-100.0, -LARGEST, np.nan, -np.inf),
}
DRAWABLE = {
    "position": (SMALLEST, 0.0),
    "log_scale": (-80.0, -LARGEST, -np.inf),
    "quaternion": (1.0, 1e15),
    "opacity_logit": (100.0, LARGEST, np.inf, SMALLEST),
    "sensitivity_logit": (100.0, -100.0, SMALLEST),
    "sh_dc": (-1e30, SMALLEST, 100.0),
    "sh_rest": (SMALLEST, 100.0),
}
COLOURLESS = {"sh_dc": (np.nan, np.inf), "sh_rest": (np.nan, -np.inf), "sensitivity_logit": (np.nan,)}


def cases(full: bool = False) -> Iterator[Case]:  # noqa: ARG001 (there is nothing to look closer at)
    """Give the family."""
    for table, must, check in (
        (VANISHING, VANISHES, _vanish),
        (DRAWABLE, DRAWN, _drawn),
        (COLOURLESS, REFUSED, _refused),
    ):
        for name, values in table.items():
            given = ", ".join(f"{value:.3g}" for value in values)
            yield Case(f"{name}{TITLES[must]}", given, must, partial(check, name, values))


def _vanish(name: str, values: tuple[float, ...], findings: Findings) -> None:
    others = np.setdiff1d(np.arange(N_GOOD + len(PLACES)), PLACES)
    for value in findings.each(values):
        gaussians = _poisoned(name, value)
        for way in (_plain, _compiled):
            without = drawn(way(gaussians.select(others)), _camera())
            seen = watch(findings, way(gaussians), _camera())
            findings.same_bits("the others", seen.of(others), without.arrays)
            findings.require(not seen.visible[PLACES].any(), "not visible")
            alone = watch(findings, way(gaussians.select(PLACES)), _camera())
            findings.require(bool((alone.arrays["image"] == BACKGROUND[:, None, None]).all()), "alone, the background")


def _drawn(name: str, values: tuple[float, ...], findings: Findings) -> None:
    for value in findings.each(values):
        gaussians = _poisoned(name, value)
        for way in (_plain, _compiled):
            for chosen in (gaussians, gaussians.select(PLACES)):
                splats = way(chosen)
                watch(findings, splats, _camera())
                hold_to_exact(findings, splats, _camera())


def _refused(name: str, values: tuple[float, ...], findings: Findings) -> None:
    for value in findings.each(values):
        gaussians = _scene()
        getattr(gaussians, name)[16, ...] = value
        for way in (_plain, _compiled):
            findings.refused(partial(drawn, way(gaussians), _camera()), SachaError, "of Gaussian 16")


def _plain(gaussians: Gaussians) -> Splats:
    """Carry by NumPy."""
    world = to_world(gaussians, _pose().frames)
    return Splats(world.means, world.scales, world.quaternions, world.opacities, _colours(gaussians, world.means))


def _compiled(gaussians: Gaussians) -> Splats:
    """Carry as playing does."""
    local = (gaussians.position, gaussians.log_scale, gaussians.quaternion, gaussians.binding)
    means, scales, quaternions = carry(*local, _pose())
    return Splats(means, scales, quaternions, _logistic(gaussians.opacity_logit), _colours(gaussians, means))


def _colours(gaussians: Gaussians, means: np.ndarray) -> np.ndarray:
    """Colours as seen from the camera, and the sensitivity."""
    centre = np.asarray(_camera().centre, F)
    rgb = sh_colours(gaussians.sh_dc, gaussians.sh_rest, means, centre, DEGREE)
    return np.concatenate([rgb, _logistic(gaussians.sensitivity_logit)[:, None]], axis=1)


def _logistic(logit: np.ndarray | None) -> np.ndarray:
    value: np.ndarray = F(0.5) + F(0.5) * np.tanh(F(0.5) * np.asarray(logit, F))
    return value


@lru_cache(maxsize=1)
def _camera() -> Camera:
    return Camera.look_at(np.array([0.15, 0.05, 0.6]), np.array([0.0, -0.03, -0.04]), 48, 64, 110.0)


@lru_cache(maxsize=1)
def _pose() -> Pose:
    head = synthetic_head("small")
    return PosedHead(head, Motion.rest(0, 0)).pose(np.zeros(0, F), np.zeros((5, 3), F), np.zeros(3, F))


def _poisoned(name: str, value: float) -> Gaussians:
    gaussians = _scene()
    getattr(gaussians, name)[PLACES, ...] = value
    return gaussians


def _scene() -> Gaussians:
    rng = np.random.default_rng(8)
    n, head = N_GOOD + len(PLACES), synthetic_head("small")
    return Gaussians(
        position=rng.normal(0, 0.3, (n, 3)).astype(F),
        log_scale=rng.normal(0, 0.4, (n, 3)).astype(F),
        quaternion=rng.normal(0, 1, (n, 4)).astype(F),
        opacity_logit=rng.normal(0, 1.5, n).astype(F),
        sh_dc=rng.normal(0, 0.8, (n, 3)).astype(F),
        sh_rest=rng.normal(0, 0.1, (n, 15, 3)).astype(F),
        binding=np.sort(rng.choice(head.n_faces, n, replace=False)).astype(np.int32),
        sensitivity_logit=rng.normal(0, 1, n).astype(F),
    )
