"""MPEG's G-PCC by its public test model, tmc3: octree, and RAHT of every attribute column at a quantisation of its own.

The splat software of JEE6.2 (GeS-TM) is not public; tmc3 reads no splats, so each column goes through a pass of its own as a reflectance of
12 bits (fitted: 10) over the same geometry, and the geometry, equal in all, is counted once. `r01` to `r04` are JEE6.2's mapping and
quantisation; the fitted ones have positions of fewer bits, ranges fitted to the avatar and quantisations spread by render error. Points
that fall on one place are moved to the next free one, since the test model would mix their attributes. Bindings follow the points' Morton
order, which a decoder has.

Source: ISO/IEC 23090-9 and its test model TMC13; method of the JEE6.2 anchors: MPEG m69429, by way of UniGSC's configuration.
"""

from __future__ import annotations

import io
import struct
import tempfile
from collections.abc import Iterator
from pathlib import Path

import numpy as np
from jaxtyping import Float, Int

from sacha_core.avatar.gaussians import Gaussians
from sacha_core.codec.paper_tool import TMC13, TOOL_VARIABLE
from sacha_core.evaluate.peers import gpcc_points as points
from sacha_core.evaluate.peers.bindings import decode_bindings, encode_bindings
from sacha_core.evaluate.peers.peer import TURNED, Domain, Ground, Parts, Peer, PeerError, Setting
from sacha_core.programs import find_program, run_program

__all__ = ["PEERS", "PROGRAM", "VARIABLE"]

PROGRAM, VARIABLE = TMC13, TOOL_VARIABLE
LARGEST_QP = 51  # that tmc3 takes; of JEE6.2's only chroma of degree 3 at r01 would be larger, by 2
COMMON = (
    "--trisoupNodeSizeLog2=0", "--mergeDuplicatedPoints=0", "--neighbourAvailBoundaryLog2=8", "--intra_pred_max_node_size_log2=6",
    "--positionQuantizationScale=1", "--inferredDirectCodingMode=3", "--planarEnabled=0", "--qtbtEnabled=0", "--transformType=0",
    "--attrOffset=0", "--attrScale=1",
)  # fmt: skip
PIECE = struct.Struct(">BI")  # a piece of a tmc3 file: kind, bytes that follow
PLACE = struct.Struct("<B")  # of a piece among those of the first pass
VARIED, CONSTANT = 1, 0


def lacking() -> str | None:
    """Say whether the program is missing.

    Raises:
        OptionError: the variable names something that is no file.
    """
    if find_program(VARIABLE, PROGRAM) is not None:
        return None
    return f"needs {PROGRAM}, MPEG's test model for G-PCC (MPEGGroup/mpeg-pcc-tmc13): build it, put it on PATH or name it in {VARIABLE}"


def jee_settings(few: bool, sh_degree: int) -> tuple[Setting, ...]:  # noqa: ARG001
    """Give JEE6.2's four rates in both domains."""
    rates = ("r01", "r03") if few else ("r01", "r02", "r03", "r04")
    domains: tuple[Domain, ...] = ("local", "world")
    return tuple(Setting(f"{rate}, {domain}", domain, {"points": rate}) for domain in domains for rate in rates)


def fitted_settings(few: bool, sh_degree: int) -> tuple[Setting, ...]:
    """Give the fitted rates with places in the world, and rotations there or, as they lie on trained avatars, by triangle."""
    rates = tuple(points.FITTED)[:: 2 if few else 1]
    domains: dict[Domain, str] = {"world": "world", "mixed": TURNED}
    suiting = ("mixed" if sh_degree else "world",) if few else tuple(domains)
    return tuple(
        Setting(f"{rate}, {domains[d]}", d, {"points": rate}) for rate in rates for d in domains if d in suiting
    )


def encode(splats: Gaussians, ground: Ground, setting: Setting) -> Parts:
    """Encode, one pass a column."""
    mapped = points.map_points(splats, str(setting.options["points"]), setting.domain == "world")
    mapped = mapped.sorted()
    passes = io.BytesIO()
    geometry = b""
    first: list[bytes] = []
    for column, qp in zip(mapped.columns.T, mapped.qps, strict=True):
        if geometry and (column == column[0]).all():
            passes.write(struct.pack("<BH", CONSTANT, column[0]))
            continue
        pieces = list(pieces_of(run_encoder(mapped.position, column, qp, mapped.told.n_bits)))
        if not geometry:
            geometry, first = b"".join(pieces), pieces
            continue
        other = [place for place, piece in enumerate(pieces) if piece != first[place]]
        passes.write(struct.pack("<BB", VARIED, len(other)))
        for place in other:
            passes.write(PLACE.pack(place) + pieces[place])
    bindings = encode_bindings(splats.binding[mapped.rows], ground)
    return {"head": mapped.head(), "geometry": geometry, "attributes": passes.getvalue(), "bindings": bindings}


