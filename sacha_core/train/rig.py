"""The head that Gaussians hang on: its pose at a timestep, and the way back from pulls on its triangles to the pose."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any, NamedTuple

import numpy as np
from jaxtyping import Float

from sacha_core.animation.kernels.posing import BLOCK
from sacha_core.animation.posed import Pose, PosedHead, Posing
from sacha_core.flame.model import HeadModel
from sacha_core.flame.posing import TURNS, HeadMotion
from sacha_core.parallel.kept import Kept
from sacha_core.parallel.pool import Pool
from sacha_core.train.kernels.pose_backward import pose_backward, vertices_backward
from sacha_core.train.state import Arrays

__all__ = ["Rig"]

PLACES = {  # of the parameters in a row of numbers
    "rotation": slice(0, 3), "neck": slice(3, 6), "jaw": slice(6, 9), "eyes": slice(9, 15), "translation": slice(15, 18),
    "expression": slice(18, None),
}  # fmt: skip


class WayBack(NamedTuple):
    """What kernels want that go back from the corners of triangles to a pose.

    Args:
        blocks: of vertices, each of which leaves sums of its own.
        skin: what `vertices_backward` wants after the blocks.
        spaces: (threads, s) that it works in.
        sums: that it leaves.
        joints: what `pose_backward` wants after those.
    """

    blocks: int
    skin: tuple[Any, ...]
    spaces: Float[np.ndarray, "t s"]
    sums: tuple[np.ndarray, ...]
    joints: tuple[Any, ...]


class Rig:
    """Poses one person's head and carries gradients back to the parameters of the pose. Identity and personal offsets are constants.

    Results have the same bits for any number of threads.

    Args:
        head: the head model.
        motion: whose static parameters make the person.
        pool: shares out the work.
        dtype: float32, or float64 for checking gradients.

    Attributes:
        faces: (f, 3) int32, vertex indices of the triangles.
        g_corners: (f, 3, 3) gradient by the place of each triangle's corners: to be written before `backward`.
        row: float64, what `slopes` gives, one parameter after the other.

    Raises:
        HeadError: the motion has components or vertex offsets that the head lacks.

    Source: Li et al., FLAME, SIGGRAPH Asia 2017, equations 2 to 5; gradients own.
    """

    def __init__(self, head: HeadModel, motion: HeadMotion, pool: Pool, dtype: type[np.floating] = np.float32) -> None:
        self._posed, self._pool = PosedHead(head, motion, pool, dtype), pool
        self.faces = self._posed.faces
        self.g_corners = np.zeros((head.n_faces, 3, 3), dtype)
        corners = self.faces.ravel()
        self._corners = np.argsort(corners, kind="stable").astype(np.int32)
        self._first_corner = np.searchsorted(corners[self._corners], np.arange(head.n_vertices + 1)).astype(np.int32)
        poser = self._posed.poser
        blocks, j = -(-head.n_vertices // BLOCK), len(poser.parents)
        self._blocks, self._spaces = blocks, np.empty((pool.threads, 3 * BLOCK), dtype)
        self._sums = np.zeros((blocks, j, 3, 4)), np.zeros((blocks, 3)), np.zeros((blocks, len(poser.directions)))
        self.row = np.zeros(PLACES["expression"].start + poser.joint_directions.shape[2])
        self._slopes = (
            self.row[PLACES["expression"]],
            self.row[: PLACES["eyes"].stop].reshape(5, 3),
            self.row[PLACES["translation"]],
        )
        self._way_back: Kept[WayBack] = Kept()
        self._given, self._by_name = np.zeros(0), dict[str, np.ndarray]()

    def pose(self, parameters: Mapping[str, Float[np.ndarray, " p"]]) -> Pose:
        """Pose the head.

        Args:
            parameters: of one timestep, by the names of `FITTED_MOTION`. Expression coefficients for which the motion or the head has no
                directions are ignored.

        Returns:
            The pose, whose arrays hold until the next call.

        Raises:
            GeometryError: a triangle has zero area or a vertex that is not finite; the message names the first such triangle.
        """
        return self._posed.pose(*in_order(parameters))

    @property
    def posing(self) -> Posing:
        """What kernels want that take a pose instead of `pose`, the same for all."""
        return self._posed.posing

    def way_back(self, pose: Pose) -> WayBack:
        """Give what kernels want that go back to the parameters of the last pose; `slopes` then gives what they found."""
        return self._way_back.of(lambda: self._find_way_back(pose), pose)

    def _find_way_back(self, pose: Pose) -> WayBack:
        poser, corners = self._posed.poser, (self._corners, self._first_corner, self.g_corners.reshape(-1, 3))
        skin = (*corners, pose.unposed, poser.weights, pose.transforms, poser.directions, self._posed.moves)
        joints = (
            pose.vectors, pose.rotations, pose.joints, poser.parents, pose.transforms, poser.joint_directions,
            poser.has_correctives, *self._slopes,
        )  # fmt: skip
        return WayBack(self._blocks, skin, self._spaces, self._sums, joints)

    def slopes(self, like: Mapping[str, Float[np.ndarray, " p"]]) -> Arrays:
        """Give the gradient by the parameters of the last pose, where a kernel left it; holds until the next call.

        Args:
            like: the parameters, whose lengths and dtype the gradients get.
        """
        size, dtype = PLACES["expression"].start + len(like["expression"]), like["expression"].dtype
        if (self._given.size, self._given.dtype) != (size, dtype):
            self._given = np.zeros(size, dtype)
            self._by_name = {name: self._given[place] for name, place in PLACES.items()}
        self._given[: len(self.row)] = self.row
        return self._by_name

    def backward(self, pose: Pose, like: Mapping[str, Float[np.ndarray, " p"]]) -> Arrays:
        """Give the gradient by the parameters of the pose that `g_corners` stands for.

        Args:
            pose: the last.
            like: its parameters, whose lengths and dtypes the gradients get.
        """
        way = self.way_back(pose)

        def job(worker: int, block: int) -> None:
            vertices_backward(block, block + 1, *way.skin, way.spaces[worker], *way.sums)

        self._pool.run(job, way.blocks)
        pose_backward(*way.sums, *way.joints)
        return self.slopes(like)


def in_order(parameters: Mapping[str, Float[np.ndarray, " p"]]) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Give expression, axis-angle vectors (5, 3) and translation."""
    vectors = np.concatenate([parameters[name] for name in TURNS]).reshape(5, 3)
    return parameters["expression"], vectors, parameters["translation"]
