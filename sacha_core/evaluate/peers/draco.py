"""Google's Draco through the package DracoPy: a point cloud whose points carry the attributes as integers, quantised beforehand.

Draco quantises only positions and what it knows as colours, normals and texture coordinates; others it takes as integers, so each group is
quantised to as many bits as the setting says, over one width for all columns of a group. There are two ways: the k-d tree, which reorders
points and codes every bit of a cell, with the triangle of each Gaussian among the attributes or apart, whichever takes less; and coding in
sequence, which keeps the order, so that triangles come as counts and columns as differences from one Gaussian to the next.

Source: Galligan, Hemmer, Stava, Zhang, Brettle, Google/Draco, 2018, by DracoPy.
"""

from __future__ import annotations

import importlib.util
import struct

import numpy as np
from jaxtyping import Int

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
from sacha_core.evaluate.peers.peer import TURNED, Domain, Ground, Parts, Peer, PeerError, Setting

__all__ = ["PEERS"]

BITS = {  # position, opacity, scale, rotation, colour, harmonic
    "r0": (8, 3, 4, 4, 4, 3), "r1": (9, 4, 5, 4, 5, 3), "r2": (10, 4, 5, 5, 5, 4), "r3": (10, 5, 6, 5, 6, 5),
    "r4": (11, 6, 7, 6, 7, 5), "r5": (12, 6, 7, 7, 7, 6), "r6": (12, 7, 8, 8, 8, 7), "r7": (14, 8, 9, 9, 9, 8),
}  # fmt: skip
WAYS = ("tree", "sequence")
LEVEL = 10  # of compression: 0 to 10
HEAD = struct.Struct("<IB6BB")  # Gaussians, columns of harmonics, bits of each group, way
Decoded = tuple[Int[np.ndarray, "n 3"], dict[int, Int[np.ndarray, "n c"]]]
NUMBER = {name: number for number, name in enumerate((*GROUPS, "copy"))}  # of attributes
TRIANGLES = len(NUMBER)  # the attribute that holds them


def lacking() -> str | None:
    """Say whether DracoPy is missing."""
    found = importlib.util.find_spec("DracoPy") is not None
    return None if found else "needs the package DracoPy: pip install 'sacha[peers]'"


def settings(few: bool, sh_degree: int) -> tuple[Setting, ...]:
    """Give a sweep of bits in the order-keeping way, where rotations are best, and some points of the other ways."""
    names = tuple(BITS)[1::2] if few else tuple(BITS)
    suiting: Domain = "mixed" if sh_degree else "world"
    title = {"world": "world", "mixed": TURNED}
    some: list[tuple[str, str, Domain]] = [(name, "sequence", suiting) for name in names]
    some += [(name, "sequence", "world" if sh_degree else "mixed") for name in names[1::2]]
    some += [(name, "tree", "world") for name in names[1::2]]
    return tuple(Setting(f"{name} {way}, {title[d]}", d, {"bits": name, "way": way}) for name, way, d in some)


def encode(splats: Gaussians, ground: Ground, setting: Setting) -> Parts:
    """Quantise and encode."""
    import DracoPy  # noqa: PLC0415 - a package that is not everybody's

    bits, way = BITS[str(setting.options["bits"])], WAYS.index(str(setting.options["way"]))
    columns = columns_of(splats)
    limits = {name: range_of(values) for name, values in columns.items()}
    levels = {name: quantise(values, limits[name], bits[NUMBER[name]]) for name, values in columns.items()}
    n_harmonic = levels["harmonic"].shape[1] if "harmonic" in levels else 0
    head = HEAD.pack(len(splats), n_harmonic, *bits, way) + b"".join(range_bytes(one) for one in limits.values())

    levels |= copies(levels)

    def draco(triangles: Int[np.ndarray, " n"] | None) -> bytes:
        extra = {} if triangles is None else {TRIANGLES: triangles.astype(np.uint16)[:, None]}
        return bytes(
            DracoPy.encode(
                levels["position"].astype(np.float32), quantization_bits=bits[0], quantization_range=float((1 << bits[0]) - 1),
                quantization_origin=np.zeros(3, np.float32), compression_level=LEVEL, preserve_order=bool(way),
                generic_attributes={NUMBER[k]: v.astype(np.uint16) for k, v in levels.items() if k != "position"} | extra,
            )
        )  # fmt: skip

    apart = draco(None)
    if way:
        return {"head": head, "attributes": apart, "bindings": encode_bindings(splats.binding, ground)}
    within = draco(ground.place[splats.binding]) if ground.bound and ground.head.n_faces <= 1 << 16 else None
    left = in_order_of(read(apart), levels, splats.binding) if ground.bound else splats.binding
    bindings = encode_bindings(left, ground)
    if within is not None and len(within) <= len(apart) + len(bindings):
        return {"head": head, "attributes": within}
    return {"head": head, "attributes": apart, "bindings": bindings}


def copies(levels: dict[str, Int[np.ndarray, "n c"]]) -> dict[str, Int[np.ndarray, "n 1"]]:
    """Number Gaussians that are the same in all: Draco would merge them. Nothing where there are none."""
    table = np.concatenate(list(levels.values()), axis=1)
    order = np.lexsort(table.T)
    fresh = np.append(True, (table[order][1:] != table[order][:-1]).any(axis=1))
    if fresh.all():
        return {}
    rank = np.arange(len(order)) - np.maximum.accumulate(np.where(fresh, np.arange(len(order)), 0))
    numbers = np.zeros((len(order), 1), np.int64)
    numbers[order, 0] = rank
    return {"copy": numbers}


def in_order_of(
    decoded: Decoded, levels: dict[str, Int[np.ndarray, "n c"]], binding: Int[np.ndarray, " n"]
) -> Int[np.ndarray, " n"]:
    """Give the triangles in the order that Draco left: that of points whose levels are all the same does not matter."""
    before = np.concatenate(list(levels.values()), axis=1)
    position, named = decoded
    after = np.concatenate([position, *(named[NUMBER[name]] for name in levels if name != "position")], axis=1)
    if len(after) != len(before):
        raise PeerError(f"Draco gave {len(after)} points of {len(before)}")
    found = np.empty_like(binding)
    found[np.lexsort(after.T)] = binding[np.lexsort(before.T)]
    return found


def read(data: bytes) -> Decoded:
    """Give positions and the other attributes of a Draco file."""
    import DracoPy  # noqa: PLC0415

    found = DracoPy.decode(data)
    named = {int(one["unique_id"]): np.asarray(one["data"], np.int64) for one in found.attributes}
    return np.rint(found.points).astype(np.int64), named


def decode(parts: Parts, ground: Ground) -> Gaussians:
    """Decode and undo the quantisation."""
    n, n_harmonic, *bits, _ = HEAD.unpack_from(parts["head"])
    position, named = read(parts["attributes"])
    columns = {}
    limits = np.frombuffer(parts["head"], "<f4", offset=HEAD.size).reshape(-1, 2).T.astype(np.float64)
    at = 0
    for group, width in zip(GROUPS, (3, 1, 3, 3, 3, n_harmonic), strict=True):
        if width:
            levels = position if group == "position" else named[NUMBER[group]]
            columns[group] = dequantise(levels, limits[:, at : at + width], bits[NUMBER[group]])
            at += width
    within = "bindings" not in parts
    binding = ground.order[named[TRIANGLES][:, 0]] if within else decode_bindings(parts["bindings"], ground)
    if len(position) != n:
        raise PeerError(f"Draco gave {len(position)} points of {n}")
    return gaussians_of(columns, binding)


PEERS = (Peer("draco", "Draco", lacking, settings, encode, decode),)
