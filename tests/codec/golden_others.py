"""Golden streams beside the files that decode alone: packets, and files of the paper's profile whose points an external program coded.

`python tests/codec/golden_others.py NAME ...` (or `all`) writes the named ones anew, deliberately, as `golden_streams.py` does. The
external programs are stand-ins (`fake_tmc3.py`): what is held is this project's part, the mapping, the sections and the order of rows.
"""

from __future__ import annotations

import hashlib
import json
import os
import struct
import sys
import tempfile
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import fields
from functools import partial
from pathlib import Path

import numpy as np
from golden_streams import FOLDER, digests_of
from synthetic_avatars import random_avatar, random_gaussians, small_head, smooth_avatar
from tool_stand_in import executable

import sacha_core
from sacha_core.avatar.avatar import Avatar
from sacha_core.codec import encode_paper
from sacha_core.codec.paper_tool import TOOL_VARIABLE

DIGESTS = FOLDER / "digests_others.json"
Digests = dict[str, str]


def packets() -> bytes:
    """An avatar with its head inside, and three groups of frames, the last one short: each packet after its length."""
    head = small_head()
    avatar = smooth_avatar(60, head, n_frames=13, n_harmonics=3, seed=11)
    made = sacha_core.Encoder(avatar, 2, head=head, embed_head=True, group_frames=5).packets()
    return b"".join(struct.pack("<I", len(packet)) + packet for packet in made)


def split(stored: bytes) -> Iterator[bytes]:
    """Give the packets."""
    at = 0
    while at < len(stored):
        (length,) = struct.unpack_from("<I", stored, at)
        yield stored[at + 4 : at + 4 + length]
        at += 4 + length


def digests_of_packets(stored: bytes) -> Digests:
    """SHA-256 of every array of the avatar, and of the frames of each group, when the groups come last first."""
    first, *groups = split(stored)
    decoder, digests = sacha_core.Decoder(), Digests()
    heard = [received for packet in (first, *reversed(groups)) for received in decoder.feed(packet)]
    for received in heard[1:]:
        for field in fields(received.frames):
            array = getattr(received.frames, field.name)
            if isinstance(array, np.ndarray):
                digests[f"{received.number}.{field.name}"] = digest(array)
    for field in fields(decoder.avatar.gaussians):
        array = getattr(decoder.avatar.gaussians, field.name)
        if isinstance(array, np.ndarray):
            digests[f"gaussians.{field.name}"] = digest(array)
    return digests


def digest(array: np.ndarray) -> str:
    """SHA-256 of an array with its type and shape."""
    return hashlib.sha256(f"{array.dtype} {array.shape}".encode() + np.ascontiguousarray(array).tobytes()).hexdigest()


def by_program(name: str) -> bytes:
    """Places that many share, coded by an external program."""
    gaussians = random_gaussians(70, 12, 3, seed=12)
    gaussians.position[::3] = gaussians.position[0]
    avatar = Avatar(gaussians, random_avatar(1).head)
    with program(name) as path:
        return encode_paper(avatar, 2, tmc3=path)


@contextmanager
def program(name: str) -> Iterator[Path]:
    """Give the stand-in as the external program, and name it to decoders."""
    before = os.environ.get(TOOL_VARIABLE)
    with tempfile.TemporaryDirectory() as folder:
        path = executable(Path(folder) / name)
        os.environ[TOOL_VARIABLE] = str(path)
        try:
            yield path
        finally:
            os.environ.pop(TOOL_VARIABLE)
            if before is not None:
                os.environ[TOOL_VARIABLE] = before


def digests_with(name: str, data: bytes) -> Digests:
    """SHA-256 of every array that is decoded with the program of that name."""
    with program(name):
        return digests_of(data)


STREAMS: dict[str, tuple[Callable[[], bytes], Callable[[bytes], Digests]]] = {
    "v2_packets.packets": (packets, digests_of_packets),
    "v2_paper_tool.tmc3": (partial(by_program, "tmc3"), partial(digests_with, "tmc3")),
    "v2_paper_tool.ges-tm": (partial(by_program, "ges-tm"), partial(digests_with, "ges-tm")),
}


def main(names: list[str]) -> None:
    """Write the named streams and their digests."""
    known = json.loads(DIGESTS.read_text()) if DIGESTS.is_file() else {}
    for name in STREAMS if names == ["all"] else names:
        make, digests = STREAMS[name]
        data = make()
        (FOLDER / name).write_bytes(data)
        known[name] = digests(data)
        sys.stdout.write(f"{name}: {len(data)} bytes\n")
    DIGESTS.write_text(json.dumps(known, indent=1, sort_keys=True) + "\n")


if __name__ == "__main__":
    main(sys.argv[1:])
