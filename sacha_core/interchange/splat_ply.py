"""Gaussians as the PLY files of GaussianAvatars (bound to triangles) and of 3D Gaussian Splatting and its viewers (in the world)."""

from __future__ import annotations

import os
import re
from dataclasses import dataclass
from pathlib import Path
from typing import BinaryIO

import numpy as np

from sacha_core.avatar.gaussians import Gaussians
from sacha_core.errors import FormatError, OptionError
from sacha_core.files import write_aside

__all__ = ["is_bound_ply", "read_bound_ply", "read_world_ply", "write_bound_ply", "write_world_ply"]

TYPES = {
    "char": "i1", "int8": "i1", "uchar": "u1", "uint8": "u1", "short": "i2", "int16": "i2", "ushort": "u2", "uint16": "u2",
    "int": "i4", "int32": "i4", "uint": "u4", "uint32": "u4", "float": "f4", "float32": "f4", "double": "f8", "float64": "f8",
}  # fmt: skip
ORDERS = {"binary_little_endian": "<", "binary_big_endian": ">"}
MAX_HEADER_BYTES = 1 << 16
MAX_FACES = 1 << 24  # float32 holds whole numbers exactly up to here
POSITION = ("x", "y", "z")
NORMAL = ("nx", "ny", "nz")  # unused, written as zeros
DC = tuple(f"f_dc_{i}" for i in range(3))
SCALE = tuple(f"scale_{i}" for i in range(3))
ROTATION = tuple(f"rot_{i}" for i in range(4))
BINDING, SENSITIVITY = "binding_0", "sensitivity_0"
REST_COUNTS = {3 * ((degree + 1) ** 2 - 1): degree for degree in range(4)}


@dataclass(frozen=True)
class _Element:
    n_rows: int
    properties: dict[str, str]


@dataclass(frozen=True)
class _Header:
    n_rows: int
    dtype: np.dtype[np.void]
    n_bytes: int
    more_follows: bool


def read_bound_ply(path: str | os.PathLike[str], n_faces: int | None = None) -> Gaussians:
    """Read Gaussians that are bound to triangles.

    Args:
        path: a binary `.ply` in GaussianAvatars' layout, spherical harmonics of degree 0 to 3; other properties are ignored.
        n_faces: triangles of the head, where known: bindings are checked against it.

    Returns:
        The Gaussians in the file's order, float32, bindings int32.

    Raises:
        FormatError: it is no such file, is cut short, lacks a property or has it of another type, holds a number that is not finite
            or a binding out of range.
        OSError: it cannot be read.

    Source: Qian et al., GaussianAvatars, CVPR 2024 (its point_cloud.ply); Turk, The PLY polygon file format, 1994.
    """
    return _read(Path(path), MAX_FACES if n_faces is None else n_faces, bound=True)


def read_world_ply(path: str | os.PathLike[str]) -> Gaussians:
    """Read Gaussians that stand in the world: a scene of 3D Gaussian Splatting.

    Args:
        path: a binary `.ply` as 3D Gaussian Splatting writes it, spherical harmonics of degree 0 to 3; other properties are ignored.

    Returns:
        The Gaussians in the file's order, float32, in metres of the world, all bound to triangle 0: one whose frame is the world's.

    Raises:
        FormatError: it is no such file, is cut short, lacks a property or has it of another type, holds a number that is not finite, or its
            Gaussians are bound to a head.
        OSError: it cannot be read.

    Source: Kerbl et al., 3D Gaussian Splatting, 2023 (its point_cloud.ply).
    """
    return _read(Path(path), MAX_FACES, bound=False)


def is_bound_ply(path: str | os.PathLike[str]) -> bool:
    """Tell whether the Gaussians of a file say which triangles they are bound to, by its header alone.

    Raises:
        FormatError: it is no PLY file.
        OSError: it cannot be read.
    """
    try:
        with Path(path).open("rb") as stream:
            return BINDING in (_read_header(stream).dtype.names or ())
    except FormatError as error:
        raise FormatError(f"{path}: {error}") from error


