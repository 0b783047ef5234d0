"""Random avatars for codec tests: no real material, every attribute drawn from what training tends to leave."""

from __future__ import annotations

from dataclasses import replace
from functools import cache

import numpy as np

from sacha_core.avatar.avatar import Avatar
from sacha_core.avatar.gaussians import Gaussians
from sacha_core.avatar.motion import Motion
from sacha_core.codec.anchors import vertex_triangles
from sacha_core.codec.importance import GaussianImportance
from sacha_core.codec.template import template_of
from sacha_core.flame.model import HeadModel, HeadReference
from sacha_core.geometry.triangle import triangle_frames

HEAD = HeadReference("random", "0123456789abcdef" * 4, 120, 200)


def random_gaussians(n: int, n_faces: int = HEAD.n_faces, n_harmonics: int = 15, seed: int = 0) -> Gaussians:
    """Give n Gaussians bound at random."""
    rng = np.random.default_rng(seed)
    f4 = np.float32
    return Gaussians(
        position=rng.normal(0, 0.7, (n, 3)).astype(f4),
        log_scale=rng.normal(-1.5, 0.9, (n, 3)).astype(f4),
        quaternion=rng.normal(0, 1, (n, 4)).astype(f4),
        opacity_logit=rng.normal(0, 2.5, n).astype(f4),
        sh_dc=rng.normal(0, 0.6, (n, 3)).astype(f4),
        sh_rest=rng.laplace(0, 0.05, (n, n_harmonics, 3)).astype(f4),
        binding=rng.integers(0, n_faces, n).astype(np.int32),
    )


def random_motion(n_frames: int, n_offsets: int = HEAD.n_vertices, n_expression: int = 20, seed: int = 0) -> Motion:
    """Give a smooth motion: sums of a few sines with noise."""
    rng = np.random.default_rng(seed)
    t = np.arange(n_frames)[:, None] / 25

    def wander(width: int, size: float) -> np.ndarray:
        speed, phase = rng.uniform(0.3, 3, width), rng.uniform(0, 6, width)
        return (size * np.sin(speed * t + phase) + rng.normal(0, size / 50, (n_frames, width))).astype(np.float32)

    return Motion(
        shape=rng.normal(0, 1, 30).astype(np.float32),
        static_offset=rng.normal(0, 1e-3, (n_offsets, 3)).astype(np.float32),
        expression=wander(n_expression, 1.0),
        rotation=wander(3, 0.3),
        neck=wander(3, 0.1),
        jaw=wander(3, 0.2),
        eyes=wander(6, 0.2),
        translation=wander(3, 0.02),
        frame_rate=25.0,
    )


def random_avatar(
    n: int, n_frames: int = 30, n_harmonics: int = 15, seed: int = 0, head: HeadModel | None = None
) -> Avatar:
    """Give an avatar with a motion, bound to `head` or to one that exists by name only."""
    reference = HEAD if head is None else head.reference
    gaussians = random_gaussians(n, reference.n_faces, n_harmonics, seed)
    return Avatar(gaussians, reference, random_motion(n_frames, reference.n_vertices, seed=seed))


@cache
def tiny_head() -> HeadModel:
    """Give a bumpy sphere of two dozen triangles, the same object every time."""
    return small_head(1, 4, 4)


def small_head(seed: int = 0, rings: int = 9, segments: int = 14) -> HeadModel:
    """Give a bumpy sphere of a few hundred triangles with one joint."""
    rng = np.random.default_rng(seed)
    polar, around = np.meshgrid(
        np.linspace(0.1, 3.0, rings), np.arange(segments) * (2 * np.pi / segments), indexing="ij"
    )
    radius = 0.1 * (1 + 0.05 * rng.normal(size=polar.shape))
    across, along = np.sin(polar), np.cos(polar)
    v_template = np.stack([radius * across * np.sin(around), radius * along, radius * across * np.cos(around)], axis=-1)
    row, column = np.meshgrid(np.arange(rings - 1), np.arange(segments), indexing="ij")
    a, b = row * segments + column, row * segments + (column + 1) % segments
    faces = np.concatenate([np.stack([a, a + segments, b], -1), np.stack([b, a + segments, b + segments], -1)])
    v = rings * segments
    return HeadModel(
        name="bumpy",
        v_template=v_template.reshape(-1, 3).astype(np.float32),
        faces=faces.reshape(-1, 3).astype(np.int32),
        shapedirs=rng.normal(0, 1e-3, (v, 3, 2)).astype(np.float32),
        exprdirs=rng.normal(0, 1e-3, (v, 3, 3)).astype(np.float32),
        J_regressor=np.full((1, v), 1 / v, np.float32),
        weights=np.ones((v, 1), np.float32),
        parents=np.array([-1], np.int32),
        masks={"face": np.arange(min(20, v), dtype=np.int32)},
    )


