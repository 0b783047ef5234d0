"""Hard cases of the rasteriser: values that are none, values at its thresholds, and splats in places where there should be none."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace
from functools import partial

import numpy as np
from numpy.typing import ArrayLike

from sacha_core.bench.stability.case import Case, Findings
from sacha_core.bench.stability.drawing import (
    BACKGROUND,
    FIELDS,
    FLIP,
    GRADIENT,
    PIXEL,
    Drawn,
    drawn,
    good_splats,
    hold_to_exact,
    joined,
    slanted_camera,
    straight_camera,
    watch,
)
from sacha_core.errors import SachaError
from sacha_core.raster.camera import Camera
from sacha_core.raster.rasteriser import NEAR
from sacha_core.raster.splats import Splats

__all__ = ["cases"]

F = np.float32
ALPHA_MIN = F(1 / 255)
LARGEST, SMALLEST = np.finfo(F).max, np.finfo(F).smallest_subnormal
OPACITY = 0.6
PLACES = np.array([0, 3, 15, 16, 40])  # first and last of a block of sixteen, and in the last, incomplete one

GEOMETRY = ("means", "scales", "quaternions", "opacities")
NONE = {"NaN": F(np.nan), "+inf": F(np.inf), "-inf": F(-np.inf), "the largest": LARGEST}
FAINT = {"0": F(0), "-1": F(-1), "just below 1/255": np.nextafter(ALPHA_MIN, F(0)), "denormal": SMALLEST}
SOLID = {"0.99": F(0.99), "just above it": np.nextafter(F(0.99), F(1)), "1": F(1), "1.5": F(1.5)}
DEPTHS_M = {"on the camera": 0.0, "behind it": -1.0, "on the near plane": NEAR}
CAMERAS = {
    "1 x 1 pixel": slanted_camera(1, 1, 2.0),
    "5000 x 1": slanted_camera(5000, 1, 8000.0),
    "1 x 5000": slanted_camera(1, 5000, 8000.0),
    "a focal length of a million pixels": slanted_camera(focal=1e6),
    "a focal length of 0.01 pixels": slanted_camera(focal=0.01),
    "the principal point 100,000 pixels aside": replace(slanted_camera(), cx=1e5),
    "turned over": replace(slanted_camera(), rotation=-slanted_camera().rotation),
}

VANISHES = "vanish: the others unchanged to the bit"
DRAWN = "be drawn as by the exact compositor"
REFUSED = "be refused by name"


def cases(full: bool = False) -> Iterator[Case]:  # noqa: ARG001 (there is nothing to look closer at)
    """Give the family."""
    for attribute in GEOMETRY:
        given = f"{', '.join(NONE)}; one number or all"
        yield Case(f"{attribute} that are none", given, VANISHES, partial(_vanish, attribute, NONE))
    yield Case("colours that are none", ", ".join(NONE), REFUSED, _colours_refused)
    for attribute in ("means", "scales", "colours"):
        yield Case(
            f"{attribute} denormal", f"{SMALLEST:.1g}", DRAWN, partial(_drawn, attribute, {"denormal": SMALLEST})
        )
    tiny = {"0": F(0), "denormal": SMALLEST, "1e-9": F(1e-9)}
    yield Case("quaternions without direction", ", ".join(tiny), VANISHES, partial(_vanish, "quaternions", tiny))
    yield Case("opacities too faint", ", ".join(FAINT), VANISHES, partial(_vanish, "opacities", FAINT))
    yield Case("opacity exactly 1/255", "one splat in the middle of a pixel", DRAWN, _at_the_first_threshold)
    yield Case("opacities too solid", ", ".join(SOLID), DRAWN, partial(_drawn, "opacities", SOLID))
    yield Case("points", "scales 0", DRAWN, partial(_drawn, "scales", {"0": F(0)}))
    wide = {"1e6 m": F(1e6)}
    yield Case("a million pixels wide", "standard deviation 1e6 m", VANISHES, partial(_vanish, "scales", wide))
    yield Case("a million pixels covered", "one splat over 1024 x 1024", DRAWN, _million_pixels, slow=True)
    yield Case("needles", "half a metre long, a micrometre thick", DRAWN, _needles)
    yield Case("no place before the camera", ", ".join(DEPTHS_M), VANISHES, _not_before)
    yield Case("just beyond the near plane", f"{NEAR + 1e-3:g} m before the camera", DRAWN, _beyond_near)
    yield Case("tile edges", "means and boxes on edges and corners", DRAWN, _tile_edges)
    yield Case("10,000 at one point", "one place, one depth, faint", DRAWN, _one_point, slow=True)
    yield Case("equal depths", "200 splats; earlier rows are in front", DRAWN, _equal_depths)
    yield Case("extreme cameras", "1 x 1 to 5000 pixels, focal lengths 0.01 to 1e6, turned over", DRAWN, _by_camera)
    yield Case("nothing", "no splat at all", "give the background", _nothing)


def _vanish(attribute: str, values: dict[str, np.floating], findings: Findings) -> None:
    good, camera = good_splats(), slanted_camera()
    expected = drawn(good, camera)
    others = np.setdiff1d(np.arange(len(good) + len(PLACES)), PLACES)
    for value in findings.each(values):
        for column in _columns(attribute, value):
            poison = _poisoned(attribute, value, column)
            seen = watch(findings, joined(good, poison, PLACES), camera)
            findings.same_bits("the others", seen.of(others), expected.arrays)
            findings.require(not seen.visible[PLACES].any(), "not visible")
            gradients = seen.of(PLACES)
            findings.require(not any(gradients[name].any() for name in (*FIELDS, "means_2d")), "no gradient")
            findings.require(_is_background(watch(findings, poison, camera)), "alone, the background")


def _drawn(attribute: str, values: dict[str, np.floating], findings: Findings) -> None:
    camera = slanted_camera()
    for value in findings.each(values):
        poison = _poisoned(attribute, value, None)
        for splats in (joined(good_splats(), poison, PLACES), poison):
            watch(findings, splats, camera)
            hold_to_exact(findings, splats, camera)


def _poisoned(attribute: str, value: np.floating, column: int | None) -> Splats:
    """Give five splats that are good but for one attribute, or one number of it."""
    splats = good_splats(len(PLACES), seed=2)
    array = getattr(splats, attribute)
    array[(..., slice(None)) if column is None else (..., column)] = value
    return splats


def _columns(attribute: str, value: np.floating) -> list[int | None]:
    """Give which numbers to poison: all at once, and each alone where one is enough to make the splat meaningless."""
    width = {"means": 3, "scales": 3, "quaternions": 4, "opacities": 0}[attribute]
    return [None, *range(width)] if not abs(value) < LARGEST else [None]


def _colours_refused(findings: Findings) -> None:
    for value in findings.each(NONE):
        splats = good_splats()
        splats.colours[16, 2] = value
        findings.refused(partial(drawn, splats, slanted_camera()), SachaError, "colour of Gaussian 16")
        hold_to_exact(findings, good_splats(), slanted_camera())  # the rasteriser is as good as before


def _at_the_first_threshold(findings: Findings) -> None:
    camera = straight_camera()
    splats = _at_pixels(camera, [[10.5, 20.5], [30.0, 30.0], [50.25, 12.75]])
    splats.opacities[:] = ALPHA_MIN
    seen = watch(findings, splats, camera)
    hold_to_exact(findings, splats, camera)
    away = np.abs(seen.arrays["image"] - BACKGROUND[:, None, None]).max(axis=0)
    findings.require(int(np.count_nonzero(away)) <= 1, "at most that pixel")
    findings.below("by", float(away.max()), FLIP)


def _needles(findings: Findings) -> None:
    splats = good_splats(64, seed=3)
    splats.scales[:16] = (0.5, 1e-6, 1e-6)
    splats.scales[16:32] = (0.2, 0.2, 0)
    watch(findings, splats, slanted_camera())
    # a needle of some hundred pixels magnifies the rounding of its angle, and so the band and the error
    hold_to_exact(findings, splats, slanted_camera(), pixel=10 * PIXEL, gradient=10 * GRADIENT, band=1e-3)


def _million_pixels(findings: Findings) -> None:
    camera = straight_camera(1024, 1024, 1024.0)
    splats = _at_pixels(camera, [[512.0, 512.0], [300.5, 700.25], [800.0, 96.0]])
    splats.scales[0], splats.opacities[0] = 0.8, 0.9
    seen = watch(findings, splats, camera)
    findings.require(bool((seen.arrays["transmittance"] < 1).all()), "every pixel covered")
    hold_to_exact(findings, splats, camera)


def _not_before(findings: Findings) -> None:
    camera = straight_camera()
    good = _at_pixels(camera, [[10.0, 20.0], [30.5, 30.5], [50.25, 12.75]])
    expected = drawn(good, camera)
    for depth_m in findings.each(DEPTHS_M):
        other = _at_pixels(camera, [[32.0, 32.0]])
        other.means[:] = (0, 0, depth_m)
        seen = watch(findings, joined(good, other, np.array([1])), camera)
        findings.same_bits("the others", seen.of(np.array([0, 2, 3])), expected.arrays)
        findings.require(not seen.visible[1], "not visible")
        findings.require(_is_background(watch(findings, other, camera)), "alone, the background")


def _beyond_near(findings: Findings) -> None:
    camera = straight_camera()
    near = _at_pixels(camera, [[40.0, 32.0]], NEAR + 1e-3)
    splats = joined(_at_pixels(camera, [[10.0, 20.0]]), near, np.array([0]))
    findings.require(bool(watch(findings, splats, camera).visible.all()), "both visible")
    hold_to_exact(findings, splats, camera)


def _tile_edges(findings: Findings) -> None:
    """Tiles are 8 x 32 pixels; every mean here is exact in float32, and in the middle the last box ends where its tile does."""
    camera = straight_camera()
    across, down = np.array([0.0, 7.5, 8.0, 8.5, 32.0, 63.5, 64.0]), np.array([0.0, 31.5, 32.0, 32.5, 63.5, 64.0])
    pixels = np.stack(np.meshgrid(across, down), -1).reshape(-1, 2)
    eight_pixels = np.sqrt(8**2 / (2 * np.log(OPACITY * 255)) - 0.3)
    for size in findings.each((0.0, 1.0, 4.0, eight_pixels)):
        splats = _at_pixels(camera, pixels)
        splats.scales[:] = size / camera.fx
        watch(findings, splats, camera)
        hold_to_exact(findings, splats, camera)


def _one_point(findings: Findings) -> None:
    n, camera = 10_000, straight_camera(16, 16, 16.0)
    rng = np.random.default_rng(4)
    splats = _at_pixels(camera, np.repeat([[8.0, 8.0]], n, axis=0))
    splats.scales[:], splats.opacities[:] = 0.2, rng.uniform(0.5, 3, n) / 255
    splats.colours[:] = rng.uniform(0, 1, (n, 4))
    watch(findings, splats, camera)
    hold_to_exact(findings, splats, camera)


def _equal_depths(findings: Findings) -> None:
    rng, camera = np.random.default_rng(6), straight_camera()
    splats = _at_pixels(camera, rng.uniform(8, 56, (200, 2)))
    splats.scales[:], splats.opacities[:] = rng.uniform(0.02, 0.1, (200, 3)), rng.uniform(0.2, 0.9, 200)
    splats.colours[:] = rng.uniform(0, 1, (200, 4))
    watch(findings, splats, camera)
    hold_to_exact(findings, splats, camera)


def _by_camera(findings: Findings) -> None:
    for camera in findings.each(CAMERAS):
        watch(findings, good_splats(), camera)
        hold_to_exact(findings, good_splats(), camera)


def _nothing(findings: Findings) -> None:
    findings.require(_is_background(watch(findings, good_splats(0), slanted_camera())), "the background")


def _at_pixels(camera: Camera, pixels: ArrayLike, depth_m: float = 1.0) -> Splats:
    """Give small round splats whose means `straight_camera` sees at these pixels."""
    places = np.asarray(pixels, float)
    n = len(places)
    slopes = (places - (camera.cx, camera.cy)) / (camera.fx, camera.fy)
    means = np.concatenate([slopes, np.ones((n, 1))], axis=1) * depth_m
    turns, colours = np.tile([1.0, 0, 0, 0], (n, 1)), np.tile([0.2, 0.5, 0.8, 0.9], (n, 1))
    arrays = (means, np.full((n, 3), 0.02), turns, np.full(n, OPACITY), colours)
    return Splats(*(a.astype(F) for a in arrays))


def _is_background(seen: Drawn) -> bool:
    return bool((seen.arrays["image"] == BACKGROUND[:, None, None]).all())
