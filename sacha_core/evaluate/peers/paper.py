"""The SACHA paper's own route, as our format's profile `paper` has it with our own coder of points: JEE6.2's mapping and rates.

In the world, where metres would fall on too few steps of JEE6.2's fixed grid, places and sizes are multiplied first.

Source: the SACHA paper, section on compression.
"""

from __future__ import annotations

import struct

from sacha_core.avatar.avatar import Avatar
from sacha_core.avatar.gaussians import Gaussians
from sacha_core.codec import decode as decode_sacha
from sacha_core.codec.paper_encoder import encode_paper
from sacha_core.evaluate.peers.gpcc_points import WORLD_FACTOR
from sacha_core.evaluate.peers.lossless import nothing
from sacha_core.evaluate.peers.peer import Ground, Parts, Peer, Setting, enlarged

__all__ = ["PEERS"]

FACTOR = struct.Struct("<f")
RATES = (1, 2, 3, 4)


def settings(few: bool, sh_degree: int) -> tuple[Setting, ...]:  # noqa: ARG001
    """Give the four rates in both domains."""
    factors = {"local": 1.0, "world": WORLD_FACTOR}
    return tuple(
        Setting(f"r0{rate}, {domain}", domain, {"rate": rate, "factor": factor})  # type: ignore[arg-type]
        for domain, factor in factors.items()
        for rate in RATES
    )


def encode(splats: Gaussians, ground: Ground, setting: Setting) -> Parts:
    """Encode without a motion."""
    factor = float(setting.options["factor"])
    avatar = Avatar(enlarged(splats, factor), ground.head.reference)
    return {"file": encode_paper(avatar, int(setting.options["rate"])), "factor": FACTOR.pack(factor)}


def decode(parts: Parts, ground: Ground) -> Gaussians:  # noqa: ARG001
    """Decode."""
    (factor,) = FACTOR.unpack(parts["factor"])
    return enlarged(decode_sacha(parts["file"]).gaussians, 1 / factor)


PEERS = (Peer("paper", "the paper's profile", nothing, settings, encode, decode, needs_head=True),)
