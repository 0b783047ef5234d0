"""Run by the engine: a head that moves in every way as glTF, and where the corners of its triangles are in each frame.

Usage: make_gltf.py FOLDER
"""

from __future__ import annotations

import sys
from pathlib import Path

import numpy as np

from sacha_core.avatar.motion import Motion
from sacha_core.flame.posing import Poser
from sacha_core.flame.synthetic import synthetic_head
from sacha_core.interchange.gltf_head import write_gltf_head

FRAME_RATE, N_FRAMES = 30.0, 4


def main(folder: Path) -> None:
    """Write `head.glb` and `corners.npy`, (t, f, 3, 3) metres."""
    head, rng = synthetic_head("small"), np.random.default_rng(0)

    def normal(scale: float, *shape: int) -> np.ndarray:
        return rng.normal(size=shape, scale=scale).astype(np.float32)

    n = N_FRAMES
    motion = Motion(
        normal(0.5, head.shapedirs.shape[2]), normal(1e-4, head.n_vertices, 3), normal(0.3, n, head.exprdirs.shape[2]),
        normal(0.2, n, 3), normal(0.2, n, 3), normal(0.2, n, 3), normal(0.2, n, 6), normal(0.1, n, 3), FRAME_RATE,
    )  # fmt: skip
    write_gltf_head(folder / "head.glb", head, motion, FRAME_RATE)
    poser = Poser(head, motion, np.float64)
    np.save(folder / "corners.npy", np.stack([poser(frame)[head.faces] for frame in range(n)]))


if __name__ == "__main__":
    main(Path(sys.argv[1]))
