"""Running a codec on an avatar in a process of its own, so that one that hangs or dies costs a row and not the run."""

from __future__ import annotations

import multiprocessing
import time
from concurrent.futures import ProcessPoolExecutor
from concurrent.futures import TimeoutError as Late
from concurrent.futures.process import BrokenProcessPool
from dataclasses import dataclass

from sacha_core.avatar.gaussians import Gaussians
from sacha_core.avatar.motion import Motion
from sacha_core.errors import SachaError
from sacha_core.evaluate.peers.peer import Ground, Parts, Peer, Setting, visible
from sacha_core.evaluate.peers.registry import find_peer
from sacha_core.flame.model import HeadModel

__all__ = ["Trial", "Trials", "try_codec"]

BINDINGS = "bindings"


@dataclass(frozen=True)
class Trial:
    """One avatar through one codec at one setting.

    Args:
        peer: name of the codec.
        setting: of it.
        parts: the bytes that a decoder needs, by what they are; empty where it failed.
        gaussians: decoded, bound, in triangle units; None where it failed.
        n_bytes: all bytes that describe the Gaussians.
        encode_s: seconds of wall time, tools that are started included.
        decode_s: likewise.
        failure: why there is no result; empty where there is one.
    """

    peer: str
    setting: Setting
    parts: Parts
    gaussians: Gaussians | None
    n_bytes: int
    encode_s: float
    decode_s: float
    failure: str = ""


def try_codec(
    name: str, gaussians: Gaussians, head: HeadModel, setting: Setting, motion: Motion | None = None, bound: bool = True
) -> Trial:
    """Encode and decode.

    Args:
        name: of the codec.
        gaussians: bound, in triangle units.
        head: that they are bound to.
        setting: of the codec.
        motion: of the avatar, for encoders that look at it.
        bound: whether the Gaussians belong to the head; else they stand in the world.

    Raises:
        SachaError: the codec failed, or gave back another avatar.
    """
    peer, ground = find_peer(name), Ground(head, motion, bound)
    chosen = gaussians if peer.lossless else visible(gaussians)
    given = chosen if peer.own_order else ground.to_domain(chosen, setting.domain)
    _ = ground.place if bound else None  # known beforehand, not part of the times
    begun = time.perf_counter()
    parts = peer.encode(given, ground, setting)
    coded = time.perf_counter()
    decoded = peer.decode(parts, ground)
    done = time.perf_counter()
    canonical = ground.from_domain(decoded, setting.domain)
    canonical.validate(head.n_faces)
    return Trial(name, setting, parts, canonical, peer.count(parts), coded - begun, done - coded)


class Trials:
    """Runs codecs one after the other in a process beside this one, which is ended where it takes too long.

    Args:
        head: that all avatars are bound to.
        motion: of the avatars, for encoders that look at it.
        bound: whether the Gaussians belong to the head; else they stand in the world.
    """

    def __init__(self, head: HeadModel, motion: Motion | None = None, bound: bool = True) -> None:
        self._head, self._motion, self._bound = head, motion, bound
        self._pool: ProcessPoolExecutor | None = None

    def __call__(self, peer: Peer, gaussians: Gaussians, setting: Setting) -> Trial:
        """Run one codec at one setting; what goes wrong is told in the result."""
        self._pool = self._pool or ProcessPoolExecutor(1, multiprocessing.get_context("spawn"))
        try:
            given = (peer.name, gaussians, self._head, setting, self._motion, self._bound)
            return self._pool.submit(try_codec, *given).result(peer.limit_s)
        except Late:
            failure = f"took more than {peer.limit_s:.0f} s"
            self.end()
        except BrokenProcessPool:
            failure = "its process died"
            self.end()
        except (SachaError, OSError, ValueError, RuntimeError, ArithmeticError, LookupError, TypeError) as error:
            failure = f"{type(error).__name__}: {' '.join(str(error).split())}"[:300]
        return Trial(peer.name, setting, {}, None, 0, 0.0, 0.0, failure)

    def end(self) -> None:
        """End the process, whatever it does."""
        pool, self._pool = self._pool, None
        if pool is None:
            return
        for process in list((pool._processes or {}).values()):  # no public way ends one that hangs
            process.kill()
        pool.shutdown(wait=True, cancel_futures=True)
