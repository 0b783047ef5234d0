"""An external coder of point clouds for the paper profile: MPEG's `tmc3` or a GeS-TM built from it, run as a program.

A GeS-TM codes all attributes of a splat at once; a plain tmc3 knows only one number a point, so it runs once for each attribute, and units
of its streams that repeat (the points themselves) are kept once. Neither is part of this project; the program is the one that the user
names, and nothing else is ever run.

Source: conventions of the programs: TMC13's options (doc/README.options.md) and annex B of ISO/IEC 23090-9 (type, length, payload).
"""

from __future__ import annotations

import struct
import tempfile
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from jaxtyping import Int

from sacha_core.codec.paper_map import ATTRIBUTE_MAX, POSITION_MAX, columns_of
from sacha_core.codec.point_ply import read_points, write_points
from sacha_core.codec.reading import ByteReader, pack_text
from sacha_core.errors import FormatError, OptionError, ProgramError
from sacha_core.programs import named_program, run_program

__all__ = ["TMC13", "TOOL_VARIABLE", "decode_with_tool", "encode_with_tool", "tool_name"]

TOOL_VARIABLE = "SACHA_TMC3"
TMC13, GES_TM = "tmc3", "GeS-TM"
HELP_OF_GES_TM = "3DGS"  # an option that only it has
TIMEOUT_S = 600
UNIT_HEAD = struct.Struct(">BI")  # type, bytes
COMMON = {
    "trisoupNodeSizeLog2": 0, "mergeDuplicatedPoints": 0, "neighbourAvailBoundaryLog2": 0, "intra_pred_max_node_size_log2": 0,
    "positionQuantizationScale": 1, "inferredDirectCodingMode": 3, "planarEnabled": 0, "qtbtEnabled": 0, "planarModeIdcmUse": 0,
}  # fmt: skip
OUTPUT = {"convertPlyColourspace": 0, "outputBinaryPly": 1}
AXES = ("x", "y", "z")
REFLECTANCE = "reflectance"
REFLECTANCE_OUT = ("refc", REFLECTANCE)


def attribute_names(n_harmonics: int) -> list[str]:
    """Names of all columns but the coordinates, as a splat's PLY has them."""
    rest = [f"f_rest_{i}" for i in range(3 * n_harmonics)]
    dc = [f"f_dc_{i}" for i in range(3)]
    return [*dc, *rest, "opacity", *(f"scale_{i}" for i in range(3)), *(f"rot_{i}" for i in range(4))]


@dataclass(frozen=True)
class Tool:
    """The program.

    Args:
        path: where it is.
        name: `tmc3` or `GeS-TM`.
    """

    path: Path
    name: str

    @classmethod
    def at(cls, path: Path) -> Tool:
        """Find out what a program is.

        Raises:
            OptionError: it cannot be run.
        """
        path = path.absolute()
        try:
            text = run_program([path, "--help"], limit_s=TIMEOUT_S, check=False)
        except ProgramError as fault:
            raise OptionError(f"{path}: cannot be run as a coder of point clouds: {fault}") from fault
        return cls(path, GES_TM if HELP_OF_GES_TM in text else TMC13)

    def encode(self, folder: Path, columns: dict[str, Int[np.ndarray, " n"]], qps: dict[str, int]) -> bytes:
        """Code points with attributes.

        Args:
            folder: to work in.
            columns: by name, the coordinates among them.
            qps: quantisation parameters of the attributes.
        """
        write_points(folder / "in.ply", columns, AXES)
        options: list[tuple[str, object]] = [("mode", 0), *COMMON.items(), *OUTPUT.items(), ("transformType", 0)]
        options += [(HELP_OF_GES_TM, 1)] if self.name == GES_TM else []
        options += [("bitdepth", 12)]
        for place, (name, qp) in enumerate(qps.items()):
            options += (
                [("rahtPredictionEnabled", 0)] if place == len(AXES) else []
            )  # levels predict each other in degree 0 only
            options += [("qp", qp), ("attribute", name)]
        self._run(folder, options, {"uncompressedDataPath": "in.ply", "compressedStreamPath": "coded.bin"}, "coded.bin")
        return (folder / "coded.bin").read_bytes()

    def decode(self, folder: Path, coded: bytes, names: list[str]) -> dict[str, Int[np.ndarray, " n"]]:
        """Read points with attributes back, in whatever order the program gives them."""
        (folder / "coded.bin").write_bytes(coded)
        options = [("mode", 1), *OUTPUT.items(), *((("attribute", name)) for name in names)]
        self._run(folder, options, {"compressedStreamPath": "coded.bin", "reconstructedDataPath": "out.ply"}, "out.ply")
        return read_points(folder / "out.ply")

    def _run(self, folder: Path, options: list[tuple[str, object]], files: dict[str, str], made: str) -> None:
        config = folder / "options.cfg"
        config.write_text("".join(f"{name}: {value}\n" for name, value in options))
        (folder / made).unlink(missing_ok=True)
        told = [f"--{name}={folder / file}" for name, file in files.items()]
        try:
            run_program([self.path, "-c", config, *told], folder, TIMEOUT_S)
        except ProgramError as fault:
            raise FormatError(f"{self.path}: {fault}") from fault
        if not (folder / made).is_file():
            raise FormatError(f"{self.path} wrote no {made}")


def split_units(coded: bytes) -> list[bytes]:
    """Split a stream into its units; one that is not made of units is one."""
    units, at = [], 0
    while at < len(coded):
        if at + UNIT_HEAD.size > len(coded):
            return [coded]
        end = at + UNIT_HEAD.size + UNIT_HEAD.unpack_from(coded, at)[1]
        if end > len(coded):
            return [coded]
        units.append(coded[at:end])
        at = end
    return units


