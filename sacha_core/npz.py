"""NumPy archives from anywhere: read without trust, written so that equal arrays give equal bytes."""

from __future__ import annotations

import io
import lzma
import math
import os
import struct
import tokenize
import zipfile
import zlib
from collections.abc import Mapping
from pathlib import Path

import numpy as np
from jaxtyping import Float, Num

from sacha_core.errors import FormatError
from sacha_core.files import write_aside

__all__ = ["as_float32", "read_npz", "write_npz"]

# FLAME with all components takes 0.05 GB, an hour of motion as much, a checkpoint of a large avatar 1 GB
MAX_BYTES = 1 << 32
DEFLATE_RATIO = 1100  # deflate cannot do better than 1032 to 1, so a member that claims more is lying
FAULTS = (  # what zipfile and numpy.lib.format raise on hostile bytes
    zipfile.BadZipFile, tokenize.TokenError, zlib.error, lzma.LZMAError, struct.error, EOFError, ValueError, KeyError,
    IndexError, RuntimeError, NotImplementedError, SyntaxError, OverflowError, MemoryError, TypeError, AttributeError,
)  # fmt: skip


def read_npz(
    path: str | os.PathLike[str],
    *,
    skip: tuple[str, ...] = (),
    max_bytes: int = MAX_BYTES,
    pickled: dict[str, bytes] | None = None,
) -> dict[str, np.ndarray]:
    """Read every array of an `.npz` file.

    No object arrays (they are pickles), and no more memory than the file's own size can account for.

    Args:
        path: the file.
        skip: names of arrays that are not wanted; they are not even decompressed.
        max_bytes: most bytes that the arrays may have together.
        pickled: where given, the pickles of object arrays are put here by name, as they are, and are no error.

    Returns:
        Arrays by name, in the file's order.

    Raises:
        FormatError: the file is no such archive, is damaged, or holds something else than plain arrays.
        OSError: the file cannot be read.
    """
    file = Path(path)
    with file.open("rb") as stream:
        if stream.read(2) != b"PK":
            raise FormatError(f"{file}: not an .npz archive (a zip archive of NumPy arrays)", offset=0)
        try:
            with zipfile.ZipFile(stream) as archive:
                return _read_members(archive, skip, max_bytes, pickled)
        except FormatError as error:
            raise FormatError(f"{file}: {error}") from error
        except FAULTS as error:
            raise FormatError(f"{file}: damaged .npz archive: {str(error) or type(error).__name__}") from error


def _read_members(
    archive: zipfile.ZipFile, skip: tuple[str, ...], max_bytes: int, pickled: dict[str, bytes] | None
) -> dict[str, np.ndarray]:
    arrays: dict[str, np.ndarray] = {}
    total = 0
    for member in archive.infolist():
        name = member.filename.removesuffix(".npy")
        if name in skip:
            continue
        if name in arrays:
            raise FormatError(f"array {name!r} occurs twice")
        total += member.file_size
        if total > max_bytes:
            raise FormatError(f"its arrays take more than {max_bytes} bytes, which is the most that is read")
        if member.file_size > DEFLATE_RATIO * member.compress_size + 64:
            raise FormatError(
                f"array {name!r} claims {member.file_size} bytes, which its {member.compress_size} cannot hold"
            )
        array = _read_array(io.BytesIO(archive.read(member)), member.file_size, name, pickled is not None)
        if isinstance(array, np.ndarray):
            arrays[name] = array
        elif pickled is not None:
            pickled[name] = array
    return arrays


def _read_array(stream: io.BytesIO, n_bytes: int, name: str, give_pickles: bool) -> np.ndarray | bytes:
    version = np.lib.format.read_magic(stream)
    if version not in {(1, 0), (2, 0)}:
        raise FormatError(f"array {name!r} has .npy version {version}, expected 1.0 or 2.0")
    header = np.lib.format.read_array_header_1_0 if version == (1, 0) else np.lib.format.read_array_header_2_0
    shape, fortran_order, dtype = header(stream)
    if dtype.hasobject and give_pickles:
        return stream.read()
    if dtype.hasobject:
        raise FormatError(f"array {name!r} holds Python objects, which are never read; expected numbers or text")
    if min(shape, default=0) < 0 or math.prod(shape) * dtype.itemsize != n_bytes - stream.tell():
        raise FormatError(
            f"array {name!r} has shape {shape} of {dtype}, which is not the {n_bytes - stream.tell()} bytes it takes"
        )
    flat = np.frombuffer(bytearray(stream.read()), dtype)
    return flat.reshape(shape[::-1]).T if fortran_order else flat.reshape(shape)


def as_float32(array: Num[np.ndarray, "*shape"]) -> Float[np.ndarray, "*shape"]:
    """Narrow real numbers from a file; what does not fit becomes infinite, which the checks that follow name, and warns nobody."""
    with np.errstate(over="ignore"):
        return np.ascontiguousarray(array, np.float32)


def write_npz(path: str | os.PathLike[str], arrays: Mapping[str, np.ndarray], *, compress: bool = False) -> None:
    """Write arrays as an `.npz` file, aside and then moved into place; no clock goes into the bytes.

    Args:
        path: the file.
        arrays: by name.
        compress: by deflate, which pays where arrays are mostly zeros.

    Raises:
        OSError: the file cannot be written.
    """
    with write_aside(path) as aside, aside.open("wb") as stream, zipfile.ZipFile(stream, "w") as archive:
        for name, array in arrays.items():
            entry = zipfile.ZipInfo(f"{name}.npy")
            entry.compress_type = zipfile.ZIP_DEFLATED if compress else zipfile.ZIP_STORED
            with archive.open(entry, "w", force_zip64=True) as member:
                np.lib.format.write_array(member, np.asanyarray(array), allow_pickle=False)
