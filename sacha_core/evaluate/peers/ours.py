"""Our own codec by its levels, through the same door as the others: by rules, by what rendering tells, or with fewer Gaussians, fitted.

Source: own.
"""

from __future__ import annotations

from collections.abc import Callable
from functools import partial

from sacha_core.avatar.avatar import Avatar
from sacha_core.avatar.gaussians import Gaussians
from sacha_core.codec import decode as decode_sacha
from sacha_core.codec import encode as encode_sacha
from sacha_core.codec import inspect
from sacha_core.codec.levels import level_at
from sacha_core.evaluate.peers.lossless import nothing
from sacha_core.evaluate.peers.peer import Ground, Parts, Peer, Setting
from sacha_core.rate.encoding import encode_by_rendering
from sacha_core.rate.tuned import encode_tuned

__all__ = ["FITTED", "NAME", "PEERS", "RULES"]

NAME, RULES, FITTED = "sacha", "sacha-rules", "sacha-fitted"
LEVELS = (0, 1, 2, 3, 4, 5, 6)
FITTED_LEVELS = (0, 1, 2, 3, 4)  # a minute or more each, and finer ones are what they are without fitting


def settings(few: bool, sh_degree: int) -> tuple[Setting, ...]:  # noqa: ARG001
    """Give the four levels, and some beyond them, for pictures as coarse or as fine as others make them."""
    return tuple(Setting(f"level {level}", "local", {"level": level}) for level in LEVELS)


def fitted_settings(few: bool, sh_degree: int) -> tuple[Setting, ...]:  # noqa: ARG001
    """Give levels whose quality is to be met; none where there is little time."""
    return () if few else tuple(Setting(f"as level {level}", "local", {"level": level}) for level in FITTED_LEVELS)


def encode(looking: Callable[..., bytes] | None, splats: Gaussians, ground: Ground, setting: Setting) -> Parts:
    """Encode; `looking`: by what looks at the avatar in its motion, which then goes into the file, too."""
    head, level = ground.head, level_at(float(setting.options["level"]))
    if looking is not None:
        return {"file": looking(Avatar(splats, head.reference, ground.motion), level, head=head)}
    return {"file": encode_sacha(Avatar(splats, head.reference), level, head=head)}


def decode(parts: Parts, ground: Ground) -> Gaussians:
    """Decode."""
    return decode_sacha(parts["file"], head=ground.head).gaussians


def count(parts: Parts) -> int:
    """Give the bytes of the Gaussians, header and tables included."""
    return inspect(parts["file"]).gaussian_bytes


PEERS = (
    Peer(
        NAME,
        "SACHA",
        nothing,
        settings,
        partial(encode, encode_by_rendering),
        decode,
        count=count,
        needs_head=True,
        own_order=True,
    ),
    Peer(
        FITTED,
        "SACHA, fewer Gaussians fitted",
        nothing,
        fitted_settings,
        partial(encode, encode_tuned),
        decode,
        count=count,
        limit_s=900.0,
        needs_head=True,
        own_order=True,
    ),
    Peer(
        RULES,
        "SACHA without rendering",
        nothing,
        settings,
        partial(encode, None),
        decode,
        needs_head=True,
        own_order=True,
    ),
)
