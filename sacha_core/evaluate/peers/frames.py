"""A sequence whose every frame is a set of splats of its own, without a head: by HEVC with and without prediction in time, and by G-PCC.

Source: SACHA, experiments: the routes that code each frame on its own.
"""

from __future__ import annotations

import struct
from collections.abc import Sequence

import numpy as np
from jaxtyping import Float

from sacha_core.avatar.gaussians import Gaussians
from sacha_core.evaluate.peers import gpcc
from sacha_core.evaluate.peers.attributes import (
    GROUPS,
    columns_of,
    dequantise,
    gaussians_of,
    quantise,
    range_bytes,
    range_of,
)
from sacha_core.evaluate.peers.bindings import pack, unpack
from sacha_core.evaluate.peers.grid import dealt, from_image, side_for, to_image, unrolled
from sacha_core.evaluate.peers.hevc_tables import TABLES
from sacha_core.evaluate.peers.peer import Ground, Setting
from sacha_core.evaluate.peers.video import DEPTH, decode_video, encode_video

__all__ = ["decode_pictures", "encode_pictures", "through_gpcc"]

PLACE_BITS = 12  # over the range of the whole sequence, without loss
SIZE = struct.Struct("<I")
HEAD = struct.Struct("<HBB")  # side of the picture, coefficients of harmonics beyond degree 0, frames


def encode_pictures(frames: Sequence[Gaussians], ground: Ground, table: str, row: int, inter: bool) -> bytes:
    """Code sets of splats in the world as videos, one for each group of attributes.

    Args:
        frames: one set a frame, which may differ in number; the encoder is free to choose their order.
        ground: tells the encoder, not the decoder, where a Gaussian belongs on the head, so that it finds a good order.
        table: of quantisations, see `hevc_tables.TABLES`.
        row: of it.
        inter: whether a frame may be predicted from the one before it.
    """
    _, _, *qps = TABLES[table][row]
    side = side_for(max(map(len, frames)))
    laid = [dealt(places_of(frame, ground), side) for frame in frames]
    orders = [np.argsort(cells) for cells in laid]
    taken = np.zeros((len(frames), side * side), bool)
    for mask, cells in zip(taken, laid, strict=True):
        mask[cells] = True
    masks = pack(np.packbits(taken, axis=1).tobytes())
    columns = [columns_of(frame) for frame in frames]
    data = HEAD.pack(side, frames[0].sh_rest.shape[1], len(frames)) + SIZE.pack(len(masks)) + masks
    for group, qp in zip(GROUPS, (None, *map(int, qps)), strict=True):
        if group not in columns[0]:
            continue
        n_bits = PLACE_BITS if qp is None else DEPTH
        values = [one[group][order] for one, order in zip(columns, orders, strict=True)]
        limits = range_of(np.concatenate(values))
        images = [
            to_image(quantise(value, limits, n_bits), np.flatnonzero(mask), side).reshape(-1, side)
            for value, mask in zip(values, taken, strict=True)
        ]
        coded = encode_video(images, qp, inter)
        data += range_bytes(limits) + SIZE.pack(len(coded)) + coded
    return data


def places_of(frame: Gaussians, ground: Ground) -> Float[np.ndarray, "n 2"]:
    """Give the place of each Gaussian in a plane: of its triangle on the unrolled head, or where it stands itself without one."""
    if ground.bound:
        return np.asarray(unrolled(ground.centroids)[frame.binding])
    return unrolled(frame.position.astype(np.float64))


def decode_pictures(data: bytes) -> list[Gaussians]:
    """Undo `encode_pictures`; the splats come in the order of the picture, bound to triangle 0."""
    side, n_rest, n_frames = HEAD.unpack_from(data)
    (n_packed,) = SIZE.unpack_from(data, HEAD.size)
    at = HEAD.size + SIZE.size
    bits = np.frombuffer(unpack(data[at : at + n_packed]), np.uint8).reshape(n_frames, -1)
    at += n_packed
    laid = [np.flatnonzero(np.unpackbits(mask, count=side * side)) for mask in bits]
    columns: list[dict[str, Float[np.ndarray, "n c"]]] = [{} for _ in range(n_frames)]
    for group, width in zip(GROUPS, (3, 1, 3, 3, 3, 3 * n_rest), strict=True):
        if not width:
            continue
        limits = np.frombuffer(data, "<f4", 2 * width, at).reshape(-1, 2).T.astype(np.float64)
        at += 8 * width
        (size,) = SIZE.unpack_from(data, at)
        at += SIZE.size
        pictures = decode_video(data[at : at + size])
        at += size
        n_bits = PLACE_BITS if group == "position" else DEPTH
        for one, picture, cells in zip(columns, pictures, laid, strict=True):
            one[group] = dequantise(from_image(picture.reshape(-1, side, side), cells), limits, n_bits)
    return [gaussians_of(one, np.zeros(len(cells), np.int32)) for one, cells in zip(columns, laid, strict=True)]


def through_gpcc(frames: Sequence[Gaussians], ground: Ground, rate: str) -> tuple[int, list[Gaussians]]:
    """Give the bytes that G-PCC takes for sets of splats in the world, bindings not counted, and what they decode to."""
    n_bytes, decoded = 0, []
    for frame in frames:
        parts = gpcc.encode(frame, ground, Setting(rate, "world", {"points": rate}))
        n_bytes += sum(len(part) for name, part in parts.items() if name != "bindings")
        decoded.append(gpcc.decode(parts, ground))
    return n_bytes, decoded
