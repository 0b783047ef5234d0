"""The golden streams: one file for every level and profile, and for what else the format has; they decode to the same bits for ever.

`python tests/codec/golden_streams.py NAME ...` (or `all`) writes the named ones anew, deliberately: only for a stream that was never
published, or with a new major version of the format and a line in CHANGELOG. A test run never writes them.
"""

from __future__ import annotations

import hashlib
import json
import struct
import sys
from collections.abc import Callable
from dataclasses import fields, replace
from functools import partial
from pathlib import Path

import numpy as np
from synthetic_avatars import (
    HEAD,
    random_avatar,
    random_gaussians,
    random_importance,
    small_head,
    smooth_avatar,
    vertex_avatar,
    world_vertex_avatar,
)

from sacha_core.avatar.avatar import Avatar
from sacha_core.codec import decode, encode, encode_archive, encode_paper
from sacha_core.codec.container import Section, pack_sections, parse_sections
from sacha_core.codec.static import by_those_nearby, to_levels
from sacha_core.codec.template import template_of
from sacha_core.flame.model import HeadModel

FOLDER = Path(__file__).parents[1] / "golden"
DIGESTS = FOLDER / "digests.json"
HARMONICS = {1: 15, 2: 8, 3: 3, 4: 15}  # of the stream of each level


def at_level(level: int) -> bytes:
    """A head inside, Gaussians that vary smoothly over it, several groups of motion."""
    head = small_head()
    avatar = smooth_avatar(150, head, n_frames=14, n_harmonics=HARMONICS[level], seed=level)
    return encode(avatar, level, head=head, embed_head=True, group_frames=5)


def rough() -> bytes:
    """Numbers without any order, some far out: raw bits, steps at both ends of their rules."""
    head = small_head()
    avatar = random_avatar(90, n_frames=3, n_harmonics=3, seed=1, head=head)
    avatar.gaussians.position[::3] *= 3000
    avatar.gaussians.log_scale[::5] -= 20
    avatar.gaussians.opacity_logit[::7] = 30
    avatar.gaussians.sh_dc[::9] *= 900
    return encode(avatar, 4, head=head, embed_head=True, drop_invisible=False)


def by_vertex() -> bytes:
    """One Gaussian for nearly every vertex of the once-subdivided head."""
    head = small_head()
    return encode(vertex_avatar(head, seed=5), 2, head=head, embed_head=True)


def in_the_world() -> bytes:
    """The same, where the Gaussians lie close to the vertices."""
    head = small_head()
    return encode(world_vertex_avatar(head, seed=6), 3, head=head, embed_head=True)


def weighed() -> bytes:
    """Bits spent by what numbers are worth, some Gaussians hidden."""
    head = small_head()
    avatar = smooth_avatar(400, head, n_frames=4, n_harmonics=8, seed=9)
    data = encode(avatar, 3, head=head, embed_head=True, importance=random_importance(avatar.gaussians))
    return with_offsets_from_nearby(data, avatar, head)


def with_offsets_from_nearby(data: bytes, avatar: Avatar, head: HeadModel) -> bytes:
    """Give a file with its vertex offsets coded from those of vertices nearby, which on a small head is seldom the shorter way."""
    assert avatar.motion is not None
    sections = {s.name: s.data for s in parse_sections(data)[1].values()}
    steps = struct.unpack_from("<dd", sections["Static"])
    levels = to_levels(avatar.motion.shape, steps[0]), to_levels(avatar.motion.static_offset, steps[1])
    nearby = by_those_nearby(*levels, template_of(head.v_template, head.faces))
    changed = sections | {"Static": struct.pack("<dd", *steps) + nearby}
    return pack_sections([Section(name, body) for name, body in changed.items()])


def crowded() -> bytes:
    """Many Gaussians on few triangles: long passes of mates."""
    gaussians = random_gaussians(400, 12, 3, seed=10)
    return encode(Avatar(gaussians, HEAD), 4, drop_invisible=False)


def without_head() -> bytes:
    """No head, no motion, no harmonics."""
    avatar = random_avatar(150, n_harmonics=0, seed=2)
    return encode(Avatar(avatar.gaussians, avatar.head), 4)


def empty() -> bytes:
    """No Gaussians, and a motion of no frames."""
    return encode(random_avatar(0, n_frames=0, seed=3), 1)


def archive() -> bytes:
    """Every bit, sensitivities and motion too."""
    avatar = smooth_avatar(80, small_head(), n_frames=9, n_harmonics=15, seed=6)
    logits = np.random.default_rng(6).normal(size=80).astype(np.float32)
    assert avatar.motion is not None
    avatar.motion.eyes[:] = 0
    return encode_archive(replace(avatar, gaussians=replace(avatar.gaussians, sensitivity_logit=logits)))


def archive_again() -> bytes:
    """An archive of what was quantised before: columns of few different numbers."""
    return encode_archive(decode(encode_paper(smooth_avatar(80, small_head(), n_frames=4, n_harmonics=3, seed=8), 1)))


def paper(level: int) -> bytes:
    """The paper's profile by this project's own coder."""
    return encode_paper(smooth_avatar(80, small_head(), n_frames=6, n_harmonics=HARMONICS[level], seed=7), level)


STREAMS: dict[str, Callable[[], bytes]] = {
    **{f"v2_level_{level}": partial(at_level, level) for level in (1, 2, 3, 4)},
    **{f"v2_paper_{level}": partial(paper, level) for level in (1, 2, 3, 4)},
    "v2_archive": archive,
    "v2_archive_again": archive_again,
    "v2_rough": rough,
    "v2_vertices": by_vertex,
    "v2_world": in_the_world,
    "v2_weighed": weighed,
    "v2_crowded": crowded,
    "v2_plain": without_head,
    "v2_empty": empty,
}


def digests_of(data: bytes) -> dict[str, str]:
    """SHA-256 of every decoded array, with its type and shape."""
    avatar = decode(data)
    parts = {"gaussians": avatar.gaussians} | ({"motion": avatar.motion} if avatar.motion else {})
    digests = {}
    for part, value in parts.items():
        for field in fields(value):
            array = getattr(value, field.name)
            if isinstance(array, np.ndarray):
                text = f"{array.dtype} {array.shape}".encode()
                digests[f"{part}.{field.name}"] = hashlib.sha256(
                    text + np.ascontiguousarray(array).tobytes()
                ).hexdigest()
    return digests


def main(names: list[str]) -> None:
    """Write the named streams and their digests."""
    known = json.loads(DIGESTS.read_text()) if DIGESTS.is_file() else {}
    for name in STREAMS if names == ["all"] else names:
        data = STREAMS[name]()
        (FOLDER / f"{name}.sacha").write_bytes(data)
        known[name] = digests_of(data)
        sys.stdout.write(f"{name}: {len(data)} bytes\n")
    DIGESTS.write_text(json.dumps(known, indent=1, sort_keys=True) + "\n")


if __name__ == "__main__":
    main(sys.argv[1:])
