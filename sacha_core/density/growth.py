"""Where Gaussians are too few: which are cloned, which are split, and what the children are."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from jaxtyping import Bool, Float

from sacha_core.geometry import quaternion

__all__ = ["Growth", "growth", "shared_opacity", "split_children"]

CHILDREN = 2
SHRINK = 0.8 * CHILDREN  # children's standard deviations are the parent's over this


@dataclass(frozen=True)
class Growth:
    """Which of n Gaussians grow, and how; none does both.

    Args:
        clone: (n,) get an exact copy.
        split: (n,) are replaced by two smaller ones.
    """

    clone: Bool[np.ndarray, " n"]
    split: Bool[np.ndarray, " n"]


def growth(
    gradient: Float[np.ndarray, " n"],
    threshold: Float[np.ndarray, " n"],
    scales_world: Float[np.ndarray, "n 3"],
    largest_clone: float,
) -> Growth:
    """Decide which Gaussians are cloned and which are split; one without a finite size does neither, as its children would lie nowhere.

    Args:
        gradient: (n,) mean length of the gradient of the mean's place in the image, in normalised device units.
        threshold: (n,) at or above which a Gaussian grows: its region's.
        scales_world: (n, 3) standard deviations, metres.
        largest_clone: longest standard deviation, metres, up to which a Gaussian is cloned; beyond, it is split.

    Source: Kerbl et al., 3D Gaussian Splatting, 2023, section 5.2; thresholds by region: SACHA.
    """
    largest = scales_world.max(axis=1, initial=0)
    grows = (gradient >= threshold) & np.isfinite(largest)
    small = largest <= largest_clone
    return Growth(grows & small, grows & ~small)


def shared_opacity(opacity_logit: Float[np.ndarray, " n"]) -> Float[np.ndarray, " n"]:
    """Give the opacity of a Gaussian and its clone that together let through what the Gaussian let through alone.

    With o the opacity, both get 1 - sqrt(1 - o), as (1 - that) squared is 1 - o.

    Args:
        opacity_logit: (n,) of o.

    Returns:
        (n,) logits, in the dtype of `opacity_logit`.

    Source: Rota Bulo et al., Revising Densification in Gaussian Splatting, 2024, section 4.2.
    """
    # with t = sqrt(1 - o), the logit of 1 - t is log((1 - t) / t), and 1 - t = o / (1 + t) loses no digits where o is small
    logit = opacity_logit.astype(np.float64)
    log_through = -0.5 * np.logaddexp(0, logit)
    shared = -np.logaddexp(0, -logit) - np.log1p(np.exp(log_through)) - log_through
    return shared.astype(opacity_logit.dtype)


def split_children(
    position: Float[np.ndarray, "n 3"],
    log_scale: Float[np.ndarray, "n 3"],
    rotation_quaternion: Float[np.ndarray, "n 4"],
    triangle_scale: Float[np.ndarray, " n"],
    rng: np.random.Generator,
    spread: str = "world",
) -> tuple[Float[np.ndarray, "m 3"], Float[np.ndarray, "m 3"]]:
    """Draw the places and sizes of the two children of each parent; all else they inherit.

    Args:
        position: (n, 3) means of the parents, local.
        log_scale: (n, 3) of the parents, local.
        rotation_quaternion: (n, 4) of the parents, local, of any length.
        triangle_scale: (n,) metres a local unit.
        rng: source of the offsets.
        spread: `world` draws offsets with the parent's size in metres and adds them in local units, as GaussianAvatars does, so that
            children land almost on their parent; `local` draws them in local units, over the parent's own extent.

    Returns:
        Means and log scales of 2 n children: first one of each parent, then the other.

    Source: Kerbl et al., 3D Gaussian Splatting, 2023, section 5.2; GaussianAvatars for bound Gaussians.
    """
    deviation = np.exp(log_scale) * (triangle_scale[:, None] if spread == "world" else np.float32(1))
    offsets = rng.standard_normal((CHILDREN, *position.shape), np.float32) * deviation
    turn = quaternion.to_matrix(quaternion.normalise(rotation_quaternion))
    means = position + np.einsum("nij,cnj->cni", turn, offsets)
    smaller = np.broadcast_to(log_scale - np.float32(np.log(SHRINK)), means.shape)
    return (
        means.reshape(-1, 3).astype(position.dtype),
        np.ascontiguousarray(smaller.reshape(-1, 3), log_scale.dtype),
    )
