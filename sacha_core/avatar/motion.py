"""The motion: FLAME parameters, those of the person once and those of each frame."""

from __future__ import annotations

from dataclasses import dataclass, fields, replace

import numpy as np
from jaxtyping import Float, Int

from sacha_core.avatar.rows import RowShape, check_rows
from sacha_core.errors import FormatError

__all__ = ["Motion"]

STATIC = ("shape", "static_offset")
# No such length, angle or coefficient is a head's, and from a little above float32 cannot hold their products
LARGEST = 2.0**30


@dataclass(frozen=True)
class Motion:
    """t frames of FLAME parameters over one person's static ones.

    Rotations are axis-angle vectors in radians. A head with fewer joints than FLAME's five ignores those it lacks; a rig of blend shapes
    keeps its weights in `expression`.

    Args:
        shape: (s,) identity coefficients.
        static_offset: (v, 3) personal vertex offsets of the unposed head, metres; v is 0 where there are none.
        expression: (t, e) expression coefficients.
        rotation: (t, 3) of the root joint.
        neck: (t, 3).
        jaw: (t, 3).
        eyes: (t, 6) left eye, then right.
        translation: (t, 3) metres.
        frame_rate: frames a second.

    Source: Li et al., FLAME, SIGGRAPH Asia 2017; parameter set as GaussianAvatars stores it.
    """

    shape: Float[np.ndarray, " s"]
    static_offset: Float[np.ndarray, "v 3"]
    expression: Float[np.ndarray, "t e"]
    rotation: Float[np.ndarray, "t 3"]
    neck: Float[np.ndarray, "t 3"]
    jaw: Float[np.ndarray, "t 3"]
    eyes: Float[np.ndarray, "t 6"]
    translation: Float[np.ndarray, "t 3"]
    frame_rate: float = 25.0

    def __len__(self) -> int:
        """Give the number of frames."""
        return len(self.expression)

    @classmethod
    def rest(cls, n_shape: int, n_expression: int, n_frames: int = 1, frame_rate: float = 25.0) -> Motion:
        """Give `n_frames` frames of the neutral head."""
        zeros = {name: np.zeros((n_frames, width), np.float32) for name, width in DYNAMIC_WIDTHS.items()}
        return cls(
            np.zeros(n_shape, np.float32),
            np.zeros((0, 3), np.float32),
            np.zeros((n_frames, n_expression), np.float32),
            **zeros,
            frame_rate=frame_rate,
        )

    def frames(self, rows: Int[np.ndarray, " m"] | slice) -> Motion:
        """Give the motion of some frames, in that order; the static parameters stay."""
        return replace(self, **{name: getattr(self, name)[rows] for name in ("expression", *DYNAMIC_WIDTHS)})

    def validate(self) -> None:
        """Check that frames agree in number and every value is finite and of a size that a head can have.

        Raises:
            FormatError: naming the parameter, the first offending frame, and what was expected.
        """
        for f in fields(self):
            value = getattr(self, f.name)
            if not isinstance(value, np.ndarray):
                continue
            if f.name not in STATIC and len(value) != len(self):
                raise FormatError(f"motion parameter {f.name} has {len(value)} frames, expected {len(self)}")
            check_rows(f"motion parameter {f.name}", value.shape, ROWS[f.name])
            finite = np.isfinite(value).all(axis=tuple(range(1, value.ndim)))
            if not finite.all():
                raise FormatError(f"motion parameter {f.name} is not finite at row {int(np.argmin(finite))}")
            if value.size and np.abs(value).max() > LARGEST:
                row = int(np.argmax((np.abs(value) > LARGEST).reshape(len(value), -1).any(axis=1)))
                largest = float(np.abs(value[row]).max())
                raise FormatError(
                    f"motion parameter {f.name} is {largest:.6g} at row {row}, expected at most {LARGEST:.6g}"
                )
        if not (np.isfinite(self.frame_rate) and 0 < self.frame_rate <= 1000):
            raise FormatError(f"frame rate {self.frame_rate} is not between 0 and 1000 frames a second")


DYNAMIC_WIDTHS = {"rotation": 3, "neck": 3, "jaw": 3, "eyes": 6, "translation": 3}
ROWS: dict[str, RowShape] = {
    "shape": (), "static_offset": (3,), "expression": (None,), **{name: (width,) for name, width in DYNAMIC_WIDTHS.items()},
}  # fmt: skip
