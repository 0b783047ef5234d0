"""Points as PLY, the little of it that coders of point clouds read and write.

Source: Turk, The PLY polygon file format, 1994.
"""

from __future__ import annotations

from pathlib import Path

import numpy as np
from jaxtyping import Int

from sacha_core.errors import FormatError

__all__ = ["read_points", "write_points"]

TYPES = {
    "float64": "f8", "double": "f8", "float": "f4", "float32": "f4", "uint64": "u8", "int64": "i8", "uint32": "u4", "uint": "u4",
    "int32": "i4", "int": "i4", "uint16": "u2", "ushort": "u2", "int16": "i2", "short": "i2", "uint8": "u1", "uchar": "u1",
    "int8": "i1", "char": "i1",
}  # fmt: skip
ORDERS = {"binary_little_endian": "<", "binary_big_endian": ">"}
MAX_HEADER_LINES = 1000


def write_points(path: Path, columns: dict[str, Int[np.ndarray, " n"]], axes: tuple[str, ...]) -> None:
    """Write whole numbers: coordinates as float, which holds 24 bits exactly, all else in 16 bits."""
    layout = [(name, "<f4" if name in axes else "<u2") for name in columns]
    table = np.zeros(len(next(iter(columns.values()))), np.dtype(layout))
    for name, values in columns.items():
        table[name] = values
    lines = ["ply", "format binary_little_endian 1.0", f"element vertex {len(table)}"]
    lines += [f"property {'float' if name in axes else 'uint16'} {name}" for name in columns]
    path.write_bytes("".join(f"{line}\n" for line in (*lines, "end_header")).encode() + table.tobytes())


def read_points(path: Path) -> dict[str, Int[np.ndarray, " n"]]:
    """Read the first element of a PLY, numbers rounded to whole ones.

    Raises:
        FormatError: it is no such file.
    """
    data = path.read_bytes()
    lines: list[list[str]] = []
    at = 0
    while len(lines) < MAX_HEADER_LINES and (not lines or lines[-1][:1] != ["end_header"]):
        end = data.find(b"\n", at)
        if end < 0:
            raise FormatError("points: a PLY header without an end")
        lines.append(data[at:end].decode("ascii", "replace").split())
        at = end + 1
    try:
        kind, n, layout = parse_header(lines)
        if kind == "ascii":
            width = len(layout)
            table = np.array(data[at:].split()[: n * width], np.float64).reshape(n, width)
            columns = {name: table[:, place] for place, (name, _) in enumerate(layout)}
        else:
            rows = np.frombuffer(data, np.dtype([(name, ORDERS[kind] + code) for name, code in layout]), n, at)
            columns = {name: rows[name].astype(np.float64) for name, _ in layout}
    except (KeyError, ValueError, IndexError) as fault:
        raise FormatError(f"points: not a PLY of points: {fault}") from fault
    if not all(np.isfinite(values).all() for values in columns.values()):
        raise FormatError("points: a number is not finite")
    return {name: np.rint(values).astype(np.int64) for name, values in columns.items()}


def parse_header(lines: list[list[str]]) -> tuple[str, int, list[tuple[str, str]]]:
    """Give the format, the number of rows, and name and type of each property of the first element."""
    kind, n, layout, elements = "", 0, list[tuple[str, str]](), 0
    for line in lines:
        if line[:1] == ["format"]:
            kind = line[1]
        elif line[:1] == ["element"]:
            elements += 1
            n = int(line[2]) if elements == 1 else n
        elif line[:1] == ["property"] and elements == 1:
            layout.append((line[2], TYPES[line[1]]))
    return kind, n, layout
