"""Compressed PLY, SPZ and SOG, by PlayCanvas' splat-transform.

These formats carry no bindings, and some reorder Gaussians by a curve through their places. In which order they leave them is found by a
probe: the same places and sizes, coloured by number. Times include starting Node twice over, once for each direction, but not the probe,
which an encoder that knew its own order would not need. With harmonics, points with fewer degrees of them are measured, too.

SPZ holds places as multiples of 1/4096 and sizes from exp(-10) up, meant for scenes of rooms: in metres a head is too small for it, so it
is enlarged by the setting's factor first.

Source: PlayCanvas, splat-transform (npm @playcanvas/splat-transform); Niantic, SPZ; PlayCanvas, SOG and compressed PLY.
"""

from __future__ import annotations

import struct
import tempfile
from collections.abc import Callable
from dataclasses import replace
from functools import partial
from pathlib import Path

import numpy as np
from jaxtyping import Int

from sacha_core.avatar.gaussians import Gaussians
from sacha_core.evaluate.peers.bindings import decode_bindings, encode_bindings
from sacha_core.evaluate.peers.peer import Ground, Parts, Peer, PeerError, Setting, enlarged
from sacha_core.interchange.splat_ply import read_world_ply, write_world_ply
from sacha_core.programs import find_program, run_program

__all__ = ["PACKAGE", "PEERS", "VARIABLE"]

PACKAGE = "@playcanvas/splat-transform@3.7.0"
VARIABLE = "SACHA_SPLAT_TRANSFORM"
PROGRAM = "splat-transform"
DC = 0.28209479177387814  # harmonic of degree 0
DIGIT_BITS, DIGITS = 6, 3  # of the number that a probe's colour holds
FACTORS = (16, 64)
ENDLESS = np.float32(1e4)  # no float of a head is as large
HEAD = struct.Struct("<f")  # factor that places and sizes were multiplied by


def lacking() -> str | None:
    """Say whether the program is missing.

    Raises:
        OptionError: the variable names something that is no file.
    """
    if find_program(VARIABLE, PROGRAM) is not None:
        return None
    return f"needs the program {PROGRAM}: `make peers` (npm install {PACKAGE}), then put it on PATH or name it in {VARIABLE}"


def settings(suffix: str, few: bool, sh_degree: int) -> tuple[Setting, ...]:
    """Give both domains, and in the better one, which is the world, fewer degrees of harmonics."""
    factors = FACTORS if suffix == ".spz" else (1,)
    named = {factor: "world" if factor == 1 else f"world x{factor}" for factor in factors}
    full = [Setting(named[f], "world", {"factor": f, "degree": sh_degree}) for f in factors]
    less = [
        Setting(f"{named[factors[-1]]}, degree {degree}", "world", {"factor": factors[-1], "degree": degree})
        for degree in (() if few else range(sh_degree))
    ]
    return (*full, Setting("local", "local", {"factor": 1, "degree": sh_degree}), *less)


def encode(suffix: str, splats: Gaussians, ground: Ground, setting: Setting) -> Parts:
    """Convert, and code the bindings in the order that the format leaves."""
    factor, degree = float(setting.options["factor"]), int(setting.options["degree"])
    splats = replace(splats, sh_rest=splats.sh_rest[:, : (degree + 1) ** 2 - 1])
    order = order_after(suffix, splats, factor) if ground.bound else np.arange(len(splats))
    data = converted(splats, factor, suffix)
    return {"head": HEAD.pack(factor), "file": data, "bindings": encode_bindings(splats.binding[order], ground)}


def decode(suffix: str, parts: Parts, ground: Ground) -> Gaussians:
    """Convert back and hand out the bindings."""
    (factor,) = HEAD.unpack(parts["head"])
    read = reverted(parts["file"], suffix)
    binding = decode_bindings(parts["bindings"], ground)
    if len(read) != len(binding):
        raise PeerError(f"{PROGRAM} gave {len(read)} Gaussians of {len(binding)}")
    return replace(enlarged(read, 1 / factor), binding=binding)


def converted(splats: Gaussians, factor: float, suffix: str) -> bytes:
    """Give the file that the program makes of Gaussians."""
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        write_world_ply(folder / "in.ply", enlarged(splats, factor), splats.sh_degree)
        transform(folder, "in.ply", f"out{suffix}")
        return (folder / f"out{suffix}").read_bytes()


def reverted(data: bytes, suffix: str) -> Gaussians:
    """Read such a file through the program."""
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        (folder / f"in{suffix}").write_bytes(data)
        transform(folder, f"in{suffix}", "out.ply")
        tame(folder / "out.ply")
        return read_world_ply(folder / "out.ply")


def tame(path: Path) -> None:
    """Put a large number in the place of logits without end, which are how the program gives an opacity of 8 bits that is 0 or 255."""
    header, end, body = path.read_bytes().partition(b"end_header\n")
    values = np.frombuffer(body, "<f4")
    path.write_bytes(header + end + np.clip(values, -ENDLESS, ENDLESS).tobytes())


def transform(folder: Path, source: str, target: str) -> None:
    """Run the program on the processor alone.

    Raises:
        PeerError: it is missing.
        ProgramError: it failed.
    """
    program = find_program(VARIABLE, PROGRAM)
    if program is None:
        raise PeerError(lacking() or "")
    run_program([program, "-w", "-q", "-g", "cpu", source, target], folder)


def order_after(suffix: str, splats: Gaussians, factor: float) -> Int[np.ndarray, " n"]:
    """Tell which Gaussian stands at each place of the file.

    Raises:
        PeerError: there are more than a colour can number, or numbers came back wrong.
    """
    n = len(splats)
    if n > 1 << (DIGIT_BITS * DIGITS):
        raise PeerError(f"{n} Gaussians are more than a probe can number")
    digits = (np.arange(n)[:, None] >> (DIGIT_BITS * np.arange(DIGITS))) & ((1 << DIGIT_BITS) - 1)
    colour = (digits + 0.5) / (1 << DIGIT_BITS)
    none = np.zeros((n, 0, 3), np.float32)
    probe = replace(splats, sh_dc=((colour - 0.5) / DC).astype(np.float32), sh_rest=none)
    back = reverted(converted(probe, factor, suffix), suffix)
    read = np.floor((back.sh_dc * DC + 0.5) * (1 << DIGIT_BITS)).astype(np.int64)
    order = (read << (DIGIT_BITS * np.arange(DIGITS))).sum(axis=1)
    if not np.array_equal(np.sort(order), np.arange(n)):
        raise PeerError(
            f"the order that {PROGRAM} left cannot be told: {len(np.unique(order))} numbers of {n} came back"
        )
    return np.asarray(order)


def peer(name: str, title: str, suffix: str) -> Peer:
    """Give the codec of one format."""
    some: Callable[[bool, int], tuple[Setting, ...]] = partial(settings, suffix)
    return Peer(name, title, lacking, some, partial(encode, suffix), partial(decode, suffix))


PEERS = (
    peer("cply", "compressed PLY", ".compressed.ply"),
    peer("spz", "SPZ", ".spz"),
    peer("sog", "SOG", ".sog"),
)
