r"""What every number of every Gaussian is worth to pictures: what an encoder may be told, and a decoder never learns.

With J the derivatives of the pixels by the numbers, a small error e in one number alone changes the summed squared difference of the
pictures by $(J^T J)_{ii} e^2$. That diagonal is what stands here, for one view (mean over views), of colours from 0 to 1.

Source: own.
"""

from __future__ import annotations

from dataclasses import dataclass, fields, replace

import numpy as np
from jaxtyping import Bool, Float, Int

from sacha_core.avatar.rows import RowShape, check_rows
from sacha_core.errors import FormatError

__all__ = ["GaussianImportance"]


@dataclass(frozen=True)
class GaussianImportance:
    """Squared change of the picture for each squared unit of error: summed over pixels and channels, mean over views.

    Half the second derivative of the summed squared difference, that is. All values are finite and 0 or more.

    Args:
        position: (n, 3) for means in triangle units, axes of the triangle.
        log_scale: (n, 3) for natural logarithms of standard deviations.
        rotation: (n, 3) for a turn about each of the Gaussian's own axes, radians.
        opacity: (n,) for theta = arcsin sqrt opacity.
        sh_dc: (n, 3) for coefficients of degree 0, RGB.
        sh_rest: (n, k, 3) for those of degree 1 and up.
        colour_metric: (n, k + 1, k + 1) float32 for the coefficients of one colour together: an error e of all of them, degree 0 first,
            changes pictures by e^T M e. Mean over views of the summed squared blending weight times the outer product of the harmonics in
            the direction of view; None where nobody measured it.
    """

    position: Float[np.ndarray, "n 3"]
    log_scale: Float[np.ndarray, "n 3"]
    rotation: Float[np.ndarray, "n 3"]
    opacity: Float[np.ndarray, " n"]
    sh_dc: Float[np.ndarray, "n 3"]
    sh_rest: Float[np.ndarray, "n k 3"]
    colour_metric: Float[np.ndarray, "n k1 k1"] | None = None

    def __len__(self) -> int:
        """Give the number of Gaussians."""
        return len(self.opacity)

    def select(self, rows: Bool[np.ndarray, " n"] | Int[np.ndarray, " m"]) -> GaussianImportance:
        """Give that of the Gaussians at `rows` (a mask or indices), in that order, as `Gaussians.select` does."""
        return GaussianImportance(**{name: value[rows] for name, value in self._present()})

    def weighted(self, factors: Float[np.ndarray, " n"]) -> GaussianImportance:
        """Give that of Gaussians whose part in pictures counts `factors` times as much."""
        weighed = {
            name: (value * factors.reshape(-1, *[1] * (value.ndim - 1))).astype(value.dtype)
            for name, value in self._present()
        }
        return replace(self, **weighed)

    def with_axes(self, order: Int[np.ndarray, "n 3"]) -> GaussianImportance:
        """Give that of the same Gaussians with their axes in another order.

        Args:
            order: (n, 3) which of a Gaussian's axes becomes its first, second and third, as `argsort` gives it.
        """
        turned = {name: np.take_along_axis(getattr(self, name), order, axis=1) for name in ("log_scale", "rotation")}
        return replace(self, **turned)

    def validate(self, n: int, n_harmonics: int) -> None:
        """Check that this can be of `n` Gaussians with `n_harmonics` coefficients of degree 1 and up.

        Raises:
            FormatError: naming the attribute, the first offending row, and what was expected.
        """
        for name, value in self._present():
            if len(value) != n:
                raise FormatError(f"importance {name} has {len(value)} rows, expected {n} (one for each Gaussian)")
            check_rows(f"importance {name}", value.shape, ROWS[name])
            least = 0 if name != "colour_metric" else -np.inf
            sound = (np.isfinite(value) & (value >= least)).all(axis=tuple(range(1, value.ndim)))
            if not sound.all():
                row = int(np.argmin(sound))
                raise FormatError(f"importance {name} of Gaussian {row} is negative or not finite")
        if self.sh_rest.shape[1] != n_harmonics:
            raise FormatError(f"importance sh_rest is of {self.sh_rest.shape[1]} coefficients, expected {n_harmonics}")
        expected = (n_harmonics + 1, n_harmonics + 1)
        if self.colour_metric is not None and self.colour_metric.shape[1:] != expected:
            raise FormatError(f"importance colour_metric is of {self.colour_metric.shape[1:]}, expected {expected}")

    def _present(self) -> list[tuple[str, np.ndarray]]:
        """Give the names and values of all that was measured."""
        values = [(f.name, getattr(self, f.name)) for f in fields(self)]
        return [(name, value) for name, value in values if value is not None]


ROWS: dict[str, RowShape] = {
    "position": (3,), "log_scale": (3,), "rotation": (3,), "opacity": (), "sh_dc": (3,), "sh_rest": (None, 3),
    "colour_metric": (None, None),
}  # fmt: skip
