"""The PLY itself, and what general compressors make of it."""

from __future__ import annotations

import importlib
import importlib.util
import lzma
import tempfile
from collections.abc import Callable
from pathlib import Path
from typing import Any

from sacha_core.avatar.gaussians import Gaussians
from sacha_core.evaluate.peers.peer import Ground, Parts, Peer, Setting
from sacha_core.interchange.splat_ply import read_bound_ply, read_world_ply, write_bound_ply, write_world_ply

__all__ = ["PEERS"]

ZSTD_LEVEL = 19
ZSTD_MODULES = ("compression.zstd", "zstandard")  # Python's own from 3.14 on, and the package


def encoder(squeeze: Callable[[bytes], bytes]) -> Callable[[Gaussians, Ground, Setting], Parts]:
    """Give what writes GaussianAvatars' PLY, with coefficients of the avatar's own degree only, and compresses it."""

    def encode(splats: Gaussians, ground: Ground, setting: Setting) -> Parts:  # noqa: ARG001
        with tempfile.TemporaryDirectory() as folder:
            path = Path(folder) / "avatar.ply"
            write = write_bound_ply if ground.bound else write_world_ply
            write(path, splats, splats.sh_degree)
            return {"file": squeeze(path.read_bytes())}

    return encode


def decoder(expand: Callable[[bytes], bytes]) -> Callable[[Parts, Ground], Gaussians]:
    """Give what expands the PLY and reads it."""

    def decode(parts: Parts, ground: Ground) -> Gaussians:
        with tempfile.TemporaryDirectory() as folder:
            path = Path(folder) / "avatar.ply"
            path.write_bytes(expand(parts["file"]))
            return read_bound_ply(path, ground.head.n_faces) if ground.bound else read_world_ply(path)

    return decode


def as_it_is(few: bool, sh_degree: int) -> tuple[Setting, ...]:  # noqa: ARG001
    """Give the one setting there is."""
    return (Setting("lossless", "local"),)


def nothing() -> None:
    """Say that nothing is missing."""


def zstandard() -> Any:
    """Give a module with Zstandard; None where there is none."""
    for name in ZSTD_MODULES:
        if importlib.util.find_spec(name.partition(".")[0]) is not None:
            try:
                return importlib.import_module(name)
            except ModuleNotFoundError:  # a package `compression` without it
                continue
    return None


def zstandard_lacks() -> str | None:
    """Say whether Zstandard is missing."""
    return None if zstandard() else "needs Python 3.14 or the package zstandard: pip install 'sacha[peers]'"


def xz(data: bytes) -> bytes:
    """Compress by LZMA, as far as it goes."""
    return lzma.compress(data, preset=9 | lzma.PRESET_EXTREME)


def zstd(data: bytes) -> bytes:
    """Compress by Zstandard."""
    return bytes(zstandard().compress(data, ZSTD_LEVEL))


def unzstd(data: bytes) -> bytes:
    """Undo `zstd`."""
    return bytes(zstandard().decompress(data))


PEERS = (
    Peer("ply", "PLY", nothing, as_it_is, encoder(bytes), decoder(bytes), lossless=True),
    Peer("zstd", f"zstd -{ZSTD_LEVEL} of the PLY", zstandard_lacks, as_it_is, encoder(zstd), decoder(unzstd), lossless=True),
    Peer("xz", "xz -9e of the PLY", nothing, as_it_is, encoder(xz), decoder(lzma.decompress), lossless=True),
)  # fmt: skip
