"""What a run needs to know of the scene that it is given: how large it is, and whether it is the same as before."""

from __future__ import annotations

import hashlib
from typing import Any

import numpy as np

from sacha_core.animation.posed import PosedHead
from sacha_core.errors import DatasetError, GeometryError
from sacha_core.flame.model import HeadModel
from sacha_core.flame.posing import joint_vectors
from sacha_core.interchange.capture import Capture
from sacha_core.train.state import FITTED_MOTION

__all__ = ["fingerprint", "require_poses", "scene_extent"]

SPREAD = 1.1  # of the farthest camera
LEAST = 0.5  # of the mean distance of cameras from the head


def scene_extent(capture: Capture, head: HeadModel) -> float:
    """Give the size of the scene, metres: 1.1 times the farthest that a training frame's camera stands from the middle of all.

    Where all cameras stand close together, half their mean distance from the head: a head that turns before one camera is seen from as
    many sides as one that keeps still within a ring of them.

    Raises:
        DatasetError: there is nothing to train on, or a camera has no place that numbers can name.

    Source: GaussianAvatars' and 3DGS's scene normalisation; the floor is our own.
    """
    if not capture.train:
        raise DatasetError(f"{capture.root}: no view to train on")
    centres = np.array([view.camera.centre for view in capture.train], np.float64)
    middle = head.v_template.mean(axis=0, dtype=np.float64)
    heads = middle + capture.motion.translation[[view.timestep for view in capture.train]]
    spread = SPREAD * float(np.linalg.norm(centres - centres.mean(axis=0), axis=1).max())
    extent = max(spread, LEAST * float(np.linalg.norm(centres - heads, axis=1).mean()))
    if not 0 < extent < np.inf:
        raise DatasetError(
            f"{capture.root}: the extent of the scene is {extent:.6g} m, expected cameras outside the head"
        )
    return extent


def require_poses(capture: Capture, head: HeadModel) -> None:
    """Refuse a capture in which a triangle has no area at a timestep that is trained on: nothing could hang on it.

    Raises:
        GeometryError: naming the first timestep, and the triangle.
        HeadError: the motion has components or vertex offsets that the head lacks.
    """
    motion = capture.motion
    posed = PosedHead(head, motion)
    for timestep in sorted({view.timestep for view in capture.train}):
        try:
            posed.pose(motion.expression[timestep], joint_vectors(motion, timestep), motion.translation[timestep])
        except GeometryError as error:
            raise GeometryError(f"timestep {timestep}: {error}") from error


def fingerprint(capture: Capture, head: HeadModel) -> dict[str, Any]:
    """Give what must be the same for a run to go on; images are told by their sizes on disk.

    Raises:
        OSError: an image is not there.
    """
    motion, digest = capture.motion, hashlib.sha256()
    for name in ("shape", "static_offset", *FITTED_MOTION):
        digest.update(np.ascontiguousarray(getattr(motion, name)).tobytes())
    for view in capture.train:
        c, size = view.camera, view.image_path.stat().st_size
        numbers = (view.timestep, view.camera_index, size, c.width, c.height, c.fx, c.fy, c.cx, c.cy)
        digest.update(np.array([*numbers, *np.ravel(c.rotation), *np.ravel(c.translation)], np.float64).tobytes())
    return {
        "head": head.reference.sha256,
        "views": len(capture.train),
        "timesteps": len(motion),
        "sha256": digest.hexdigest(),
    }
