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
    FLIP,
    GRADIENT,
    PIXEL,
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

POISONS = {"NaN": F(np.nan), "+inf": F(np.inf), "-inf": F(-np.inf), "largest": LARGEST}
GEOMETRY = ("means", "scales", "quaternions", "opacities")
CAMERAS = {
    "one pixel": ("an image of 1 x 1", slanted_camera(1, 1, 2.0)),
    "one row": ("an image of 5000 x 1", slanted_camera(5000, 1, 8000.0)),
    "one column": ("an image of 1 x 5000", slanted_camera(1, 5000, 8000.0)),
    "a long lens": ("a focal length of a million pixels", slanted_camera(focal=1e6)),
    "a short lens": ("a focal length of a hundredth of a pixel", slanted_camera(focal=0.01)),
    "principal point far outside": ("100,000 pixels beside the image", replace(slanted_camera(), cx=1e5)),
    "a mirror": (
        "an image that is turned over: x goes left",
        replace(slanted_camera(), rotation=-slanted_camera().rotation),
    ),
}

VANISHES = "vanish: no gradient of its own, and picture and gradients of the others as without it, to the bit"
DRAWN = "draw as the exact compositor does, with its gradients; finite"
REFUSED = "be refused by name"


def cases(full: bool = False) -> Iterator[Case]:  # noqa: ARG001 (there is nothing to look closer at)
    """Give the family."""
    for attribute in GEOMETRY:
        for name, value in POISONS.items():
            yield _vanishing(
                f"{attribute} {name}", f"{attribute} of five splats, each number alone and all", attribute, value
            )
        yield _denormal(attribute)
    for name, value in POISONS.items():
        check = _colour_too_large if value == LARGEST else partial(_colour_refused, value)
        must = "draw finite, or be refused by name" if value == LARGEST else REFUSED
        yield Case(f"colours {name}", "one colour of a splat", must, check)
    yield Case("colours denormal", "all colours of five splats", DRAWN, partial(_drawn_among, "colours", SMALLEST))
    yield _vanishing("quaternions zero", "all four numbers", "quaternions", F(0))
    yield _vanishing("quaternions tiny", "all four numbers 1e-9: no direction left", "quaternions", F(1e-9))
    yield from _opacities()
    yield from _sizes()
    yield from _places()
    for name, (given, camera) in CAMERAS.items():
        yield Case(name, given, DRAWN, partial(_by_camera, camera))


def _opacities() -> Iterator[Case]:
    for name, value in (("zero", F(0)), ("negative", F(-1)), ("just below 1/255", np.nextafter(ALPHA_MIN, F(0)))):
        yield _vanishing(f"opacity {name}", f"opacity {value:.7g}", "opacities", value)
    yield Case(
        "opacity exactly 1/255", "of every splat, one of them in the middle of a pixel", DRAWN, _at_the_first_threshold
    )
    for value in (F(0.99), np.nextafter(F(0.99), F(1)), F(1), F(1.5)):
        yield Case(
            f"opacity {value:.7g}",
            "of five splats: alpha is held at 0.99",
            DRAWN,
            partial(_drawn_among, "opacities", value),
        )


def _sizes() -> Iterator[Case]:
    yield Case("scales zero", "points", DRAWN, partial(_drawn_among, "scales", F(0)))
    yield _vanishing("a million pixels wide", "standard deviation 1e6 m", "scales", F(1e6))
    yield Case("needles", "half a metre long and a micrometre thick", DRAWN, _needles)
    yield Case("a splat of a million pixels", "covers an image of 1024 x 1024", DRAWN, _million_pixels, slow=True)


def _places() -> Iterator[Case]:
    for name, depth in (("on the camera", 0.0), ("behind the camera", -1.0), ("on the near plane", NEAR)):
        yield Case(name, f"mean {depth:g} m before the camera, on its axis", VANISHES, partial(_at_depth, depth))
    yield Case("just beyond the near plane", f"{NEAR + 1e-3:g} m before the camera", DRAWN, _beyond_near)
    yield Case("on tile edges", "means and boxes on edges and corners of tiles and of the image", DRAWN, _tile_edges)
    yield Case("10,000 at one point", "one place, one depth, faint", DRAWN, _one_point, slow=True)
    yield Case("equal depths", "200 splats at the same depth: earlier rows are in front", DRAWN, _equal_depths)
    yield Case("nothing", "no splat at all", "the background", _nothing)


def _vanishing(name: str, given: str, attribute: str, value: np.floating) -> Case:
    return Case(name, given, VANISHES, partial(_vanishes, attribute, value))


def _denormal(attribute: str) -> Case:
    name, given = f"{attribute} denormal", f"{attribute} of five splats are {SMALLEST:.1g}"
    if attribute in {"means", "scales"}:
        return Case(name, given, DRAWN, partial(_drawn_among, attribute, SMALLEST))
    return _vanishing(name, given, attribute, SMALLEST)


