"""One person's head in one pose at a time, with all that follows from it, in memory that is used again."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np
from jaxtyping import Float, Int

from sacha_core.animation.kernels import frames as frame_kernels
from sacha_core.animation.kernels import posing as posing_kernels
from sacha_core.flame.model import HeadModel
from sacha_core.flame.posing import HeadMotion, Poser
from sacha_core.geometry.triangle import TriangleFrames, degenerate_limit, refuse_triangle
from sacha_core.parallel.pool import Pool, even_ranges

__all__ = ["Pose", "PosedHead", "Posing", "refuse_first"]


@dataclass(frozen=True)
class Pose:
    """A posed head and how it came about, which a way back needs. Metres and radians, all in one dtype.

    Args:
        vertices: (v, 3) posed.
        unposed: (v, 3) before skinning: the person with an expression, corrected for the pose.
        joints: (j, 3) where the joints lie unposed.
        vectors: (j, 3) axis-angle vector of each joint.
        rotations: (j, 3, 3) their matrices.
        transforms: (j, 3, 4) each joint's map from the unposed to the posed head, before the translation of the whole.
        frames: of the f triangles.
        quaternions: (f, 4) wxyz of the frames' rotations, largest component positive.
    """

    vertices: Float[np.ndarray, "v 3"]
    unposed: Float[np.ndarray, "v 3"]
    joints: Float[np.ndarray, "j 3"]
    vectors: Float[np.ndarray, "j 3"]
    rotations: Float[np.ndarray, "j 3 3"]
    transforms: Float[np.ndarray, "j 3 4"]
    frames: TriangleFrames
    quaternions: Float[np.ndarray, "f 4"]


class Posing(NamedTuple):
    """A pose that is still to be taken: what kernels want for it.

    Args:
        pose: where the result goes; holds until the next.
        parameters: what it is taken from: expression, axis-angle vectors of the joints, translation.
        joints: what `pose_joints` wants, but its last two.
        blend: what `pose_vertices` wants after a range of vertices.
        coefficients: what it wants then, and `pose_joints` last; `pose_joints` gives how many there are, which comes next.
        skin: what `pose_vertices` wants last.
        corners: what `triangle_frames` wants after a range of triangles.
        frames: what it wants last.
    """

    pose: Pose
    parameters: tuple[np.ndarray, ...]
    joints: tuple[Any, ...]
    blend: tuple[np.ndarray, ...]
    coefficients: tuple[np.ndarray, ...]
    skin: tuple[np.ndarray, ...]
    corners: tuple[Any, ...]
    frames: tuple[np.ndarray, ...]


class PosedHead:
    """Poses one person's head: the compiled twin of `Poser` and `triangle_frames`, several times as fast.

    Expression coefficients and pose correctives that are exactly 0 cost nothing, nor do directions where they move nothing. The result has
    the same bits for any number of threads.

    Args:
        head: the head model.
        motion: whose static parameters make the person.
        pool: shares out the work; None for the calling thread alone.
        dtype: float32, or float64 where it serves as a reference.

    Attributes:
        poser: what does not change from pose to pose: template, joints, directions, weights.
        faces: (f, 3) int32, vertex indices of the triangles.
        moves: (blocks, k) whether a direction moves any vertex of a block of `kernels.posing.BLOCK`.
        posing: what kernels want that take a pose instead of `pose`; `refuse_first` then says what is wrong with it.

    Raises:
        HeadError: the motion has components or vertex offsets that the head lacks.

    Source: Li et al., FLAME, SIGGRAPH Asia 2017, equations 2 to 5; Qian et al., GaussianAvatars, CVPR 2024, section 3.2.
    """

    def __init__(
        self, head: HeadModel, motion: HeadMotion, pool: Pool | None = None, dtype: type[np.floating] = np.float32
    ) -> None:
        self.poser = Poser(head, motion, dtype)
        self._pool = pool or Pool(1)
        self.faces = np.ascontiguousarray(head.faces, np.int32)
        limits = degenerate_limit(np.dtype(dtype)) ** 2, float(np.finfo(dtype).tiny)
        self._limits = [np.dtype(dtype).type(limit) for limit in limits]
        v, f, j = head.n_vertices, head.n_faces, len(head.parents)
        self._pose = Pose(
            vertices=np.empty((v, 3), dtype),
            unposed=np.empty((v, 3), dtype),
            joints=np.empty((j, 3), dtype),
            vectors=np.empty((j, 3), dtype),
            rotations=np.empty((j, 3, 3), dtype),
            transforms=np.empty((j, 3, 4), dtype),
            frames=TriangleFrames(np.empty((f, 3, 3), dtype), np.empty(f, dtype), np.empty((f, 3), dtype)),
            quaternions=np.empty((f, 4), dtype),
        )
        n_directions, block = len(self.poser.directions), 3 * posing_kernels.BLOCK
        blocks = [self.poser.directions[:, at : at + block].any(axis=1) for at in range(0, 3 * v, block)]
        self.moves = np.array(blocks, bool).reshape(len(blocks), n_directions)
        self._rows, self._coefficients = np.empty(n_directions, np.int64), np.empty(n_directions, dtype)
        self._vertex_bounds = block_bounds(v, posing_kernels.BLOCK, self._pool.threads)
        self._face_bounds = block_bounds(f, frame_kernels.BLOCK, self._pool.threads)
        self._expression, self._translation = np.zeros(self.poser.joint_directions.shape[2], dtype), np.zeros(3, dtype)
        self.posing = self._make_posing()

    def pose(
        self,
        expression: Float[np.ndarray, " e"],
        vectors: Float[np.ndarray, "5 3"],
        translation: Float[np.ndarray, "3"],
    ) -> Pose:
        """Pose the head.

        Args:
            expression: coefficients; those for which the motion or the head has no directions are ignored, and missing ones are 0.
            vectors: (5, 3) axis-angle vector of root, neck, jaw, left and right eye, radians; those of joints that the head lacks are
                ignored.
            translation: (3,) of the posed head, metres.

        Returns:
            The pose, whose arrays hold until the next call.

        Raises:
            GeometryError: a triangle has zero area or a vertex that is not finite; the message names the first such triangle.
        """
        posing, active = self.posing, expression[: len(self._expression)]
        self._expression[: len(active)], self._expression[len(active) :] = active, 0
        self._pose.vectors[:] = vectors[: len(self._pose.vectors)]
        self._translation[:] = translation
        count = posing_kernels.pose_joints(*posing.joints, *posing.coefficients)
        bounds = self._vertex_bounds

        def place(_: int, k: int) -> None:
            posing_kernels.pose_vertices(
                bounds[k], bounds[k + 1], *posing.blend, *posing.coefficients, count, *posing.skin
            )

        self._pool.run(place, len(bounds) - 1)
        self._find_frames(posing)
        return posing.pose

    def _make_posing(self) -> Posing:
        """Give what kernels want, whose arrays stay."""
        pose, poser, frames = self._pose, self.poser, self._pose.frames
        return Posing(
            pose=pose,
            parameters=(self._expression, pose.vectors, self._translation),
            joints=(
                self._expression, pose.vectors, poser.joints, poser.joint_directions, poser.parents, poser.has_correctives,
                pose.joints, pose.rotations, pose.transforms,
            ),
            blend=(poser.template.reshape(-1), poser.directions, self.moves),
            coefficients=(self._rows, self._coefficients),
            skin=(poser.weights, pose.transforms, self._translation, pose.unposed.reshape(-1), pose.vertices),
            corners=(pose.vertices, self.faces, *self._limits),
            frames=(frames.rotation, frames.scale, frames.origin, pose.quaternions),
        )  # fmt: skip

    def _find_frames(self, posing: Posing) -> None:
        bounds = self._face_bounds
        faults = np.full(len(bounds) - 1, -1)

        def job(_: int, k: int) -> None:
            faults[k] = frame_kernels.triangle_frames(bounds[k], bounds[k + 1], *posing.corners, *posing.frames)

        self._pool.run(job, len(faults))
        refuse_first(posing.pose, self.faces, faults)


def refuse_first(pose: Pose, faces: Int[np.ndarray, "f 3"], faults: Int[np.ndarray, " j"]) -> None:
    """Refuse a pose in which a triangle is degenerate.

    Args:
        pose: as far as it was taken.
        faces: of the head.
        faults: the first such triangle of each of some ascending ranges, or -1.

    Raises:
        GeometryError: there is one; the message names the first.
    """
    for fault in faults[faults >= 0]:
        refuse_triangle(pose.vertices, faces, int(fault))


def block_bounds(total: int, block: int, jobs: int) -> list[int]:
    """Give bounds of at most `jobs` ranges of about equal length that begin at multiples of `block`."""
    return [min(bound * block, total) for bound in even_ranges(-(-total // block), jobs)]
