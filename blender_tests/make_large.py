"""Make an avatar of the size that times are promised for; runs in the engine's Python.

Usage: make_large.py FOLDER

`large.sacha`: 50,000 Gaussians on a head of FLAME's size.
"""

from __future__ import annotations

import sys
from pathlib import Path

import numpy as np
from make_material import fill, moving

import sacha_core
from sacha_core.flame.synthetic import synthetic_head

SEED = 50
N_GAUSSIANS = 50_000
N_FRAMES = 100


def main(folder: Path) -> None:
    """Write it into `folder`."""
    rng = np.random.default_rng(SEED)
    head = synthetic_head()
    binding = np.sort(rng.integers(0, head.n_faces, N_GAUSSIANS)).astype(np.int32)
    gaussians = fill(sacha_core.initial_gaussians(head.n_faces, rng, sh_degree=0).select(binding), rng)
    avatar = sacha_core.Avatar(gaussians, head.reference, moving(head, N_FRAMES, rng))
    (folder / "large.sacha").write_bytes(sacha_core.encode(avatar, level=2, head=head))


if __name__ == "__main__":
    main(Path(sys.argv[1]))