def _poisoned(attribute: str, value: np.floating, column: int | None) -> Splats:
    """Give five splats that are good but for one attribute, or one number of it."""
    splats = good_splats(len(PLACES), seed=2)
    array = getattr(splats, attribute)
    array[(..., slice(None)) if column is None else (..., column)] = value
    return splats


def _columns(attribute: str, value: np.floating) -> list[int | None]:
    """Give which numbers of an attribute to poison: all at once, and each alone where one is enough to make the splat meaningless."""
    width = {"means": 3, "scales": 3, "quaternions": 4, "opacities": 0}[attribute]
    return [None, *range(width)] if not abs(value) < LARGEST else [None]


def _vanishes(attribute: str, value: np.floating, findings: Findings) -> None:
    good, camera = good_splats(), slanted_camera()
    expected = drawn(good, camera)
    others = np.setdiff1d(np.arange(len(good) + len(PLACES)), PLACES)
    for column in _columns(attribute, value):
        poison = _poisoned(attribute, value, column)
        seen = watch(findings, joined(good, poison, PLACES), camera)
        findings.same_bits("the others", seen.of(others), expected.arrays)
        findings.require(not seen.visible[PLACES].any(), "not visible")
        findings.require(
            not any(seen.of(PLACES)[name].any() for name in (*GEOMETRY, "colours", "means_2d")), "no gradient"
        )
        alone = watch(findings, poison, camera)
        findings.require(_is_background(alone.arrays["image"]), "alone, the background")


def _drawn_among(attribute: str, value: np.floating, findings: Findings) -> None:
    poison, camera = _poisoned(attribute, value, None), slanted_camera()
    for splats in (joined(good_splats(), poison, PLACES), poison):
        watch(findings, splats, camera)
        hold_to_exact(findings, splats, camera)


def _colour_refused(value: np.floating, findings: Findings) -> None:
    splats = good_splats()
    splats.colours[16, 2] = value
    findings.refused(lambda: drawn(splats, slanted_camera()), SachaError, "colour of Gaussian 16")
    hold_to_exact(findings, good_splats(), slanted_camera())  # the rasteriser is as good as before


def _colour_too_large(findings: Findings) -> None:
    splats = good_splats()
    splats.colours[16, 2] = LARGEST
    try:
        arrays = drawn(splats, slanted_camera()).arrays
    except SachaError as error:
        findings.require("colour of Gaussian 16" in str(error), f"{type(error).__name__}: {error}")
        return
    findings.finite("image and gradients", arrays)


def _at_the_first_threshold(findings: Findings) -> None:
    camera, splats = straight_camera(), _at_pixels(straight_camera(), [[10.5, 20.5], [30.0, 30.0], [50.25, 12.75]])
    splats.opacities[:] = ALPHA_MIN
    seen = watch(findings, splats, camera)
    hold_to_exact(findings, splats, camera)
    away = np.abs(seen.arrays["image"] - BACKGROUND[:, None, None]).max(axis=0)
    findings.below("pixels touched", float(np.count_nonzero(away)), 1.5)
    findings.below("at most one decision's worth", float(away.max()), FLIP)


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


def _at_depth(depth_m: float, findings: Findings) -> None:
    camera = straight_camera()
    good = _at_pixels(camera, [[10.0, 20.0], [30.5, 30.5], [50.25, 12.75]])
    other = _at_pixels(camera, [[32.0, 32.0]])
    other.means[:] = (0, 0, depth_m)
    seen, expected = watch(findings, joined(good, other, np.array([1])), camera), drawn(good, camera)
    findings.same_bits("the others", seen.of(np.array([0, 2, 3])), expected.arrays)
    findings.require(not seen.visible[1], "not visible")
    findings.require(_is_background(watch(findings, other, camera).arrays["image"]), "alone, the background")


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
    for size in (0.0, 1.0, 4.0, eight_pixels):
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


def _by_camera(camera: Camera, findings: Findings) -> None:
    watch(findings, good_splats(), camera)
    hold_to_exact(findings, good_splats(), camera)


def _nothing(findings: Findings) -> None:
    seen = watch(findings, good_splats(0), slanted_camera())
    findings.require(_is_background(seen.arrays["image"]), "the background")


def _at_pixels(camera: Camera, pixels: ArrayLike, depth_m: float = 1.0) -> Splats:
    """Give small round splats whose means `straight_camera` sees at these pixels."""
    places = np.asarray(pixels, float)
    n = len(places)
    slopes = (places - (camera.cx, camera.cy)) / (camera.fx, camera.fy)
    means = np.concatenate([slopes, np.ones((n, 1))], axis=1) * depth_m
    turns, colours = np.tile([1.0, 0, 0, 0], (n, 1)), np.tile([0.2, 0.5, 0.8, 0.9], (n, 1))
    arrays = (means, np.full((n, 3), 0.02), turns, np.full(n, OPACITY), colours)
    return Splats(*(a.astype(F) for a in arrays))


def _is_background(image: np.ndarray) -> bool:
    return bool((image == BACKGROUND[:, None, None]).all())
