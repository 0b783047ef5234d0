"""Gaussians as a decoder will have them, in the order in which they were given.

Source: own.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from jaxtyping import Bool

from sacha_core.avatar.avatar import Avatar
from sacha_core.avatar.gaussians import Gaussians
from sacha_core.codec import decode
from sacha_core.codec.encoder import encode_traced
from sacha_core.codec.importance import GaussianImportance
from sacha_core.codec.levels import Level
from sacha_core.codec.rotation import sort_axes
from sacha_core.codec.turning import conjugate, multiply, nearest_to
from sacha_core.flame.model import HeadModel

__all__ = ["CODED", "Quantised", "quantised"]

CODED = (
    "position",
    "log_scale",
    "quaternion",
    "opacity_logit",
    "sh_dc",
    "sh_rest",
)  # of a Gaussian, beside its triangle
HIDDEN_LOGIT = -20.0  # opacity of what the encoder left out


@dataclass(frozen=True)
class Quantised:
    """What became of n Gaussians.

    Args:
        gaussians: as decoded, n rows; what was left out is transparent and else as it was.
        kept: (n,) whether the encoder kept each.
        n_bytes: of the file.
    """

    gaussians: Gaussians
    kept: Bool[np.ndarray, " n"]
    n_bytes: int


def quantised(
    avatar: Avatar, head: HeadModel, level: int | Level, importance: GaussianImportance | None = None
) -> Quantised:
    """Encode and decode the Gaussians of an avatar.

    Args:
        avatar: n Gaussians; its motion is left alone.
        head: that they are bound to.
        level: see `sacha_core.codec.encode`.
        importance: likewise.

    Raises:
        FormatError: a value is beyond what the format holds.
    """
    data, rows = encode_traced(replace(avatar, motion=None), level, head=head, importance=importance)
    given = avatar.gaussians
    decoded = with_axes_of(decode(data, head=head).gaussians, given.select(rows))
    kept = np.zeros(len(given), bool)
    kept[rows] = True
    columns = {name: getattr(given, name).copy() for name in CODED}
    columns["opacity_logit"][:] = HIDDEN_LOGIT
    for name, column in columns.items():
        column[rows] = getattr(decoded, name)
    return Quantised(replace(given, **columns), kept, len(data))


def with_axes_of(decoded: Gaussians, given: Gaussians) -> Gaussians:
    """Give decoded Gaussians with their axes, which the codec sorts and turns as it likes, as they were given."""
    order = np.argsort(-given.log_scale, axis=1, kind="stable")
    log_scale = np.empty_like(decoded.log_scale)
    np.put_along_axis(log_scale, order, decoded.log_scale, axis=1)
    nothing = np.tile(np.array([1.0, 0, 0, 0], np.float32), (len(given), 1))
    sorting = sort_axes(given.log_scale, nothing)[1].T
    turned = multiply(decoded.quaternion.T.astype(np.float64), conjugate(sorting))
    wanted = given.quaternion.T.astype(np.float64)
    quaternion = nearest_to(turned, wanted) * np.linalg.norm(wanted, axis=0)
    return replace(decoded, log_scale=log_scale, quaternion=quaternion.T.astype(np.float32))
