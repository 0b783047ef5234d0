"""What a made-up capture shall be like."""

from __future__ import annotations

import math
from dataclasses import asdict, dataclass
from typing import Any

from sacha_core.errors import OptionError
from sacha_core.synthesis.cameras import FRONT_CAMERA, N_CAMERAS

__all__ = ["SynthOptions"]


@dataclass(frozen=True)
class SynthOptions:
    """Options of a synthetic capture.

    Args:
        train: names of the sequences to train on; `sequences.SCRIPTS` has them.
        test: name of the held-out sequence.
        train_timesteps: how many timesteps each sequence to train on has.
        test_timesteps: how many the held-out one has.
        cameras: which cameras of the rig of 16; 8 is held out of training.
        width: of the images, pixels.
        height: pixels.
        seed: of appearance and motion; the person's shape is the head's.
        supersample: samples along each axis of a pixel.
        expression_noise: standard deviation of the tracking error on expression coefficients, against images that show the truth.
        pose_noise_rad: of that on the joints' rotation vectors, radians.
        translation_noise_m: of that on the translation, metres.

    Raises:
        OptionError: a value makes no sense; the message names the option and its range.
    """

    train: tuple[str, ...] = ("EMO-1", "EXP-2", "EXP-3", "EXP-5")
    test: str = "FREE"
    train_timesteps: int = 13
    test_timesteps: int = 10
    cameras: tuple[int, ...] = tuple(range(N_CAMERAS))
    width: int = 275
    height: int = 401
    seed: int = 0
    supersample: int = 2
    expression_noise: float = 0.0
    pose_noise_rad: float = 0.0
    translation_noise_m: float = 0.0

    def __post_init__(self) -> None:
        for name, low, high in (
            ("train_timesteps", 1, 10_000),
            ("test_timesteps", 1, 10_000),
            ("width", 8, 8192),
            ("height", 8, 8192),
            ("seed", 0, 2**31 - 1),
            ("supersample", 1, 8),
            ("expression_noise", 0.0, 10.0),
            ("pose_noise_rad", 0.0, 1.0),
            ("translation_noise_m", 0.0, 1.0),
        ):
            value = getattr(self, name)
            if not (math.isfinite(value) and low <= value <= high):
                raise OptionError(f"{name} is {value}, expected {low} to {high}")
        if not self.train or self.test in self.train or len({*self.train}) < len(self.train):
            raise OptionError(
                f"train is {self.train} and test {self.test!r}: expected different sequences, at least one to train on"
            )
        if sorted({*self.cameras}) != sorted(self.cameras) or not {*self.cameras} <= set(range(N_CAMERAS)):
            raise OptionError(f"cameras are {self.cameras}, expected different ones from 0 to {N_CAMERAS - 1}")
        if FRONT_CAMERA not in self.cameras or len(self.cameras) < 2:
            raise OptionError(f"cameras are {self.cameras}, expected {FRONT_CAMERA} (held out of training) and another")

    def origin(self, head_sha256: str) -> dict[str, Any]:
        """Give what decides the images of a sequence, so that one on disk is kept only if it would be made the same.

        Args:
            head_sha256: digest of the head.
        """
        sizes = {name: getattr(self, name) for name in ("width", "height", "seed", "supersample")}
        return {"maker": "sacha synth", "version": VERSION, "head_sha256": head_sha256, **sizes}

    def as_json(self) -> dict[str, Any]:
        """Give all options as plain JSON values."""
        return asdict(self) | {"train": list(self.train), "cameras": list(self.cameras)}


VERSION = 1  # of appearance and motion; raise it with any change that shows
