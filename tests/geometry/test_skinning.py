"""Oracle: homogeneous 4x4 products, joint by joint and vertex by vertex; laws of rigid motion."""

from __future__ import annotations

import numpy as np
from scipy.spatial.transform import Rotation

from sacha_core.geometry.skinning import joint_transforms, skin

ROUNDING_64 = 1e-13
PARENTS = np.array([-1, 0, 1, 1, 1])


def homogeneous(rotation: np.ndarray, translation: np.ndarray) -> np.ndarray:
    matrix = np.eye(4)
    matrix[:3, :3], matrix[:3, 3] = rotation, translation
    return matrix


def random_skeleton(seed: int) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
    rng = np.random.default_rng(seed)
    weights = rng.random((40, 5))
    return (
        Rotation.random(5, rng=rng).as_matrix(),
        rng.normal(size=(5, 3)),
        rng.normal(size=(40, 3)),
        weights / weights.sum(axis=1, keepdims=True),
    )


def test_against_homogeneous_matrices() -> None:
    rotations, joints, vertices, weights = random_skeleton(0)
    world: list[np.ndarray] = []
    for j, parent in enumerate(PARENTS):
        local = homogeneous(rotations[j], joints[j] - (joints[parent] if parent >= 0 else 0))
        world.append(world[parent] @ local if parent >= 0 else local)
    relative = [g @ homogeneous(np.eye(3), -joint) for g, joint in zip(world, joints, strict=True)]
    transforms = joint_transforms(rotations, joints, PARENTS)
    np.testing.assert_allclose(transforms, np.stack(relative)[:, :3], atol=ROUNDING_64)
    expected = [
        sum(w * (a @ [*v, 1])[:3] for w, a in zip(row, relative, strict=True))
        for row, v in zip(weights, vertices, strict=True)
    ]
    np.testing.assert_allclose(skin(vertices, weights, transforms), expected, atol=ROUNDING_64)


def test_rest_pose_leaves_the_mesh() -> None:
    _, joints, vertices, weights = random_skeleton(1)
    transforms = joint_transforms(np.broadcast_to(np.eye(3), (5, 3, 3)), joints, PARENTS)
    np.testing.assert_allclose(skin(vertices, weights, transforms), vertices, atol=ROUNDING_64)


def test_the_root_turns_everything_about_its_own_place() -> None:
    rotations, joints, vertices, weights = random_skeleton(2)
    only_root = np.concatenate([rotations[:1], np.broadcast_to(np.eye(3), (4, 3, 3))])
    posed = skin(vertices, weights, joint_transforms(only_root, joints, PARENTS))
    np.testing.assert_allclose(posed, (vertices - joints[0]) @ rotations[0].T + joints[0], atol=ROUNDING_64)


def test_joints_stay_attached_to_their_parents() -> None:
    rotations, joints, _, _ = random_skeleton(3)
    transforms = joint_transforms(rotations, joints, PARENTS)
    for j, parent in enumerate(PARENTS):
        if parent >= 0:
            by_itself, by_parent = (transforms[i, :, :3] @ joints[j] + transforms[i, :, 3] for i in (j, parent))
            np.testing.assert_allclose(by_itself, by_parent, atol=ROUNDING_64)


def test_float32_is_kept() -> None:
    rotations, joints, vertices, weights = (a.astype(np.float32) for a in random_skeleton(4))
    assert skin(vertices, weights, joint_transforms(rotations, joints, PARENTS)).dtype == np.float32
