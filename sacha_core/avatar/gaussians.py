"""The canonical Gaussians: what a head looks like, in the frames of the triangles it is bound to."""

from __future__ import annotations

import math
from dataclasses import dataclass, fields, replace

import numpy as np
from jaxtyping import Bool, Float, Int

from sacha_core.avatar.rows import RowShape, check_rows
from sacha_core.errors import FormatError

__all__ = ["Gaussians"]

PLY_BYTES_PER_GAUSSIAN = 252  # 63 float32 at SH degree 3, binding included: GaussianAvatars' record


@dataclass(frozen=True)
class Gaussians:
    """n Gaussians in the local units of the triangles that they are bound to, each attribute in its raw domain.

    Args:
        position: (n, 3) mean in its triangle's frame; one unit is the triangle's scale.
        log_scale: (n, 3) natural logarithm of the standard deviations, in the same unit.
        quaternion: (n, 4) wxyz, local to the triangle, not necessarily of unit length.
        opacity_logit: (n,) opacity before the sigmoid.
        sh_dc: (n, 3) spherical-harmonics coefficient of degree 0, RGB.
        sh_rest: (n, k, 3) coefficients of degree 1 and up; k is 0, 3, 8 or 15. World axes: not turned with the triangle.
        binding: (n,) index of the triangle that carries the Gaussian.
        sensitivity_logit: (n,) perceptual sensitivity before the sigmoid; only while training.

    Source: Qian et al., GaussianAvatars, CVPR 2024; sensitivity: Zhou et al., Perceptual-GS, 2025.
    """

    position: Float[np.ndarray, "n 3"]
    log_scale: Float[np.ndarray, "n 3"]
    quaternion: Float[np.ndarray, "n 4"]
    opacity_logit: Float[np.ndarray, " n"]
    sh_dc: Float[np.ndarray, "n 3"]
    sh_rest: Float[np.ndarray, "n k 3"]
    binding: Int[np.ndarray, " n"]
    sensitivity_logit: Float[np.ndarray, " n"] | None = None

    def __len__(self) -> int:
        """Give the number of Gaussians."""
        return len(self.binding)

    @property
    def sh_degree(self) -> int:
        """Highest spherical-harmonics degree that `sh_rest` has room for (0 to 3)."""
        return math.isqrt(self.sh_rest.shape[1] + 1) - 1

    def select(self, rows: Bool[np.ndarray, " n"] | Int[np.ndarray, " m"]) -> Gaussians:
        """Give the Gaussians at `rows` (a mask or indices), in that order: the one way to subset."""
        present = {f.name: getattr(self, f.name) for f in fields(self)}
        return replace(self, **{name: value[rows] for name, value in present.items() if value is not None})

    def validate(self, n_faces: int) -> None:
        """Check that every number is finite, shapes agree, and every binding names one of `n_faces` triangles.

        Raises:
            FormatError: naming the attribute, the first offending row, and what was expected.
        """
        n = len(self.binding)
        for f in fields(self):
            value = getattr(self, f.name)
            if value is None:
                continue
            if len(value) != n:
                raise FormatError(f"{f.name} has {len(value)} rows, expected {n} (one for each binding)")
            check_rows(f.name, value.shape, ROWS[f.name])
            finite = np.isfinite(value).all(axis=tuple(range(1, value.ndim)))
            if not finite.all():
                raise FormatError(f"{f.name} of Gaussian {int(np.argmin(finite))} is not finite")
        if self.sh_rest.shape[1] not in (0, 3, 8, 15):
            raise FormatError(f"sh_rest has {self.sh_rest.shape[1]} coefficients, expected 0, 3, 8 or 15")
        inside = (self.binding >= 0) & (self.binding < n_faces)
        if not inside.all():
            row = int(np.argmin(inside))
            raise FormatError(
                f"Gaussian {row} is bound to triangle {self.binding[row]}; the head has triangles 0 to {n_faces - 1}"
            )


ROWS: dict[str, RowShape] = {
    "position": (3,), "log_scale": (3,), "quaternion": (4,), "opacity_logit": (), "sh_dc": (3,), "sh_rest": (None, 3), "binding": (),
    "sensitivity_logit": (),
}  # fmt: skip
