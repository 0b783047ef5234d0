"""The golden streams: files of published versions that must decode to the same bits for ever.

`python tests/codec/golden_streams.py NAME ...` writes the named ones anew, deliberately: only for a stream that was never published, or
with a new major version of the format and a line in CHANGELOG. A test run never writes them.
"""

from __future__ import annotations

import hashlib
import json
import sys
from collections.abc import Callable
from dataclasses import fields
from pathlib import Path

import numpy as np
from synthetic_avatars import random_avatar, small_head

from sacha_core.avatar.avatar import Avatar
from sacha_core.codec import decode, encode

FOLDER = Path(__file__).parents[1] / "golden"
DIGESTS = FOLDER / "digests.json"


def bound_to_a_head() -> bytes:
    """Everything at once: head inside, all harmonics, offsets, several groups of motion."""
    head = small_head()
    avatar = random_avatar(90, n_frames=14, n_harmonics=15, seed=1, head=head)
    return encode(avatar, 2, head=head, embed_head=True, group_frames=5)


def without_head() -> bytes:
    """No head, no motion, no harmonics."""
    avatar = random_avatar(150, n_harmonics=0, seed=2)
    return encode(Avatar(avatar.gaussians, avatar.head), 4)


def empty() -> bytes:
    """No Gaussians, and a motion of no frames."""
    return encode(random_avatar(0, n_frames=0, seed=3), 1)


STREAMS: dict[str, Callable[[], bytes]] = {
    "v1_head_motion": bound_to_a_head,
    "v1_plain": without_head,
    "v1_empty": empty,
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
    for name in names:
        data = STREAMS[name]()
        (FOLDER / f"{name}.sacha").write_bytes(data)
        known[name] = digests_of(data)
        sys.stdout.write(f"{name}: {len(data)} bytes\n")
    DIGESTS.write_text(json.dumps(known, indent=1, sort_keys=True) + "\n")


if __name__ == "__main__":
    main(sys.argv[1:])
