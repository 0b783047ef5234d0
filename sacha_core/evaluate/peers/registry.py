"""The codecs there are."""

from __future__ import annotations

from sacha_core.errors import OptionError
from sacha_core.evaluate.peers import draco, gpcc, hevc, lossless, ours, paper, splat_transform
from sacha_core.evaluate.peers.peer import Peer

__all__ = ["PEERS", "find_peer"]

MODULES = (ours, paper, lossless, draco, splat_transform, gpcc, hevc)
PEERS: dict[str, Peer] = {peer.name: peer for module in MODULES for peer in module.PEERS}


def find_peer(name: str) -> Peer:
    """Give a codec by name.

    Raises:
        OptionError: there is none of that name.
    """
    if name not in PEERS:
        raise OptionError(f"there is no codec {name!r}; expected one of {', '.join(PEERS)}")
    return PEERS[name]