def smooth_avatar(n: int, head: HeadModel, n_frames: int = 30, n_harmonics: int = 15, seed: int = 0) -> Avatar:
    """Give an avatar whose attributes vary smoothly over its head, with some noise: what prediction finds something in."""
    avatar = random_avatar(n, n_frames, n_harmonics, seed, head)
    g = avatar.gaussians
    corner = head.v_template[head.faces[g.binding, 0]] / np.abs(head.v_template).max()
    rng = np.random.default_rng(seed)

    def over_head(values: np.ndarray) -> np.ndarray:
        width = values.reshape(n, values[:1].size).shape[1]
        wave = np.sin(3 * corner.astype(np.float64) @ rng.normal(0, 1, (3, width)) + rng.uniform(0, 6, width))
        return (values * 0.2 + wave.reshape(values.shape) * values.std()).astype(np.float32)

    smooth = {
        name: over_head(getattr(g, name))
        for name in ("position", "log_scale", "opacity_logit", "sh_dc", "sh_rest")
        if n and getattr(g, name).size
    }
    assert avatar.motion is not None
    offsets = (2e-2 * np.sin(head.v_template.astype(np.float64) * 12 + seed)).astype(np.float32)
    return replace(avatar, gaussians=replace(g, **smooth), motion=replace(avatar.motion, static_offset=offsets))


def vertex_avatar(head: HeadModel, n_harmonics: int = 3, seed: int = 0) -> Avatar:
    """Give an avatar with a Gaussian for all but some vertices of the once-subdivided head, in their order."""
    template = template_of(head.v_template, head.faces)
    triangle = vertex_triangles(template)
    chosen = np.flatnonzero((triangle >= 0) & (np.random.default_rng(seed).random(len(triangle)) < 0.9))
    avatar = smooth_avatar(len(chosen), head, 0, n_harmonics, seed)
    gaussians = replace(avatar.gaussians, binding=triangle[chosen].astype(np.int32))
    return Avatar(gaussians, head.reference)


def random_importance(gaussians: Gaussians, seed: int = 0) -> GaussianImportance:
    """Give what numbers could be worth to pictures: over several orders of magnitude, some Gaussians hidden."""
    n, k = gaussians.sh_rest.shape[:2]
    rng = np.random.default_rng(seed)
    worth = np.exp(rng.normal(0, 2, n)) * np.where(rng.random(n) < 0.3, 1e-4, 1)

    def of(*shape: int) -> np.ndarray:
        return worth.reshape(n, *[1] * len(shape)) * rng.uniform(0.5, 2, (n, *shape))

    basis = rng.normal(0, 1, (n, 6, k + 1))
    metric = np.einsum("nvi,nvj->nij", basis, basis) * worth[:, None, None]
    return GaussianImportance(of(3), of(3), of(3), of(), of(3), of(k, 3), metric.astype(np.float32))


def world_vertex_avatar(head: HeadModel, seed: int = 0) -> Avatar:
    """Give an avatar with a Gaussian close to every vertex of the once-subdivided head."""
    avatar = vertex_avatar(head, 3, seed)
    template = template_of(head.v_template, head.faces)
    ends = head.v_template[template.edges.ends].mean(axis=1)
    everywhere = np.concatenate([head.v_template, ends])
    triangle = vertex_triangles(template)
    chosen = np.flatnonzero((triangle >= 0) & (np.random.default_rng(seed).random(len(triangle)) < 0.9))
    frames = triangle_frames(head.v_template, head.faces)
    face = avatar.gaussians.binding
    off = everywhere[chosen] + np.random.default_rng(seed).normal(0, 2e-4, (len(chosen), 3)) - frames.origin[face]
    local = np.einsum("nij,ni->nj", frames.rotation[face], off) / frames.scale[face, None]
    return replace(avatar, gaussians=replace(avatar.gaussians, position=local.astype(np.float32)))
