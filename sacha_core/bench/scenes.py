"""What is drawn, compressed and played where the user names nothing: scenes made by code, alike on every machine."""

from __future__ import annotations

from functools import lru_cache

import numpy as np
from jaxtyping import Float

from sacha_core.avatar.avatar import Avatar
from sacha_core.avatar.gaussians import Gaussians
from sacha_core.avatar.motion import Motion
from sacha_core.flame.model import HeadModel
from sacha_core.flame.open import open_head
from sacha_core.geometry.triangle import triangle_frames
from sacha_core.raster.camera import Camera
from sacha_core.raster.splats import Splats
from sacha_core.synthesis.sequences import perform

__all__ = ["cameras_around", "front_camera", "head_shell", "made_avatar", "made_head", "made_motion"]

RADII = np.array([0.075, 0.11, 0.095])  # metres
FOCAL = 2050.0  # pixels at a height of 802: the head fills two thirds of it
DC = 0.28209479177387814  # harmonic of degree 0
MOTION_SCRIPT = "EXP-5"  # speech, turns of the head and glances, so every parameter moves


def head_shell(n: int, channels: int = 4, seed: int = 0) -> Splats:
    """Give n Gaussians on a shell of a head's size, some 1.2 mm wide and 0.4 mm thick, in an order like that of a mesh's triangles."""
    rng = np.random.default_rng(seed)
    normals = rng.normal(size=(n, 3))
    normals /= np.linalg.norm(normals, axis=1, keepdims=True)
    place = np.floor((normals + 1) * 8).astype(int)
    normals = normals[np.lexsort(place.T)]
    scales = np.array([1.2e-3, 1.2e-3, 0.4e-3]) * np.exp(rng.normal(size=(n, 3)) * 0.5)
    # the rotation that takes z to the normal, after a turn about z
    half = np.stack([1 + normals[:, 2], -normals[:, 1], normals[:, 0], np.zeros(n)], 1)
    turn = rng.uniform(0, np.pi, n)
    w, x, y = half[:, 0], half[:, 1], half[:, 2]
    c, s = np.cos(turn), np.sin(turn)
    quaternions = np.stack([w * c, x * c + y * s, y * c - x * s, w * s], 1)
    quaternions /= np.linalg.norm(quaternions, axis=1, keepdims=True)
    arrays = (normals * RADII, scales, quaternions, rng.uniform(0.1, 1, n), rng.uniform(0, 1, (n, channels)))
    return Splats(*(a.astype(np.float32) for a in arrays))


def front_camera(width: int, height: int) -> Camera:
    """Give a camera a metre before the face."""
    focal = FOCAL * height / 802
    return Camera.look_at(np.array([0.15, 0.05, 0.99]), np.zeros(3), width, height, focal)


def cameras_around(vertices: Float[np.ndarray, "v 3"], count: int, width: int, height: int) -> list[Camera]:
    """Give cameras a metre from the middle of a head, evenly round it from the front on, each with the whole head in its image.

    Args:
        vertices: of the posed head, metres.
        count: of cameras.
        width: of the image, pixels.
        height: likewise.
    """
    middle = (vertices.min(axis=0) + vertices.max(axis=0)) / 2
    radius = float(np.linalg.norm(vertices - middle, axis=1).max())
    focal = 0.5 * min(width, height) * np.sqrt(1 - radius**2) / radius if radius < 1 else 0.5 * min(width, height)
    angles = np.linspace(0, 2 * np.pi, count, endpoint=False)
    eyes = middle + np.stack([np.sin(angles), np.full(count, 0.1), np.cos(angles)], 1)
    return [Camera.look_at(eye, middle, width, height, float(focal)) for eye in eyes]


@lru_cache(maxsize=1)
def made_head() -> HeadModel:
    """Give the synthetic head, of FLAME's size and joints."""
    return open_head("synthetic")


def made_motion(n_frames: int, seed: int = 0) -> Motion:
    """Give so many frames of the synthetic head speaking, turning and looking about."""
    return perform(made_head(), MOTION_SCRIPT, n_frames, seed)


def made_avatar(n: int, sh_degree: int = 3, n_frames: int = 100, seed: int = 0) -> tuple[Avatar, HeadModel]:
    """Give an avatar of n Gaussians on the synthetic head, with a motion, in about a second.

    The Gaussians lie on the head's skin in the colours painted on it, spread over triangles by area; their sizes, thinness, opacities and
    harmonics have the distributions of a trained avatar's. It costs what a trained one costs, and looks like one from afar.

    Args:
        n: how many Gaussians.
        sh_degree: of the harmonics, 0 to 3.
        n_frames: of the motion.
        seed: of chance.
    """
    head = made_head()
    rng = np.random.default_rng(seed)
    corners, colours = _painted_skin()
    areas = np.linalg.norm(np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]), axis=1)
    chosen = np.sort(rng.choice(len(areas), n, p=areas / areas.sum()))
    binding = (chosen // (len(areas) // head.n_faces)).astype(np.int32)
    shares = rng.dirichlet(np.ones(3), n)
    points = np.einsum("nk,nkc->nc", shares, corners[chosen])
    frames = triangle_frames(head.v_template.astype(np.float64), head.faces)
    position = np.einsum("nji,nj->ni", frames.rotation[binding], points - frames.origin[binding])
    position = position / frames.scale[binding, None] + rng.normal(0, (0.02, 0.05, 0.02), (n, 3))
    widest = np.minimum(np.sqrt(areas.sum() / n) / frames.scale[binding], 0.55)  # so that neighbours overlap
    log_scale = np.log(widest)[:, None] + rng.normal((0, -1.9, 0), (0.4, 0.9, 0.4), (n, 3))
    quaternion = rng.normal((1, 0, 0, 0), 0.1, (n, 4))
    rest = [rng.normal(0, sd, (n, 2 * k + 1, 3)) for k, sd in enumerate((0.035, 0.028, 0.028)[:sh_degree], 1)]
    gaussians = Gaussians(
        position=position.astype(np.float32),
        log_scale=log_scale.astype(np.float32),
        quaternion=(quaternion / np.linalg.norm(quaternion, axis=1, keepdims=True)).astype(np.float32),
        opacity_logit=rng.normal(1.3, 2.2, n).astype(np.float32),
        sh_dc=((colours[chosen] - 0.5) / DC + rng.normal(0, 0.05, (n, 3))).astype(np.float32),
        sh_rest=np.concatenate([np.zeros((n, 0, 3)), *rest], axis=1).astype(np.float32),
        binding=binding,
    )
    return Avatar(gaussians, head.reference, made_motion(n_frames, seed)), head


@lru_cache(maxsize=1)
def _painted_skin() -> tuple[Float[np.ndarray, "q 3 3"], Float[np.ndarray, "q 3"]]:
    """Give the corners of the fine triangles of the neutral head's skin, metres, and the lit colour of each, sRGB.

    As many fine triangles as belong to a triangle of the head follow one another.
    """
    from sacha_core.synthesis.kernels.shading import ALBEDO, IRRADIANCE  # noqa: PLC0415 (kernels, for who needs them)
    from sacha_core.synthesis.subject import Subject  # noqa: PLC0415

    vertices = made_head().v_template.astype(np.float32)
    subject = Subject(made_head(), vertices)
    scene = subject.scene(vertices)
    faces, table = subject.fine.faces[-1], scene.table
    light = table[:, ALBEDO : ALBEDO + 3] * table[:, IRRADIANCE : IRRADIANCE + 3]
    lit = np.clip(light[faces].mean(axis=1), 0, 1) ** (1 / 2.2)
    return scene.points[faces].astype(np.float64), lit
