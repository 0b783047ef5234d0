"""What a codec offers here, and what both of its sides know beside the bytes."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import Literal

import numpy as np
from jaxtyping import Float, Int

from sacha_core.avatar.gaussians import Gaussians
from sacha_core.avatar.motion import Motion
from sacha_core.codec.encoder import VISIBLE
from sacha_core.codec.places import curve_index
from sacha_core.codec.template import template_of
from sacha_core.errors import SachaError
from sacha_core.flame.model import HeadModel
from sacha_core.geometry import quaternion
from sacha_core.geometry.triangle import TriangleFrames, triangle_frames

__all__ = ["TURNED", "Domain", "Ground", "Parts", "Peer", "PeerError", "Setting", "along_curve", "enlarged", "visible"]

Domain = Literal["local", "world", "mixed"]
Parts = dict[str, bytes]
TURNED = "rotations by triangle"  # what settings of the mixed domain are called
INNER = 0.001  # of the points on each side, which may lie anywhere
CURVE_CELLS = 1 << 10  # along each side of what splats without a head are sorted in


class PeerError(SachaError):
    """A codec failed on an avatar; the message says at what."""


@dataclass(frozen=True)
class Setting:
    """One operating point.

    Args:
        name: what the reader sees.
        domain: `local`, in the units and axes of the triangles; `world`, with the head at rest; `mixed`, places in the world, sizes and
            rotations as the triangle has them.
        options: the codec's own, by name.
    """

    name: str
    domain: Domain = "world"
    options: Mapping[str, int | float | str] = field(default_factory=dict)


@dataclass(frozen=True)
class Ground:
    """What both sides of every codec know: the head at rest, and an order of its triangles in which neighbours follow each other.

    Args:
        head: the head model.
        motion: of the avatar, which an encoder may look at, and a decoder never does; None where there is none.
        bound: whether Gaussians belong to the head's triangles; else they stand in the world, and each triangle's frame is the world's.
    """

    head: HeadModel
    motion: Motion | None = None
    bound: bool = True

    @cached_property
    def frames(self) -> TriangleFrames:
        """Frames of the triangles of the head at rest, float64."""
        return triangle_frames(self.head.v_template.astype(np.float64), self.head.faces)

    @cached_property
    def order(self) -> Int[np.ndarray, " f"]:
        """Triangles along the curve that our own codec takes them along, too."""
        return template_of(self.head.v_template, self.head.faces).order

    @cached_property
    def place(self) -> Int[np.ndarray, " f"]:
        """Place of each triangle in that order."""
        return np.argsort(self.order)

    @property
    def centroids(self) -> Float[np.ndarray, "f 3"]:
        """Centre of each triangle, metres."""
        return self.frames.origin

    def to_domain(self, gaussians: Gaussians, domain: Domain) -> Gaussians:
        """Carry Gaussians into a domain, sorted along the head, or else along a curve in space, without what only training needs."""
        along = self.place[gaussians.binding] if self.bound else along_curve(gaussians.position)
        sorted_ = gaussians.select(np.argsort(along, kind="stable"))
        if domain == "local" or not self.bound:
            return _with(sorted_, sorted_.position, sorted_.log_scale, sorted_.quaternion)
        binding, frames = sorted_.binding, self.frames
        scale = frames.scale[binding, None]
        turned = np.einsum("nij,nj->ni", frames.rotation[binding], sorted_.position.astype(np.float64))
        if domain == "mixed":
            return _with(sorted_, turned * scale + frames.origin[binding], sorted_.log_scale, sorted_.quaternion)
        return _with(
            sorted_,
            turned * scale + frames.origin[binding],
            sorted_.log_scale + np.log(scale),
            quaternion.multiply(quaternion.from_matrix(frames.rotation)[binding], _unit(sorted_.quaternion)),
        )

    def from_domain(self, splats: Gaussians, domain: Domain) -> Gaussians:
        """Carry Gaussians of a domain back to the triangles that they are bound to."""
        if domain == "local" or not self.bound:
            return splats
        binding, frames = splats.binding, self.frames
        scale = frames.scale[binding, None]
        away = splats.position.astype(np.float64) - frames.origin[binding]
        position = np.einsum("nji,nj->ni", frames.rotation[binding], away) / scale
        if domain == "mixed":
            return _with(splats, position, splats.log_scale, splats.quaternion)
        turns = quaternion.from_matrix(frames.rotation)[binding] * np.array([1.0, -1, -1, -1])
        return _with(
            splats,
            position,
            splats.log_scale - np.log(scale),
            quaternion.multiply(turns, _unit(splats.quaternion)),
        )


@dataclass(frozen=True)
class Peer:
    """One codec.

    Args:
        name: short, as `--require` takes it.
        title: what the reader sees.
        lacking: says what is missing on this machine and how to get it; None where the codec can run.
        settings: gives the operating points for a degree of harmonics, fewer of them where asked for.
        encode: gives all bytes that a decoder needs, bindings included, under a name for each part.
        decode: gives the Gaussians, in any order, from the bytes alone.
        lossless: whether every bit comes back.
        limit_s: how long one operating point may take.
        count: bytes that describe the Gaussians, where the parts hold a motion besides; by default all.
        needs_head: whether it takes only Gaussians that are bound to a head.
        own_order: whether it is handed them in the avatar's own order, from which it may learn something, instead of sorted.
    """

    name: str
    title: str
    lacking: Callable[[], str | None]
    settings: Callable[[bool, int], tuple[Setting, ...]]
    encode: Callable[[Gaussians, Ground, Setting], Parts]
    decode: Callable[[Parts, Ground], Gaussians]
    lossless: bool = False
    limit_s: float = 300.0
    count: Callable[[Parts], int] = lambda parts: sum(map(len, parts.values()))
    needs_head: bool = False
    own_order: bool = False

    def settings_for(self, few: bool, sh_degree: int, bound: bool) -> tuple[Setting, ...]:
        """Give the operating points, of those that differ only in their domain one where there is no head: then all stand in the world."""
        offered = self.settings(few, sh_degree)
        if bound:
            return offered
        world = [
            replace(one, name=one.name.replace(TURNED, "world"), domain="world")
            for one in offered
            if one.domain != "local"
        ]
        named = {one.name: one for one in world} or {one.name: one for one in offered}
        return tuple(named.values())


def along_curve(position: Float[np.ndarray, "n 3"]) -> Int[np.ndarray, " n"]:
    """Give the place of each point on a Hilbert curve through the box that nearly all of them lie in."""
    if not len(position):
        return np.zeros(0, np.int64)
    low, high = np.quantile(position.astype(np.float64), (INNER, 1 - INNER), axis=0)
    share = (position - low) / max(float((high - low).max()), 1e-30)
    return curve_index(np.clip(share * CURVE_CELLS, 0, CURVE_CELLS - 1).astype(np.int64))


def visible(gaussians: Gaussians) -> Gaussians:
    """Give the Gaussians that a renderer draws at all, which is what the lossy codecs are handed, as ours leaves out the others, too."""
    return gaussians.select(gaussians.opacity_logit >= VISIBLE)


def enlarged(splats: Gaussians, factor: float) -> Gaussians:
    """Give Gaussians as if seen through a magnifying glass: places and sizes times a factor."""
    grown = splats.log_scale + np.float32(math.log(factor))
    return replace(splats, position=splats.position * np.float32(factor), log_scale=grown)


def _unit(quaternions: Float[np.ndarray, "n 4"]) -> Float[np.ndarray, "n 4"]:
    return quaternion.normalise(quaternions.astype(np.float64))


def _with(
    gaussians: Gaussians,
    position: Float[np.ndarray, "n 3"],
    log_scale: Float[np.ndarray, "n 3"],
    quaternions: Float[np.ndarray, "n 4"],
) -> Gaussians:
    return Gaussians(
        position.astype(np.float32), log_scale.astype(np.float32), quaternions.astype(np.float32), gaussians.opacity_logit,
        gaussians.sh_dc, gaussians.sh_rest, gaussians.binding,
    )  # fmt: skip