def write_bound_ply(path: str | os.PathLike[str], gaussians: Gaussians, sh_degree: int = 3) -> None:
    """Write Gaussians as GaussianAvatars does: 252 bytes each at degree 3, four more with the sensitivity of training.

    Args:
        path: the `.ply` file.
        gaussians: to be written.
        sh_degree: degree of the layout, 3 for GaussianAvatars itself; coefficients that the Gaussians lack are written as zeros.

    Raises:
        OptionError: the layout has no room for the Gaussians' own coefficients.
        OSError: the file cannot be written.
    """
    sensitivity = gaussians.sensitivity_logit
    extra: dict[tuple[str, ...], np.ndarray] = {(BINDING,): gaussians.binding[:, None]}
    if sensitivity is not None:
        extra[(SENSITIVITY,)] = sensitivity[:, None]
    _write(path, gaussians, sh_degree, extra)


def write_world_ply(path: str | os.PathLike[str], gaussians: Gaussians, sh_degree: int = 3) -> None:
    """Write Gaussians that stand in the world as 3D Gaussian Splatting does: 62 numbers, 248 bytes each at degree 3.

    Args:
        path: the `.ply` file.
        gaussians: in metres of the world; their binding is not written.
        sh_degree: degree of the layout, 3 for 3D Gaussian Splatting itself; coefficients that the Gaussians lack are written as zeros.

    Raises:
        OptionError: the layout has no room for the Gaussians' own coefficients.
        OSError: the file cannot be written.
    """
    _write(path, gaussians, sh_degree, {})


def _write(
    path: str | os.PathLike[str], gaussians: Gaussians, sh_degree: int, extra: dict[tuple[str, ...], np.ndarray]
) -> None:
    if not gaussians.sh_degree <= sh_degree <= 3:
        raise OptionError(
            f"sh_degree {sh_degree} of the PLY is not between {gaussians.sh_degree}, which the Gaussians have, and 3"
        )
    n, n_rest = len(gaussians), (sh_degree + 1) ** 2 - 1
    rest = np.zeros((n, 3, n_rest), np.float32)
    rest[:, :, : gaussians.sh_rest.shape[1]] = gaussians.sh_rest.transpose(0, 2, 1)
    columns = {
        POSITION: gaussians.position,
        NORMAL: np.zeros((n, 3), np.float32),
        DC: gaussians.sh_dc,
        _rest_names(3 * n_rest): rest.reshape(n, 3 * n_rest),
        ("opacity",): gaussians.opacity_logit[:, None],
        SCALE: gaussians.log_scale,
        ROTATION: gaussians.quaternion,
        **extra,
    }
    names = [name for group in columns for name in group]
    table = np.concatenate([np.asarray(values, "<f4") for values in columns.values()], axis=1)
    lines = [
        "ply",
        "format binary_little_endian 1.0",
        f"element vertex {n}",
        *(f"property float {name}" for name in names),
    ]
    with write_aside(path) as aside, aside.open("wb") as stream:
        stream.write("".join(f"{line}\n" for line in (*lines, "end_header")).encode("ascii"))
        stream.write(table.tobytes())


def _read(file: Path, n_faces: int, bound: bool) -> Gaussians:
    try:
        with file.open("rb") as stream:
            header = _read_header(stream)
            rest = _check_properties(header.dtype, bound)
            rows = _read_rows(stream, header, file.stat().st_size)
        gaussians = _from_rows(rows, rest, bound)
        gaussians.validate(n_faces)
    except FormatError as error:
        raise FormatError(f"{file}: {error}") from error
    return gaussians


def _read_header(stream: BinaryIO) -> _Header:
    text = stream.read(MAX_HEADER_BYTES)
    if not text.startswith((b"ply\n", b"ply\r\n")):
        raise FormatError("not a PLY file", offset=0)
    end = text.find(b"end_header")
    newline = text.find(b"\n", end)
    if end < 0 or newline < 0:
        raise FormatError(f"the PLY header has no end_header line in its first {MAX_HEADER_BYTES} bytes")
    order, elements = _parse_header(text[:end].decode("ascii", "replace").splitlines()[1:])
    if not order or not elements or not elements[0].properties:
        raise FormatError("the PLY header lacks a format, an 'element vertex COUNT' line, or properties")
    vertex = elements[0]
    dtype = np.dtype([(name, order + kind) for name, kind in vertex.properties.items()])
    return _Header(vertex.n_rows, dtype, newline + 1, len(elements) > 1)


