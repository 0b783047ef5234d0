"""What drawing and comparing leave out."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace

import numpy as np
from jaxtyping import Float, UInt8

from sacha_core.bench.preset import Preset
from sacha_core.bench.scenes import front_camera, head_shell
from sacha_core.bench.skips.skip import Work, apart
from sacha_core.parallel.pool import Pool
from sacha_core.perception.image_loss import ImageLoss
from sacha_core.raster.bounds import image_bounds
from sacha_core.raster.camera import Camera
from sacha_core.raster.harmonics import degrees_in_use, sh_colours
from sacha_core.raster.rasteriser import Rasteriser
from sacha_core.raster.splats import Splats

__all__ = ["drawing_skips"]

WHITE = np.array([1, 1, 1, 0], np.float32)
REACH = 10  # pixels: of a pixel in another's gradient of SSIM
PROOFS = "tests/skips/test_skips_drawing.py"
Slice = tuple[slice, slice, slice]


def drawing_skips(preset: Preset) -> Iterator[Work]:
    """Give what is left out of an iteration's pictures, at the size of short trainings."""
    n, size = preset.of(300, 20_000, 50_000), preset.of((55, 80), (275, 401), (550, 802))
    pool, camera = Pool(preset.threads), front_camera(*size)
    yield crop(n, camera, pool)
    yield agreeing_pixels(camera, pool)
    yield out_of_sight(n, camera, pool)
    yield sensitivity_channel(n, camera, pool)
    yield inactive_harmonics(n, pool)
    yield zero_harmonics(n, pool)


@dataclass
class View:
    """Draws Gaussians, whole or cropped to what they touch, and compares them with a target that is white where they are not.

    Args:
        splats: the Gaussians.
        camera: from where.
        pool: threads.
    """

    splats: Splats
    camera: Camera
    pool: Pool

    def __post_init__(self) -> None:
        self.rasteriser, self.loss = Rasteriser(pool=self.pool), ImageLoss(pool=self.pool)
        picture = self.rasteriser.forward(self.splats, self.camera, WHITE).image
        shown = (picture != WHITE[:, None, None]).any(axis=0)
        noise = np.random.default_rng(0).integers(0, 256, (4, *shown.shape), np.uint8)
        self.target: UInt8[np.ndarray, "3 h w"] = np.where(shown, noise[:3], 255).astype(np.uint8)
        self.sensitivity: UInt8[np.ndarray, "h w"] = np.where(shown, noise[3], 0).astype(np.uint8)

    def step(self, cropped: bool) -> tuple[Slice, Float[np.ndarray, "4 h w"]]:
        """Draw, compare and go back; give the part of the picture that was drawn and the loss's gradient of it."""
        left, top, width, height = 0, 0, self.camera.width, self.camera.height
        if cropped:
            s = self.splats
            touched = image_bounds(s.means, s.scales, s.opacities, self.camera, margin=REACH, pool=self.pool)
            left, top, width, height = touched or (0, 0, width, height)
        part = np.s_[:, top : top + height, left : left + width]
        frame = self.rasteriser.forward(self.splats, self.camera.crop(left, top, width, height), WHITE)
        found = self.loss(frame.image, self.target, self.sensitivity, (left, top, left + width, top + height))
        self.rasteriser.backward(frame, found.gradient)
        return part, found.gradient

    def error(self) -> float:
        """Compare the gradients of all pixels, those that were not drawn included."""
        part, gradient = self.step(cropped=True)
        cropped = np.zeros((4, *self.sensitivity.shape), np.float32)
        cropped[part] = gradient
        return apart(cropped, self.step(cropped=False)[1])


def crop(n: int, camera: Camera, pool: Pool) -> Work:
    """Draw, compare and go back in the part of the picture that Gaussians touch."""
    view = View(head_shell(n), camera, pool)
    return Work(
        "picture outside the avatar", lambda: view.step(cropped=True), lambda: view.step(cropped=False), view.error,
        f"{PROOFS}::test_crop",
    )  # fmt: skip


