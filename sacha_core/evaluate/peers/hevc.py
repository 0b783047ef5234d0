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
from sacha_core.evaluate.peers.frames import decode_pictures, encode_pictures
from sacha_core.evaluate.peers.grid import from_image, grid_of, to_image
from sacha_core.evaluate.peers.hevc_tables import AWAY, TABLES, WHOLE
from sacha_core.evaluate.peers.peer import TURNED, Domain, Ground, Parts, Peer, Setting
from sacha_core.evaluate.peers.video import DEPTH, decode_video, encode_video, lacking

__all__ = ["PEERS"]

HEAD = struct.Struct("<BBB")  # how places are coded, their bits, coefficients of harmonics beyond degree 0
SIZE = struct.Struct("<I")
SCENE = "scene"  # the part that holds splats without a head


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
    named = {"world": "world", "mixed": TURNED}
    return tuple(Setting(f"{table} {k + 1}, {named[d]}", d, {"table": table, "row": k}) for table, k, d in chosen)


def encode(splats: Gaussians, ground: Ground, setting: Setting) -> Parts:
    """Lay out, quantise, code each group as one tall picture; without a head as a sequence of one frame is coded."""
    table, row = str(setting.options["table"]), int(setting.options["row"])
    if not ground.bound:
        return {SCENE: encode_pictures([splats], ground, table, row, inter=False)}
    how, fineness, *qps = TABLES[table][row]
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
    if SCENE in parts:
        return decode_pictures(parts[SCENE])[0]
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
