"""A stand-in for the programs `tmc3` and GeS-TM: their command line, their PLY, streams of units, points given back in another order."""

from __future__ import annotations

import struct
import sys
import zlib
from pathlib import Path

import numpy as np

IS_GES_TM = "ges" in Path(sys.argv[0]).name
TYPES = {"float": "<f4", "uint16": "<u2"}


def unit(kind: int, payload: bytes) -> bytes:
    """Give one unit: type, length, payload."""
    return struct.pack(">BI", kind, len(payload)) + payload


def options_of(arguments: list[str]) -> tuple[dict[str, str], list[tuple[str, int]]]:
    """Read the configuration file and what follows it; attributes keep the quantisation parameter that stood before them."""
    options, attributes, qp = {}, [], 4
    for line in Path(arguments[arguments.index("-c") + 1]).read_text().splitlines():
        name, value = (part.strip() for part in line.split(":"))
        options[name] = value
        qp = int(value) if name == "qp" else qp
        attributes += [(value, qp)] if name == "attribute" else []
    for argument in arguments:
        if argument.startswith("--"):
            name, value = argument[2:].split("=")
            options[name] = value
    return options, attributes


def read_ply(path: Path) -> np.ndarray:
    """Read the little of PLY that is asked for."""
    head, body = path.read_bytes().split(b"end_header\n", 1)
    lines = [line.split() for line in head.decode().splitlines()]
    count = next(int(line[2]) for line in lines if line[0] == "element")
    return np.frombuffer(body, [(line[2], TYPES[line[1]]) for line in lines if line[0] == "property"], count)


def encode(options: dict[str, str], attributes: list[tuple[str, int]]) -> None:
    """Write points in a unit of their own, then one for each attribute, quantised."""
    table = read_ply(Path(options["uncompressedDataPath"]))
    order = np.lexsort((table["x"], table["y"], table["z"]))  # another order than anybody else's
    points = np.stack([table[axis][order] for axis in "xyz"], axis=1).astype("<i4")
    stream = unit(2, zlib.compress(points.tobytes()))
    for name, qp in attributes:
        step = max(1, round(2 ** ((qp - 4) / 6)))
        values = np.clip(np.rint(table[name][order] / step) * step, 0, 4095).astype("<u2")
        stream += unit(4, name.encode() + b":" + zlib.compress(values.tobytes()))
    Path(options["compressedStreamPath"]).write_bytes(stream)


def decode(options: dict[str, str], attributes: list[tuple[str, int]]) -> None:
    """Write them back: as text where it is tmc3, binary where it is GeS-TM."""
    data = Path(options["compressedStreamPath"]).read_bytes()
    columns: dict[str, np.ndarray] = {}
    while data:
        kind, length = struct.unpack(">BI", data[:5])
        payload, data = data[5 : 5 + length], data[5 + length :]
        if kind == 2:
            points = np.frombuffer(zlib.decompress(payload), "<i4").reshape(-1, 3)
            columns |= dict(zip("xyz", points.T, strict=True))
        else:
            name, body = payload.split(b":", 1)
            columns[name.decode().replace("reflectance", "refc")] = np.frombuffer(zlib.decompress(body), "<u2")
    lines = [
        "ply",
        f"format {'binary_little_endian' if IS_GES_TM else 'ascii'} 1.0",
        f"element vertex {len(columns['x'])}",
    ]
    lines += [f"property {'float64' if name in 'xyz' else 'uint16'} {name}" for name in columns]
    lines += ["element face 0", "property list uint8 int32 vertex_index", "end_header"]
    body = "".join(" ".join(str(x) for x in row) + "\n" for row in zip(*columns.values(), strict=True)).encode()
    if IS_GES_TM:
        table = np.zeros(len(columns["x"]), [(name, "<f8" if name in "xyz" else "<u2") for name in columns])
        for name, values in columns.items():
            table[name] = values
        body = table.tobytes()
    Path(options["reconstructedDataPath"]).write_bytes("".join(f"{line}\n" for line in lines).encode() + body)


def main() -> int:
    """Do what the command line says."""
    if "--help" in sys.argv:
        sys.stdout.write("--mode\n" + ("--3DGS\n" if IS_GES_TM else ""))
        return 1  # as some builds do
    options, attributes = options_of(sys.argv[1:])
    if "broken" in Path(sys.argv[0]).name:
        sys.stderr.write("out of luck\n")
        return 3
    if options["mode"] == "0":
        assert (options["mergeDuplicatedPoints"], options["positionQuantizationScale"]) == ("0", "1")
        assert ("3DGS" in options) == IS_GES_TM
        encode(options, attributes)
    else:
        decode(options, attributes)
    return 0


if __name__ == "__main__":
    sys.exit(main())
