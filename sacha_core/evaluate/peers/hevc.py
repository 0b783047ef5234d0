"""The route by video: attributes as pictures of 12 bits, coded by HEVC (libx265).

Gaussians are dealt to a square by where their triangles lie on the unrolled head; bindings are counts a triangle, from which the layout
follows. Places are either whole, quantised to so many bits and coded without loss, or their differences to the centres of their triangles,
coded with loss as all others are. Quantisations are spread by render error: one table found on an avatar of degree 0 with many small
Gaussians (`dense`), one on trained avatars of degree 3 (`trained`).

Source: own; video codecs on sorted attributes are what MPEG's video-based routes and Morgenstern et al., ECCV 2024, have in common.
"""

from __future__ import annotations

import struct

import numpy as np
from jaxtyping import Float, Int

from sacha_core.avatar.gaussians import Gaussians
from sacha_core.evaluate.peers.attributes import (
    GROUPS,
    columns_of,
    dequantise,
    gaussians_of,
    quantise,
    range_bytes,
    range_of,
)
from sacha_core.evaluate.peers.bindings import decode_bindings, encode_bindings
from sacha_core.evaluate.peers.grid import from_image, grid_of, to_image
from sacha_core.evaluate.peers.peer import Domain, Ground, Parts, Peer, Setting
from sacha_core.evaluate.peers.video import DEPTH, decode_video, encode_video, lacking

__all__ = ["PEERS", "TABLES"]

WHOLE, AWAY = "whole", "away"
# how places are coded, with bits or quantisation; then quantisation of opacity, scale, rotation, colour, harmonics
TABLES = {
    "dense": (
        (AWAY, 9, 33, 26, 33, 32, 38), (AWAY, 4, 29, 22, 28, 29, 35), (AWAY, 1, 26, 19, 25, 26, 33), (AWAY, 0, 24, 15, 21, 22, 31),
        (WHOLE, 11, 21, 12, 16, 19, 29), (WHOLE, 11, 17, 9, 13, 15, 26), (WHOLE, 12, 14, 6, 12, 10, 22),
    ),
    "trained": (
        (AWAY, 14, 36, 27, 29, 27, 38), (AWAY, 10, 35, 24, 26, 23, 35), (AWAY, 6, 31, 20, 21, 20, 32), (AWAY, 4, 29, 17, 18, 17, 30),
        (AWAY, 1, 25, 14, 15, 13, 28), (AWAY, 0, 22, 11, 11, 9, 25), (AWAY, 0, 18, 8, 8, 6, 22), (WHOLE, 12, 16, 6, 5, 3, 18),
    ),
}  # fmt: skip
HEAD = struct.Struct("<BBB")  # how places are coded, their bits, coefficients of harmonics beyond degree 0
SIZE = struct.Struct("<I")


def settings(few: bool, sh_degree: int) -> tuple[Setting, ...]:
    """Give the tables; the one that suits the degree in full."""
    first, second = ("trained", "dense") if sh_degree else ("dense", "trained")
    suiting: Domain = "mixed" if sh_degree else "world"
    chosen: list[tuple[str, int, Domain]] = [(first, k, suiting) for k in range(len(TABLES[first]))]
    if few:
        chosen = chosen[1::2]
    else:
        chosen += [(first, k, "world" if sh_degree else "mixed") for k in range(1, len(TABLES[first]), 2)]
        chosen += [(second, k, suiting) for k in range(1, len(TABLES[second]), 2)]
    named = {"world": "world", "mixed": "rotations by triangle"}
    return tuple(Setting(f"{table} {k + 1}, {named[d]}", d, {"table": table, "row": k}) for table, k, d in chosen)


def encode(splats: Gaussians, ground: Ground, setting: Setting) -> Parts:
    """Lay out, quantise, code each group as one tall picture."""
    how, fineness, *qps = TABLES[str(setting.options["table"])][int(setting.options["row"])]
    columns = columns_of(splats)
    if how == AWAY:
        columns["position"] = columns["position"] - ground.centroids[splats.binding]
    cells, side = grid_of(splats.binding, ground)
    head = HEAD.pack(how == WHOLE, int(fineness) if how == WHOLE else DEPTH, splats.sh_rest.shape[1])
    streams = b""
    for group, qp in zip(GROUPS, (None if how == WHOLE else int(fineness), *map(int, qps)), strict=True):
        if group in columns:
            n_bits = int(fineness) if qp is None else DEPTH
            limits = range_of(columns[group])
            head += range_bytes(limits)
            image = to_image(quantise(columns[group], limits, n_bits), cells, side)
            data = encode_video([image.reshape(-1, side)], qp)
            streams += SIZE.pack(len(data)) + data
    return {"head": head, "streams": streams, "bindings": encode_bindings(splats.binding, ground)}


def decode(parts: Parts, ground: Ground) -> Gaussians:
    """Decode the pictures and take the Gaussians from their cells."""
    whole, n_bits, n_rest = HEAD.unpack_from(parts["head"])
    limits = np.frombuffer(parts["head"], "<f4", offset=HEAD.size).reshape(-1, 2).T.astype(np.float64)
    binding = decode_bindings(parts["bindings"], ground)
    cells, side = grid_of(binding, ground)
    columns: dict[str, Float[np.ndarray, "n c"]] = {}
    at = begin = 0
    for group, width in zip(GROUPS, (3, 1, 3, 3, 3, 3 * n_rest), strict=True):
        if width:
            (size,) = SIZE.unpack_from(parts["streams"], begin)
            begin += SIZE.size
            (picture,) = decode_video(parts["streams"][begin : begin + size])
            begin += size
            levels: Int[np.ndarray, "n c"] = from_image(picture.reshape(-1, side, side), cells)
            depth = n_bits if group == "position" else DEPTH
            columns[group] = dequantise(levels, limits[:, at : at + width], depth)
            at += width
    if not whole:
        columns["position"] = columns["position"] + ground.centroids[binding]
    return gaussians_of(columns, binding)


PEERS = (Peer("hevc", "HEVC pictures", lacking, settings, encode, decode),)
