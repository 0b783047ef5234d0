"""The head and the avatar that the tests of rates share."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from sacha_core.avatar.avatar import Avatar
from sacha_core.avatar.binding import initial_gaussians
from sacha_core.flame.model import HeadModel
from sacha_core.flame.synthetic import synthetic_head
from sacha_core.raster.rasteriser import Rasteriser

N_MATT = 4


@pytest.fixture(scope="session")
def head() -> HeadModel:
    """Give the small synthetic head."""
    return synthetic_head("small")


@pytest.fixture(scope="session")
def rasteriser() -> Rasteriser:
    """Give one that draws on one thread."""
    return Rasteriser(1)


@pytest.fixture(scope="session")
def avatar(head: HeadModel) -> Avatar:
    """Give an avatar of half transparent Gaussians that have nothing in common, with harmonics of degree 1 and without a motion."""
    return random_avatar(head, 5)


@pytest.fixture(scope="session")
def matt_avatars(head: HeadModel) -> list[Avatar]:
    """Give several that look the same from all sides: what one of them gains by chance another loses."""
    drawn = [random_avatar(head, seed) for seed in range(N_MATT)]
    none = np.zeros((head.n_faces, 0, 3), np.float32)
    return [replace(one, gaussians=replace(one.gaussians, sh_rest=none)) for one in drawn]


def random_avatar(head: HeadModel, seed: int) -> Avatar:
    rng = np.random.default_rng(seed)
    gaussians = initial_gaussians(head.n_faces, rng, 1)
    n, f4 = len(gaussians), np.float32
    gaussians = replace(
        gaussians,
        position=rng.normal(0, 0.3, (n, 3)).astype(f4),
        log_scale=rng.normal(-0.3, 0.3, (n, 3)).astype(f4),
        quaternion=rng.normal(0, 1, (n, 4)).astype(f4),
        opacity_logit=rng.normal(1, 1, n).astype(f4),
        sh_dc=rng.normal(0, 0.4, (n, 3)).astype(f4),
        sh_rest=rng.normal(0, 0.1, (n, 3, 3)).astype(f4),
    )
    return Avatar(gaussians, head.reference)
