"""How far a drawn picture is from the exact one, looked at in patches, since the exact one takes long."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from jaxtyping import Bool, Float

from sacha_core.bench.exact import draw, leaves_of
from sacha_core.bench.result import Row
from sacha_core.raster.camera import Camera
from sacha_core.raster.splats import Splats

__all__ = ["BAND", "PictureError", "picture_error"]

# A decision at a threshold (alpha at 1/255 or 0.99, transmittance at 1e-4) closer than this, relative, float32 may take otherwise
BAND = 2e-5
SIDE = 8  # pixels of a patch
ALPHA_MIN = 1 / 255
DILATION = 0.3  # square pixels
NOTHING_FURTHER = 1e-3  # relative slack of a bound that rounding must not undercut


@dataclass(frozen=True)
class PictureError:
    """Largest and mean differences of any channel, apart for the pixels where float32 may rightly decide otherwise.

    Args:
        largest: outside the band.
        mean: over all pixels and channels.
        largest_in_band: where a decision was closer to its threshold than `BAND`; None where no pixel was.
        n_pixels: that were looked at.
        n_in_band: of these, in the band.
    """

    largest: float
    mean: float
    largest_in_band: float | None
    n_pixels: int
    n_in_band: int

    def row(self) -> Row:
        """Give the figures under the names of a row."""
        return {
            "max_error": self.largest, "mean_error": self.mean, "max_error_in_band": self.largest_in_band,
            "error_pixels": self.n_pixels, "band_pixels": self.n_in_band,
        }  # fmt: skip


def picture_error(
    image: Float[np.ndarray, "c h w"],
    splats: Splats,
    camera: Camera,
    background: Float[np.ndarray, " c"],
    depths: Float[np.ndarray, " n"],
    n_patches: int = 32,
    seed: int = 0,
) -> PictureError:
    """Compare a picture with the float64 definition in patches of 8 x 8 pixels.

    Args:
        image: what was drawn.
        splats: n Gaussians that it should show.
        camera: from where.
        background: (c,) what lies behind.
        depths: (n,) the rasteriser's own float32 depths, whose order is part of the definition.
        n_patches: how many places to look at: seven of eight where a Gaussian lies, the others anywhere.
        seed: of their choice.
    """
    rng = np.random.default_rng(seed)
    differences, bands = [], []
    means, radii = _discs(splats, camera)
    seen = ((means > 0) & (means < (camera.width, camera.height)) & (radii[:, None] > 0)).all(axis=1)
    width, height = min(SIDE, camera.width), min(SIDE, camera.height)
    for k in range(n_patches):
        centre = rng.uniform(0, (camera.width, camera.height))
        if k % 8 and seen.any():
            centre = means[rng.choice(np.flatnonzero(seen))]
        left, top = np.clip(centre.astype(int) - SIDE // 2, 0, (camera.width - width, camera.height - height)).tolist()
        reach = _reaches(means, radii, left, top, width, height)
        exact = draw(leaves_of(_some(splats, reach)), camera.crop(left, top, width, height), background, depths[reach])
        drawn = image[:, top : top + height, left : left + width]
        differences.append(np.abs(drawn - exact.image.numpy()).reshape(len(drawn), -1))
        bands.append(exact.band.ravel() < BAND)
    difference, inside = np.concatenate(differences, axis=1), np.concatenate(bands)
    largest = difference.max(axis=0)
    return PictureError(
        float(largest[~inside].max(initial=0)),
        float(difference.mean()),
        float(largest[inside].max()) if inside.any() else None,
        len(inside),
        int(inside.sum()),
    )


def _discs(splats: Splats, camera: Camera) -> tuple[Float[np.ndarray, "n 2"], Float[np.ndarray, " n"]]:
    """Give for each Gaussian a disc outside which its alpha is below 1/255, pixels; of radius 0 behind the camera.

    The radius takes the longest axis for all three and the projection's Jacobian by its norm, so it is generous, and needs no covariance.
    """
    x, y, z = (splats.means.astype(np.float64) @ camera.rotation.T + camera.translation).T
    front = z > 0
    z = np.where(front, z, 1)
    means = np.stack([camera.fx * x / z + camera.cx, camera.fy * y / z + camera.cy], 1)
    jacobian = max(camera.fx, camera.fy) / z * np.sqrt(1 + (x / z) ** 2 + (y / z) ** 2)
    spread = splats.scales.max(axis=1) * jacobian
    alpha = np.maximum(splats.opacities.astype(np.float64), ALPHA_MIN)
    radii = np.sqrt((spread**2 + DILATION) * 2 * np.log(alpha / ALPHA_MIN)) * (1 + NOTHING_FURTHER)
    return means, np.where(front, radii, 0)


def _reaches(
    means: np.ndarray, radii: np.ndarray, left: int, top: int, width: int, height: int
) -> Bool[np.ndarray, " n"]:
    """Tell which discs reach a rectangle of pixels."""
    beyond = np.maximum(np.abs(means - (left + width / 2, top + height / 2)) - (width / 2, height / 2), 0)
    reaches: np.ndarray = (beyond**2).sum(axis=1) <= radii**2
    return reaches & (radii > 0)


def _some(splats: Splats, rows: Bool[np.ndarray, " n"]) -> Splats:
    return Splats(*(getattr(splats, name)[rows] for name in ("means", "scales", "quaternions", "opacities", "colours")))
