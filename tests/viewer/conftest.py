"""A trained-looking avatar of the synthetic head: coloured by its own texture's stand-in, two frames far apart."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from sacha_core.avatar.avatar import Avatar
from sacha_core.avatar.binding import initial_gaussians
from sacha_core.avatar.motion import Motion
from sacha_core.codec import encode
from sacha_core.flame.synthetic import synthetic_head


@pytest.fixture(scope="session")
def shown_avatar(tmp_path_factory: pytest.TempPathFactory) -> Path:
    head = synthetic_head("small")
    rng = np.random.default_rng(6)
    start = initial_gaussians(head.n_faces, rng, sh_degree=0)
    stripes = np.sign(np.sin(60 * head.v_template[head.faces].mean(axis=1)[:, 1]))[:, None] * np.array([1.2, -0.4, 0.8])
    gaussians = replace(
        start,
        log_scale=start.log_scale - np.float32(0.5),
        opacity_logit=np.full(len(start), 4.0, np.float32),
        sh_dc=stripes.astype(np.float32),
    )
    rest = Motion.rest(head.shapedirs.shape[2], head.exprdirs.shape[2], 2)
    turned = rest.rotation.copy()
    turned[1, 2] = 0.5
    path = tmp_path_factory.mktemp("shown") / "avatar.sacha"
    path.write_bytes(encode(Avatar(gaussians, head.reference, replace(rest, rotation=turned)), 4, head=head))
    return path
