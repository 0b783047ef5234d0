"""Our own codec by its levels, through the same door as the others: no picture is rendered for it."""

from __future__ import annotations

from sacha_core.avatar.avatar import Avatar
from sacha_core.avatar.gaussians import Gaussians
from sacha_core.codec import decode as decode_sacha
from sacha_core.codec import encode as encode_sacha
from sacha_core.codec.levels import level_at
from sacha_core.evaluate.peers.lossless import nothing
from sacha_core.evaluate.peers.peer import Ground, Parts, Peer, Setting

__all__ = ["NAME", "PEERS"]

NAME = "sacha"
LEVELS = (0, 1, 2, 3, 4, 5, 6)


def settings(few: bool, sh_degree: int) -> tuple[Setting, ...]:  # noqa: ARG001
    """Give the four levels, and some beyond them, for pictures as coarse or as fine as others make them."""
    return tuple(Setting(f"level {level}", "local", {"level": level}) for level in LEVELS)


def encode(splats: Gaussians, ground: Ground, setting: Setting) -> Parts:
    """Encode without a motion."""
    avatar = Avatar(splats, ground.head.reference)
    return {"file": encode_sacha(avatar, level_at(float(setting.options["level"])), head=ground.head)}


def decode(parts: Parts, ground: Ground) -> Gaussians:
    """Decode."""
    return decode_sacha(parts["file"], head=ground.head).gaussians


PEERS = (Peer(NAME, "SACHA", nothing, settings, encode, decode),)
