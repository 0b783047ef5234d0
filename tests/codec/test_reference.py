"""Oracle: the plain decoder of FORMAT.md. Every array agrees to the bit, whatever is coded."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from golden_streams import FOLDER
from reference_decoder import reference_decode
from synthetic_avatars import (
    HEAD,
    random_avatar,
    random_gaussians,
    random_importance,
    small_head,
    smooth_avatar,
    world_vertex_avatar,
)  # fmt: skip

from sacha_core.avatar.avatar import Avatar
from sacha_core.codec import decode, embedded_head, encode, encode_archive, encode_paper
from sacha_core.flame.model import HeadModel


def assert_as_specified(data: bytes, head: HeadModel) -> None:
    """Both decoders give the same bits."""
    avatar = decode(data)
    parts = reference_decode(data, head.v_template, head.faces)
    assert ("motion" in parts) == (avatar.motion is not None)
    for part, arrays in parts.items():
        for name, expected in arrays.items():
            array = getattr(getattr(avatar, part), name)
            assert (array.dtype, array.shape) == (expected.dtype, expected.shape), name
            assert array.tobytes() == expected.tobytes(), name


@pytest.mark.parametrize("path", sorted(FOLDER.glob("*.sacha")), ids=lambda path: path.stem)
def test_published_files(path):
    data = path.read_bytes()
    assert_as_specified(data, embedded_head(data) or small_head())


@pytest.mark.parametrize(("level", "n_harmonics"), [(1, 15), (2, 0), (3, 8), (4, 3)])
@pytest.mark.parametrize("with_head", [False, True])
def test_every_level_and_degree(level, n_harmonics, with_head):
    head = small_head()
    avatar = random_avatar(120, n_frames=9, n_harmonics=n_harmonics, seed=level, head=head)
    data = encode(avatar, level, head=head if with_head else None, embed_head=with_head, group_frames=4)
    assert_as_specified(data, head)


@pytest.mark.parametrize("n_triangles", [1, 6])
def test_far_values_on_few_triangles(n_triangles):
    """Raw bits, long passes of mates, steps at both ends of their rules."""
    gaussians = random_gaussians(200, n_harmonics=3)
    gaussians.position[::3] *= 3000
    gaussians.log_scale[::5] -= 20
    gaussians.opacity_logit[::7] = 30
    gaussians.sh_dc[::9] *= 900
    crowded = replace(gaussians, binding=(gaussians.binding % n_triangles * 3).astype(np.int32))
    assert_as_specified(encode(Avatar(crowded, HEAD), 4, drop_invisible=False), small_head())


@pytest.mark.parametrize("n_harmonics", [0, 3, 8, 15])
def test_archive_and_paper_of_every_degree(n_harmonics):
    """Numbers of any size and sign, few of them alike; points in crowds."""
    avatar = random_avatar(70, n_frames=4, n_harmonics=n_harmonics, seed=n_harmonics)
    odd = np.array([-0.0, 0.0, 1e-45, -1e-45, 3.4e38, -3.4e38, 1.0], np.float32)
    wild = avatar.gaussians.sh_dc.copy()
    wild.reshape(-1)[::3] = np.resize(odd, 70)
    assert_as_specified(encode_archive(replace(avatar, gaussians=replace(avatar.gaussians, sh_dc=wild))), small_head())
    together = avatar.gaussians.position[np.arange(70) % 6]
    assert_as_specified(
        encode_paper(replace(avatar, gaussians=replace(avatar.gaussians, position=together)), 3), small_head()
    )


@pytest.mark.parametrize("level", [1, 4])
def test_what_is_chosen_by_worth_and_near_vertices(level):
    head = small_head()
    avatar = smooth_avatar(120, head, n_frames=3, n_harmonics=3, seed=level)
    worth = random_importance(avatar.gaussians, seed=level)
    assert_as_specified(encode(avatar, level, head=head, embed_head=True, importance=worth), head)
    near = world_vertex_avatar(head, seed=level)
    worth = random_importance(near.gaussians, seed=level)
    assert_as_specified(encode(near, level, head=head, embed_head=True, importance=worth), head)