def pack_streams(name: str, streams: list[bytes]) -> bytes:
    """Write streams, units that repeat only once."""
    split = [split_units(stream) for stream in streams]
    known = list(dict.fromkeys(unit for units in split for unit in units))
    number = {unit: place for place, unit in enumerate(known)}
    parts = [pack_text(name), struct.pack("<H", len(known))]
    parts += [struct.pack("<I", len(unit)) + unit for unit in known]
    parts.append(struct.pack("<H", len(streams)))
    parts += [struct.pack(f"<H{len(units)}H", len(units), *(number[unit] for unit in units)) for units in split]
    return b"".join(parts)


def unpack_streams(reader: ByteReader) -> tuple[str, list[bytes]]:
    """Read what `pack_streams` wrote.

    Raises:
        FormatError: a stream names a unit that is not there.
    """
    name = reader.text()
    (n_units,) = reader.unpack("H")
    units = [reader.take(*reader.unpack("I")) for _ in range(n_units)]
    (n_streams,) = reader.unpack("H")
    streams = []
    for _ in range(n_streams):
        (length,) = reader.unpack("H")
        chosen = reader.unpack(f"{length}H")
        if (chosen and max(chosen) >= n_units) or len(set(chosen)) != len(chosen):
            raise reader.error(f"a stream of units {max(chosen, default=0)} and below, of {n_units}, each once")
        streams.append(b"".join(units[one] for one in chosen))
    reader.check_end()
    return name, streams


def tool_name(reader: ByteReader) -> str:
    """Tell which program coded."""
    return reader.text()


def encode_with_tool(
    path: Path, rows: Int[np.ndarray, "n c"], qps: list[int], n_harmonics: int
) -> tuple[bytes, Int[np.ndarray, "n c"]]:
    """Code all rows with a program; give the section and the rows as the program gives them back.

    Args:
        path: the program.
        rows: integers of all Gaussians, at least one.
        qps: quantisation parameter of every attribute column.
        n_harmonics: coefficients of degree 1 and up.

    Raises:
        FormatError: it failed, or does not give back what it was given.
        OptionError: it cannot be run.
    """
    tool = Tool.at(path)
    names = attribute_names(n_harmonics)
    points = dict(zip(AXES, rows.T, strict=False))
    columns = dict(zip(names, rows.T[len(AXES) :], strict=True))
    with tempfile.TemporaryDirectory(prefix="sacha-") as temporary:
        folder = Path(temporary)
        if tool.name == GES_TM:
            streams = [tool.encode(folder, points | columns, dict(zip(names, qps, strict=True)))]
        else:
            streams = [
                tool.encode(folder, points | {REFLECTANCE: columns[name]}, {REFLECTANCE: qp})
                for name, qp in zip(names, qps, strict=True)
            ]
    section = pack_streams(tool.name, streams)
    return section, decode_streams(tool, streams, len(rows), n_harmonics)


def decode_streams(tool: Tool, streams: list[bytes], n: int, n_harmonics: int) -> Int[np.ndarray, "n c"]:
    """Have a program read its streams.

    Raises:
        FormatError: it failed, or gives other points than it should.
    """
    names = attribute_names(n_harmonics)
    if len(streams) != (1 if tool.name == GES_TM else len(names)):
        raise FormatError(f"{len(streams)} streams of {tool.name}, expected one, or of tmc3 one an attribute")
    rows = np.zeros((n, columns_of(n_harmonics)["Rotation"].stop), np.int64)
    with tempfile.TemporaryDirectory(prefix="sacha-") as temporary:
        for number, stream in enumerate(streams):
            found = tool.decode(Path(temporary), stream, names if tool.name == GES_TM else [REFLECTANCE])
            aliases = dict.fromkeys(REFLECTANCE_OUT, names[number]) if tool.name == TMC13 else {}
            found = {aliases.get(name, name): values for name, values in found.items()}
            wanted = [*AXES, *(names if tool.name == GES_TM else [names[number]])]
            if any(name not in found or len(found[name]) != n for name in wanted):
                raise FormatError(f"{tool.path} gives {', '.join(found)}; expected {n} each of {', '.join(wanted)}")
            points = np.stack([found[axis] for axis in AXES], axis=1)
            if number and not np.array_equal(points, rows[:, :3]):
                raise FormatError(f"{tool.path} gives points in another order for {names[number]}")
            rows[:, :3] = points
            for name in wanted[len(AXES) :]:
                rows[:, len(AXES) + names.index(name)] = found[name]
    if rows.min(initial=0) < 0 or rows[:, :3].max(initial=0) > POSITION_MAX:
        raise FormatError(f"{tool.path} gives a point outside the grid of 0 to {POSITION_MAX}")
    rows[:, 3:] = np.clip(rows[:, 3:], 0, ATTRIBUTE_MAX)
    return rows


def decode_with_tool(reader: ByteReader, n: int, n_harmonics: int) -> Int[np.ndarray, "n c"]:
    """Have the program that the user named read the rows of a file.

    Raises:
        OptionError: none is named, or what is named is no program, or another one than the file was made with.
        FormatError: it failed, or gives other points than it should.
    """
    name, streams = unpack_streams(reader)
    path = named_program(TOOL_VARIABLE)
    if path is None:
        raise OptionError(f"the file was coded by {name}; name that program: {TOOL_VARIABLE}=PATH")
    tool = Tool.at(path)
    if tool.name != name:
        raise OptionError(f"{TOOL_VARIABLE}={path} is a {tool.name}; the file was coded by {name!a}")
    return decode_streams(tool, streams, n, n_harmonics)
