"""From vertex masks, which overlap and leave gaps, to exactly one region for each triangle."""

from __future__ import annotations

import numpy as np
from jaxtyping import Int, UInt8

from sacha_core.errors import HeadError, MissingMasksError
from sacha_core.flame.model import HeadModel
from sacha_core.regions.scheme import PAPER, RegionScheme

__all__ = ["label_triangles", "region_counts"]


def label_triangles(head: HeadModel, scheme: RegionScheme = PAPER) -> UInt8[np.ndarray, " f"]:
    """Give each triangle the label of its region.

    A vertex belongs to the region that wins it by the scheme's priority. Connected vertices without a mask take together the strongest
    region that they touch. A triangle follows the majority of its vertices, or the strongest of three different ones. Teeth triangles
    belong where the scheme says.

    Args:
        head: with the vertex masks that the scheme names.
        scheme: the regions.

    Returns:
        (f,) places in `scheme.regions`.

    Raises:
        HeadError: a mask is missing, or triangles hang together with no masked vertex.

    Source: own; the masks are FLAME's, the regions those of the SACHA paper.
    """
    skin = head.faces[: head.n_faces - head.n_teeth_faces]
    none = len(scheme.priority)
    ranks = _spread(_vertex_ranks(head, scheme), skin, none)
    stray = (ranks[skin] == none).any(axis=1)
    if stray.any():
        raise HeadError(
            f"triangle {int(np.argmax(stray))} of head {head.name!r} and {int(stray.sum()) - 1} others hang together with no vertex"
            f" of any mask, so they belong to no region of scheme {scheme.name!r}"
        )
    corners = np.sort(ranks[skin], axis=1)
    majority = np.where(corners[:, 1] == corners[:, 2], corners[:, 1], corners[:, 0])
    label_of_rank = np.array([scheme.label(region) for region in scheme.priority], np.uint8)
    labels = np.full(head.n_faces, scheme.label(scheme.teeth), np.uint8)
    labels[: len(skin)] = label_of_rank[majority]
    return labels


def region_counts(
    labels: UInt8[np.ndarray, " f"], binding: Int[np.ndarray, " n"], scheme: RegionScheme = PAPER
) -> Int[np.ndarray, " r"]:
    """Count the Gaussians of each region.

    Args:
        labels: (f,) region of each triangle.
        binding: (n,) triangle of each Gaussian.
        scheme: the regions that the labels refer to.

    Returns:
        (r,) counts that sum to n.
    """
    return np.bincount(labels[binding], minlength=len(scheme.regions))


def _vertex_ranks(head: HeadModel, scheme: RegionScheme) -> Int[np.ndarray, " v"]:
    """Place in the priority of each vertex's region; one past the last where no mask covers it."""
    missing = sorted({name for names in scheme.masks.values() for name in names} - head.masks.keys())
    if missing:
        raise MissingMasksError(
            f"head {head.name!r} has no vertex mask {', '.join(missing)}; region scheme {scheme.name!r} is made from them: give FLAME's"
            " official masks (--masks FLAME_masks.pkl or .npz) with a head of FLAME's topology"
        )
    ranks = np.full(head.n_vertices, len(scheme.priority))
    for rank, region in reversed(list(enumerate(scheme.priority))):
        for name in scheme.masks[region]:
            ranks[head.masks[name]] = rank
    return ranks


def _spread(ranks: Int[np.ndarray, " v"], faces: Int[np.ndarray, "f 3"], none: int) -> Int[np.ndarray, " v"]:
    """Give each connected component of vertices ranked `none` the strongest rank among its neighbours.

    Those vertices repeatedly take the strongest rank in their neighbourhood until nothing changes: as many rounds as a component is wide.
    """
    edges = np.concatenate([faces[:, [0, 1]], faces[:, [1, 2]], faces[:, [2, 0]]])
    edges = np.concatenate([edges, edges[:, ::-1]])
    edges = edges[ranks[edges[:, 0]] == none]
    ranks = ranks.copy()
    while True:
        before = ranks.copy()
        np.minimum.at(ranks, edges[:, 0], before[edges[:, 1]])
        if np.array_equal(before, ranks):
            return ranks