def agreeing_pixels(camera: Camera, pool: Pool) -> Work:
    """Compare two images that agree outside their middle half; the plain way, differences in the first and last column widen every row."""
    rng = np.random.default_rng(1)
    target = rng.integers(0, 256, (3, camera.height, camera.width), np.uint8)
    half = target * np.float32(1 / 255)
    middle = np.s_[:, :, camera.width // 4 : -camera.width // 4]
    half[middle] += rng.normal(0, 0.1, half[middle].shape).astype(np.float32)
    wide = half.copy()
    wide[:, :, [0, -1]] += np.float32(0.5)
    few, all_of_it = ImageLoss(pool=pool), ImageLoss(pool=pool)
    inside = np.s_[:, :, REACH + 1 : -REACH - 1]

    def error() -> float:
        return apart(few(half, target).gradient[inside], all_of_it(wide, target).gradient[inside])

    proof = "tests/skips/test_skips_training.py::test_pixels_that_agree"
    return Work(
        "pixels that agree, in the loss", lambda: few(half, target), lambda: all_of_it(wide, target), error, proof
    )


def out_of_sight(n: int, camera: Camera, pool: Pool) -> Work:
    """Draw Gaussians of which half are behind the camera; the plain way, those are beside the others."""
    seen = head_shell(n // 2)
    behind = joined(seen, replace(seen, means=seen.means + 2 * np.asarray(camera.centre, np.float32)))
    beside = joined(seen, head_shell(n // 2, seed=1))
    rasteriser = Rasteriser(pool=pool)

    def picture(splats: Splats) -> np.ndarray:
        return rasteriser.forward(splats, camera, WHITE).image

    return Work(
        "Gaussians out of sight (half of them)", lambda: picture(behind), lambda: picture(beside),
        lambda: apart(picture(seen).copy(), picture(behind)), f"{PROOFS}::test_gaussians_out_of_sight",
    )  # fmt: skip


def sensitivity_channel(n: int, camera: Camera, pool: Pool) -> Work:
    """Draw colours alone."""
    four, rasteriser = head_shell(n), Rasteriser(pool=pool)
    three = replace(four, colours=np.ascontiguousarray(four.colours[:, :3]))

    def colours() -> np.ndarray:
        return rasteriser.forward(three, camera, WHITE[:3]).image

    def everything() -> np.ndarray:
        return rasteriser.forward(four, camera, WHITE).image

    return Work(
        "sensitivity channel, outside training", colours, everything,
        lambda: apart(colours().copy(), everything()[:3]), f"{PROOFS}::test_sensitivity_channel",
    )  # fmt: skip


def inactive_harmonics(n: int, pool: Pool) -> Work:
    """Colours of the degree in use, here 1, of harmonics that are kept up to degree 3."""
    rng, centre = np.random.default_rng(2), np.array([0.1, 0.2, 1.5], np.float32)
    dc, rest, means = (rng.normal(size=shape).astype(np.float32) for shape in ((n, 3), (n, 15, 3), (n, 3)))
    rest[:, 3:] = 0

    def colours(degree: int) -> np.ndarray:
        return sh_colours(dc, rest, means, centre, degree, pool)

    return Work(
        "harmonics beyond the degree in use (1 of 3)", lambda: colours(1), lambda: colours(3),
        lambda: apart(colours(1).copy(), colours(3)), f"{PROOFS}::test_inactive_harmonics",
    )  # fmt: skip


def zero_harmonics(n: int, pool: Pool) -> Work:
    """Colours of Gaussians of which every other has no harmonics beyond degree 0, as in files of a low level."""
    rng, centre = np.random.default_rng(3), np.array([0.1, 0.2, 1.5], np.float32)
    dc, rest, means = (rng.normal(size=shape).astype(np.float32) for shape in ((n, 3), (n, 15, 3), (n, 3)))
    rest[rng.random(n) < 0.5] = 0
    degrees = degrees_in_use(rest)

    def colours(known: bool) -> np.ndarray:
        return sh_colours(dc, rest, means, centre, 3, pool, degrees if known else None)

    return Work(
        "harmonics that are zero (of half the Gaussians)", lambda: colours(known=True), lambda: colours(known=False),
        lambda: apart(colours(known=True), colours(known=False)), f"{PROOFS}::test_harmonics_that_are_zero",
    )  # fmt: skip


def joined(a: Splats, b: Splats) -> Splats:
    """Give both."""
    names = ("means", "scales", "quaternions", "opacities", "colours")
    return Splats(*(np.concatenate([getattr(a, name), getattr(b, name)]) for name in names))
