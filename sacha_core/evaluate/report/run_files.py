"""Finding what training and coding left of a run."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import numpy as np
from jaxtyping import Float

from sacha_core.avatar.avatar import Avatar
from sacha_core.codec import decode
from sacha_core.evaluate.ablation.plan import level_file
from sacha_core.evaluate.report.subject import Subject
from sacha_core.interchange.gaussian_avatars import model_iterations, read_model

__all__ = ["MODEL", "RunFiles"]

MODEL = "model"


@dataclass(frozen=True)
class RunFiles:
    """The files of all runs on one capture.

    Args:
        folder: holds `seed-S/VARIANT/`.
        subject: who was captured.
    """

    folder: Path
    subject: Subject

    def run(self, variant: str, seed: int) -> Path:
        """Give the folder of a run."""
        return self.folder / f"seed-{seed}" / variant

    def has_level(self, variant: str, seed: int, level: int) -> bool:
        """Whether a run's coded avatar is there."""
        return level_file(self.run(variant, seed), level).is_file()

    def coded(self, variant: str, seed: int, level: int) -> Avatar:
        """Decode a run's avatar at a level.

        Raises:
            SachaError: the file is damaged, or of another head.
            OSError: it cannot be read.
        """
        return decode(level_file(self.run(variant, seed), level), head=self.subject.head)

    def counts(self, variant: str, seed: int) -> Float[np.ndarray, " f"] | None:
        """Count the Gaussians of each triangle of a trained model; None where there is no model.

        Raises:
            FormatError: the model is damaged.
            OSError: it cannot be read.
        """
        model, n_faces = self.run(variant, seed) / MODEL, self.subject.head.n_faces
        if not model_iterations(model):
            return None
        gaussians, _ = read_model(model, n_faces=n_faces)
        return np.bincount(gaussians.binding, minlength=n_faces).astype(np.float64)