def _parse_header(lines: list[str]) -> tuple[str, list[_Element]]:
    """Give the byte order and the elements, of which only the first, the vertices, is looked into."""
    order, elements = "", list[_Element]()
    for line in lines:
        match line.split():
            case [] | ["comment" | "obj_info", *_]:
                pass
            case ["format", kind, "1.0"]:
                if kind not in ORDERS:
                    raise FormatError(f"PLY format {kind!r} is not read; expected {' or '.join(ORDERS)}")
                order = ORDERS[kind]
            case ["element", name, count] if (name == "vertex" or elements) and re.fullmatch("[0-9]{1,12}", count):
                elements.append(_Element(int(count), {}))
            case ["element", "chunk", _] if not elements:
                raise FormatError("this is a compressed PLY; PlayCanvas' splat-transform makes a plain one of it")
            case ["property", *_] if len(elements) > 1:
                pass
            case ["property", kind, name] if elements and kind in TYPES and name not in elements[0].properties:
                elements[0].properties[name] = TYPES[kind]
            case _:
                raise FormatError(
                    f"PLY header line not understood: {line.strip()[:80]!r}; the first element must be 'vertex', without lists,"
                    " and no property twice"
                )
    return order, elements


def _rest_names(count: int) -> tuple[str, ...]:
    return tuple(f"f_rest_{i}" for i in range(count))


def _check_properties(dtype: np.dtype[np.void], bound: bool) -> tuple[str, ...]:
    """Check that all is there, and give the names of the higher coefficients."""
    held = {name: dtype[name] for name in dtype.names or ()}
    rest = _rest_names(sum(name.startswith("f_rest_") for name in held))
    if len(rest) not in REST_COUNTS:
        raise FormatError(
            f"{len(rest)} f_rest properties are no degree of spherical harmonics; expected {', '.join(map(str, REST_COUNTS))}"
        )
    needed = (*POSITION, *DC, *rest, "opacity", *SCALE, *ROTATION)
    missing = [name for name in needed if name not in held]
    if missing:
        raise FormatError(
            f"no property {', '.join(missing)}; expected {', '.join(needed)}{f', {BINDING}' if bound else ''}"
        )
    if bound and BINDING not in held:
        raise FormatError(
            f"no property {BINDING}: these Gaussians are not bound to the triangles of a head (`sacha bind` does that)"
        )
    if not bound and BINDING in held:
        raise FormatError(
            f"property {BINDING}: these Gaussians are bound to the triangles of a head already, and stand nowhere by themselves"
        )
    optional = tuple(name for name in (SENSITIVITY,) if bound and name in held)
    for name in (*needed, *optional):
        if held[name].newbyteorder("=") != np.float32:
            raise FormatError(
                f"property {name} is of type {held[name].newbyteorder('=').name}, expected float (32 bits)"
            )
    return rest


def _read_rows(stream: BinaryIO, header: _Header, file_size: int) -> np.ndarray:
    expected = header.n_bytes + header.n_rows * header.dtype.itemsize
    if file_size < expected or (file_size > expected and not header.more_follows):
        raise FormatError(
            f"{header.n_rows} Gaussians of {header.dtype.itemsize} bytes after a header of {header.n_bytes} make {expected} bytes,"
            f" but the file has {file_size}",
            offset=min(file_size, expected),
        )
    stream.seek(header.n_bytes)
    return np.frombuffer(bytearray(stream.read(expected - header.n_bytes)), header.dtype, header.n_rows)


def _from_rows(rows: np.ndarray, rest: tuple[str, ...], bound: bool) -> Gaussians:
    def columns(names: tuple[str, ...]) -> np.ndarray:
        out = np.empty((len(rows), len(names)), np.float32)
        for i, name in enumerate(names):
            out[:, i] = rows[name]
        return out

    return Gaussians(
        position=columns(POSITION),
        log_scale=columns(SCALE),
        quaternion=columns(ROTATION),
        opacity_logit=columns(("opacity",))[:, 0],
        sh_dc=columns(DC),
        sh_rest=np.ascontiguousarray(columns(rest).reshape(len(rows), 3, len(rest) // 3).transpose(0, 2, 1)),
        binding=_whole(rows[BINDING]) if bound else np.zeros(len(rows), np.int32),
        sensitivity_logit=columns((SENSITIVITY,))[:, 0] if bound and SENSITIVITY in (rows.dtype.names or ()) else None,
    )


def _whole(binding: np.ndarray) -> np.ndarray:
    """Turn bindings, which the layout keeps as float32, into indices."""
    numbers = binding.astype(np.float64)
    sound = (numbers == np.floor(numbers)) & (numbers >= 0) & (numbers < MAX_FACES)
    if not sound.all():
        row = int(np.argmin(sound))
        raise FormatError(f"{BINDING} of Gaussian {row} is {numbers[row]:.9g}, expected the index of a triangle")
    return numbers.astype(np.int32)
