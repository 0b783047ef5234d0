"""Linear blend skinning."""

from __future__ import annotations

import numpy as np
from jaxtyping import Float, Int

__all__ = ["joint_transforms", "skin"]


def joint_transforms(
    rotations: Float[np.ndarray, "j 3 3"], joints: Float[np.ndarray, "j 3"], parents: Int[np.ndarray, " j"]
) -> Float[np.ndarray, "j 3 4"]:
    """Give each joint's affine map from the unposed to the posed head.

    Every joint turns about its own place, and then moves with its parent; the root turns about its own place too, not about the origin.

    Args:
        rotations: (j, 3, 3) each joint's rotation relative to its parent.
        joints: (j, 3) where the joints lie unposed, metres.
        parents: (j,) each joint's parent, which comes before it; -1 for the root.

    Returns:
        (j, 3, 4) rotation and translation: x_posed = A[:, :3] @ x + A[:, 3].

    Source: Li et al., FLAME, SIGGRAPH Asia 2017, section 3 (the skinning of SMPL).
    """
    transforms = np.empty((len(joints), 3, 4), joints.dtype)
    for j, (rotation, joint, parent) in enumerate(zip(rotations, joints, parents, strict=True)):
        place = joint
        if parent >= 0:
            place = transforms[parent, :, :3] @ joint + transforms[parent, :, 3]
            rotation = transforms[parent, :, :3] @ rotation  # noqa: PLW2901  (now relative to the world)
        transforms[j, :, :3] = rotation
        transforms[j, :, 3] = place - rotation @ joint
    return transforms


def skin(
    vertices: Float[np.ndarray, "v 3"], weights: Float[np.ndarray, "v j"], transforms: Float[np.ndarray, "j 3 4"]
) -> Float[np.ndarray, "v 3"]:
    """Move each vertex by the mean of the joints' maps under its weights, which sum to 1.

    `einsum` sums in a fixed order on one thread, so that the result does not depend on a linear algebra library's threads.

    Args:
        vertices: (v, 3) unposed, metres.
        weights: (v, j) skinning weights.
        transforms: (j, 3, 4) from `joint_transforms`.

    Returns:
        (v, 3) posed vertices, metres.

    Source: Li et al., FLAME, SIGGRAPH Asia 2017, section 3 (the skinning of SMPL).
    """
    blended = np.einsum("vj,jk->vk", weights, transforms.reshape(-1, 12)).reshape(-1, 3, 4)
    posed: np.ndarray = np.einsum("vik,vk->vi", blended[:, :, :3], vertices) + blended[:, :, 3]
    return posed
