"""An avatar that is posed by a frame of its motion, by hand, or by both."""

from __future__ import annotations

from dataclasses import dataclass, field, replace

import numpy as np
from jaxtyping import Float

from sacha_core.animation.carry import carry
from sacha_core.animation.posed import PosedHead
from sacha_core.avatar.binding import sigmoid
from sacha_core.avatar.gaussians import Gaussians
from sacha_core.avatar.motion import Motion
from sacha_core.flame.model import HeadModel
from sacha_core.geometry.quaternion import to_matrix
from sacha_core.raster.harmonics import sh_colours

__all__ = ["Gesture", "Puppet", "Splats"]

JOINTS = ("rotation", "neck", "jaw", "left_eye", "right_eye")  # in the order in which heads are posed


@dataclass(frozen=True)
class Gesture:
    """What a hand adds to a frame.

    Args:
        expression: by component, what is added to its coefficient.
        turns: by joint of `JOINTS`, the (3,) axis-angle vector that is added to its own, radians.
    """

    expression: dict[int, float] = field(default_factory=dict)
    turns: dict[str, tuple[float, float, float]] = field(default_factory=dict)


@dataclass(frozen=True)
class Splats:
    """n Gaussians in the world, as browsers draw them; float32.

    Args:
        means: (n, 3) metres.
        covariances: (n, 3, 3) square metres.
        colours: (n, 3) in [0, 1].
        opacities: (n, 1) in [0, 1].
    """

    means: Float[np.ndarray, "n 3"]
    covariances: Float[np.ndarray, "n 3 3"]
    colours: Float[np.ndarray, "n 3"]
    opacities: Float[np.ndarray, "n 1"]


class Puppet:
    """Poses an avatar.

    Args:
        head: the head that it is bound to.
        motion: what it does; None for the head at rest.

    Raises:
        HeadError: the head cannot move so.
    """

    def __init__(self, head: HeadModel, motion: Motion | None) -> None:
        n_expression = head.exprdirs.shape[2]
        self.head, self.motion = head, motion or Motion.rest(head.shapedirs.shape[2], n_expression)
        width = n_expression - self.motion.expression.shape[1]
        whole = np.pad(self.motion.expression, ((0, 0), (0, max(width, 0))))  # so that a hand can move every component
        self._expression = whole
        self._posed = PosedHead(head, replace(self.motion, expression=whole))

    def __len__(self) -> int:
        """Give the number of frames."""
        return len(self.motion)

    def splats(
        self,
        gaussians: Gaussians,
        frame: int,
        gesture: Gesture,
        eye: Float[np.ndarray, "3"],
        colours: Float[np.ndarray, "n 3"] | None = None,
    ) -> Splats:
        """Give the Gaussians of a pose.

        Args:
            gaussians: n of them, bound to the head.
            frame: of the motion, from 0.
            gesture: what is added to it.
            eye: (3,) from where they are looked at, metres: colours depend on it.
            colours: (n, 3) to show instead of their own.

        Raises:
            GeometryError: the pose makes a triangle degenerate.
        """
        motion = self.motion
        expression = self._expression[frame].copy()
        for component, amount in gesture.expression.items():
            expression[component] += amount
        eyes = motion.eyes[frame].reshape(2, 3)
        vectors = np.concatenate([np.stack([motion.rotation[frame], motion.neck[frame], motion.jaw[frame]]), eyes])
        for joint, turn in gesture.turns.items():
            vectors[JOINTS.index(joint)] += turn
        pose = self._posed.pose(expression, vectors, motion.translation[frame])
        means, scales, quaternions = carry(
            gaussians.position, gaussians.log_scale, gaussians.quaternion, gaussians.binding, pose
        )
        axes = to_matrix(quaternions) * scales[:, None, :]
        if colours is None:
            colours = sh_colours(gaussians.sh_dc, gaussians.sh_rest, means, eye, gaussians.sh_degree)
        opacities = sigmoid(gaussians.opacity_logit)[:, None]
        return Splats(means, axes @ axes.transpose(0, 2, 1), np.clip(colours, 0, 1), opacities)