def decode(parts: Parts, ground: Ground) -> Gaussians:
    """Decode, one pass a column."""
    head = points.Head.read(parts["head"])
    binding = decode_bindings(parts["bindings"], ground)
    first = list(pieces_of(parts["geometry"]))
    position, column = run_decoder(b"".join(first), len(binding))
    columns = [column]
    stream = io.BytesIO(parts["attributes"])
    while len(columns) < head.n_columns:
        kind = stream.read(1)[0]
        if kind == CONSTANT:
            columns.append(np.full(len(binding), struct.unpack("<H", stream.read(2))[0], np.int64))
            continue
        pieces = list(first)
        for _ in range(stream.read(1)[0]):
            place = stream.read(1)[0]
            start = stream.read(PIECE.size)
            pieces[place] = start + stream.read(PIECE.unpack(start)[1])
        again, column = run_decoder(b"".join(pieces), len(binding))
        if not np.array_equal(again, position):
            raise PeerError(f"{PROGRAM} gave other points in another pass")
        columns.append(column)
    return points.unmap_points(position, np.stack(columns, axis=1), head, binding)


def pieces_of(data: bytes) -> Iterator[bytes]:
    """Give the pieces that a tmc3 file is made of, each with its start."""
    at = 0
    while at < len(data):
        _, n_bytes = PIECE.unpack_from(data, at)
        end = at + PIECE.size + n_bytes
        yield data[at:end]
        at = end


def run_encoder(position: Int[np.ndarray, "n 3"], column: Int[np.ndarray, " n"], qp: int, n_bits: int) -> bytes:
    """Code points with one column."""
    table = np.empty(len(position), [("x", "<f4"), ("y", "<f4"), ("z", "<f4"), ("reflectance", "<u2")])
    for axis, name in enumerate("xyz"):
        table[name] = position[:, axis]
    table["reflectance"] = column
    lines = [
        "ply", "format binary_little_endian 1.0", f"element vertex {len(table)}", *(f"property float {a}" for a in "xyz"),
        "property uint16 reflectance", "end_header",
    ]  # fmt: skip
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        (folder / "in.ply").write_bytes("".join(f"{line}\n" for line in lines).encode() + table.tobytes())
        flags = ("--mode=0", "--uncompressedDataPath=in.ply", "--compressedStreamPath=out.bin")
        coding = (f"--bitdepth={n_bits}", f"--qp={min(qp, LARGEST_QP)}", "--attribute=reflectance")
        run_program([program(), *flags, *COMMON, *coding], folder)
        return (folder / "out.bin").read_bytes()


def run_decoder(data: bytes, n: int) -> tuple[Int[np.ndarray, "n 3"], Int[np.ndarray, " n"]]:
    """Give points in Morton order, and their column."""
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        (folder / "in.bin").write_bytes(data)
        flags = ("--mode=1", "--compressedStreamPath=in.bin", "--reconstructedDataPath=out.ply", "--outputBinaryPly=1")
        run_program([program(), *flags], folder)
        table = read_table(folder / "out.ply")
    position: Float[np.ndarray, "n 3"] = np.stack([table[axis] for axis in "xyz"], axis=1)
    if len(position) != n:
        raise PeerError(f"{PROGRAM} gave {len(position)} points of {n}")
    whole = np.rint(position).astype(np.int64)
    order = np.argsort(points.morton(whole), kind="stable")
    (values,) = (name for name in table.dtype.names or () if name not in "xyz")
    return whole[order], table[values][order].astype(np.int64)


def read_table(path: Path) -> np.ndarray:
    """Read a binary PLY of any columns."""
    header, end, body = path.read_bytes().partition(b"end_header\n")
    lines = [line.split() for line in header.decode("ascii", "replace").splitlines()]
    count = next(int(line[2]) for line in lines if line[:2] == ["element", "vertex"])
    kinds = {"float": "<f4", "float32": "<f4", "double": "<f8", "float64": "<f8", "uint16": "<u2", "ushort": "<u2", "uchar": "u1",
             "uint8": "u1", "int": "<i4", "int32": "<i4", "uint": "<u4"}  # fmt: skip
    columns = [(line[2], kinds[line[1]]) for line in lines if line[:1] == ["property"] and line[1] in kinds]
    if not end:
        raise PeerError(f"{PROGRAM} wrote no PLY")
    return np.frombuffer(body, np.dtype(columns), count)


def program() -> Path:
    """Give where the program is.

    Raises:
        PeerError: nowhere.
    """
    found = find_program(VARIABLE, PROGRAM)
    if found is None:
        raise PeerError(lacking() or "")
    return found


PEERS = (
    Peer("jee", "G-PCC at JEE6.2's rates", lacking, jee_settings, encode, decode, limit_s=900.0),
    Peer("gpcc", "G-PCC, fitted", lacking, fitted_settings, encode, decode, limit_s=900.0),
)
