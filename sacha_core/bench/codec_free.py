"""Splats that no head carries, among the codecs: where they stand, and from where they are looked at."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np

from sacha_core.avatar.avatar import Avatar
from sacha_core.avatar.gaussians import Gaussians
from sacha_core.bench.preset import Subject
from sacha_core.errors import FormatError
from sacha_core.evaluate.peers.peer import visible
from sacha_core.geometry.triangle import triangle_frames
from sacha_core.rate.stances import Stance
from sacha_core.rate.views import ELEVATIONS_DEG, Shot, placed
from sacha_core.train.static import world_head

__all__ = ["free_shots", "free_subject"]

REACH_M = 0.15  # of a head around its middle, for which the codecs' places and the protocol's cameras are made
MOST = 0.9  # share of the splats that shall lie within
AZIMUTHS_DEG = tuple(float(azimuth) for azimuth in range(0, 360, 45))


def free_subject(splats: Gaussians, path: Path) -> Subject:
    """Give splats of any scene the place and the size of a head, so that every codec and camera suits them as it suits avatars.

    Args:
        splats: as `read_world_ply` reads them, in units of the scene.
        path: where from.

    Raises:
        FormatError: none of them shows, or they have no extent.
    """
    seen = visible(splats)
    if not len(seen):
        raise FormatError(f"{path}: no Gaussian shows, all of {len(splats):,} are of an opacity below 1/255")
    middle = np.median(seen.position.astype(np.float64), axis=0)
    reach = float(np.quantile(np.linalg.norm(seen.position - middle, axis=1), MOST))
    if not 0 < reach < np.inf:
        raise FormatError(f"{path}: most Gaussians lie on one point; there is no scene to look at")
    factor = REACH_M / reach
    position = ((splats.position - middle) * factor).astype(np.float32)
    log_scale = (splats.log_scale + np.log(factor)).astype(np.float32)
    head = world_head()
    nowhere = np.zeros(len(splats), np.int32)
    avatar = Avatar(replace(splats, position=position, log_scale=log_scale, binding=nowhere), head.reference)
    note = (
        f"{path.name} is bound to no head: it stands still in the world, moved and scaled by {factor:.3g} so that nine tenths of it lie "
        f"within {100 * REACH_M:.0f} cm as those of a head do, and is seen from {len(AZIMUTHS_DEG) * len(ELEVATIONS_DEG)} cameras all "
        "around. There are no bindings to be told, and codecs for avatars cannot take it; --head HEAD binds it, and they can."
    )
    return Subject(avatar, head, path, bound=False, note=note)


def free_shots(subject: Subject, share: float) -> tuple[Shot, ...]:
    """Give the views of splats without a head: the protocol's ring of cameras, closed.

    Args:
        subject: as `free_subject` gives it.
        share: of the pictures' resolution.
    """
    stance = Stance(triangle_frames(subject.head.v_template, subject.head.faces))
    views = [(azimuth, elevation) for elevation in ELEVATIONS_DEG for azimuth in AZIMUTHS_DEG]
    return (Shot(stance, tuple(placed(stance.target, *view, share) for view in views)),)
