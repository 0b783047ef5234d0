"""A pickle reader that builds numbers, text, and arrays of numbers, and runs nothing.

A pickle is a program. This one may only name the few things below, every one of them a passive record defined here; what the file calls
NumPy, SciPy or chumpy becomes such a record, and turns into an array only after the program has ended.
"""

from __future__ import annotations

import io
import math
import os
import pickle
import struct
from collections.abc import Callable
from pathlib import Path
from typing import Any, ClassVar

import numpy as np

from sacha_core.errors import FormatError

__all__ = ["ArrayRecord", "ChumpyRecord", "SparseRecord", "read_pickle"]

MAX_BYTES = 1 << 30  # FLAME's pickles have 50 to 110 MB
NUMBER_KINDS = "fiub"
FAULTS = (
    pickle.UnpicklingError, struct.error, EOFError, ValueError, TypeError, IndexError, KeyError, AttributeError, OverflowError, MemoryError,
)  # what the pickle machine raises on hostile bytes  # fmt: skip


class DtypeRecord:
    """A NumPy dtype: its code, and the byte order that its state brings."""

    def __init__(self, code: object = None, *_: object) -> None:
        self.code = code
        self.order: object = "<"

    def __setstate__(self, state: tuple[object, ...]) -> None:
        self.order = state[1]

    def dtype(self) -> np.dtype[Any]:
        """Give the dtype, if it is one of plain numbers."""
        code = self.code.decode("latin1") if isinstance(self.code, bytes) else self.code
        if not isinstance(code, str) or self.order not in {"<", ">", "|"}:
            raise FormatError("an array's dtype is not understood")
        kind = np.dtype(code).newbyteorder("<") if len(code) <= 3 and code[:1] in NUMBER_KINDS else None
        if kind is None:
            raise FormatError(f"an array is of dtype {code[:20]!r}, expected plain numbers")
        return kind.newbyteorder(">") if self.order == ">" else kind


class ArrayRecord:
    """A NumPy array: shape, dtype and bytes."""

    def __init__(self, *_: object) -> None:
        self.state: tuple[object, ...] = ()

    def __setstate__(self, state: tuple[object, ...]) -> None:
        self.state = state

    def array(self) -> np.ndarray:
        """Give the array, if its bytes are as many as its shape and dtype say."""
        if len(self.state) != 5:
            raise FormatError("an array has no contents")
        _, shape, dtype, fortran_order, data = self.state
        data = data.encode("latin1") if isinstance(data, str) else data
        if not (isinstance(dtype, DtypeRecord) and isinstance(data, bytes | bytearray) and isinstance(shape, tuple)):
            raise FormatError("an array's contents are not bytes of numbers")
        kind = dtype.dtype()
        if not all(type(side) is int and side >= 0 for side in shape) or math.prod(shape) * kind.itemsize != len(data):
            raise FormatError(f"an array of shape {shape} and {kind} has {len(data)} bytes")
        flat = np.frombuffer(bytearray(data), kind)
        return flat.reshape(shape[::-1]).T if fortran_order else flat.reshape(shape)


class StateRecord:
    """An object that keeps its attributes as the pickle gives them."""

    def __init__(self, *_: object) -> None:
        self.state: dict[str, object] = {}

    def __setstate__(self, state: object) -> None:
        parts = state if isinstance(state, tuple) else (state,)
        for part in parts:
            if isinstance(part, dict):
                self.state.update({str(key): value for key, value in part.items()})


class SparseRecord(StateRecord):
    """A SciPy matrix in compressed columns."""


class ChumpyRecord(StateRecord):
    """A chumpy array, or an operation on one."""

    kind = "Ch"


class ChumpySelectRecord(ChumpyRecord):
    """chumpy's choice of elements of another array."""

    kind = "Select"


def _array_of_buffer(data: object, dtype: object, shape: object, order: object) -> ArrayRecord:
    record = ArrayRecord()
    record.state = (1, shape, dtype, order == "F", data)
    return record


def _number(dtype: object, data: object) -> ArrayRecord:
    return _array_of_buffer(data, dtype, (), "C")


def _bytes_of_text(text: str, encoding: str) -> bytes:
    if encoding not in {"latin1", "latin-1"} or not isinstance(text, str):
        raise pickle.UnpicklingError("bytes are written in another way than pickles write them")
    return text.encode("latin1")


def _no_bytes() -> bytes:
    return b""


def _revived(kind: object, *_: object) -> object:
    for record in RECORDS:
        if kind is record:
            return record()
    raise pickle.UnpicklingError("an object of no known class is revived")


RECORDS = (DtypeRecord, ArrayRecord, StateRecord, SparseRecord, ChumpyRecord, ChumpySelectRecord)
NAMES: dict[tuple[str, str], Callable[..., object]] = {
    ("numpy", "dtype"): DtypeRecord,
    ("numpy", "ndarray"): ArrayRecord,
    ("_codecs", "encode"): _bytes_of_text,
    ("copy_reg", "_reconstructor"): _revived,
    ("copyreg", "_reconstructor"): _revived,
    ("__builtin__", "bytes"): _no_bytes,
    ("builtins", "bytes"): _no_bytes,
    ("__builtin__", "object"): StateRecord,
    ("builtins", "object"): StateRecord,
    ("chumpy.ch", "Ch"): ChumpyRecord,
    ("chumpy.reordering", "Select"): ChumpySelectRecord,
}
for core in ("numpy.core", "numpy._core"):
    NAMES[core + ".multiarray", "_reconstruct"] = ArrayRecord
    NAMES[core + ".multiarray", "scalar"] = _number
    NAMES[core + ".numeric", "_frombuffer"] = _array_of_buffer
for home in ("scipy.sparse.csc", "scipy.sparse._csc"):
    NAMES[home, "csc_matrix"] = SparseRecord
REFUSED = (
    pickle.INST,
    pickle.OBJ,
    pickle.PERSID,
    pickle.BINPERSID,
    pickle.EXT1,
    pickle.EXT2,
    pickle.EXT4,
    pickle.NEXT_BUFFER,
)


class _Unpickler(pickle._Unpickler):
    """The standard library's reader in Python, whose memory grows with the file only; a few instructions are narrowed or refused.

    What a program can call it must have named, so whatever it calls is in this module.
    """

    dispatch: ClassVar[dict[int, Callable[..., None]]] = dict(pickle._Unpickler.dispatch)
    stack: list[Any]
    append: Callable[[Any], None]

    def find_class(self, module: str, name: str) -> Any:  # the signature of the standard library
        if (module, name) not in NAMES:
            raise FormatError(
                f"the pickle asks for {module}.{name}, which is not among what a head model needs; nothing was run"
            )
        return NAMES[module, name]

    def new_object(self) -> None:
        """Make an empty record."""
        self.stack.pop()
        kind = self.stack.pop()
        if not any(kind is record for record in RECORDS):
            raise pickle.UnpicklingError("the pickle makes an object of no known class")
        self.append(kind())

    def build(self) -> None:
        """Give a record its state."""
        state = self.stack.pop()
        if not isinstance(self.stack[-1], RECORDS):
            raise pickle.UnpicklingError("the pickle changes an object of no known class")
        self.stack[-1].__setstate__(state)

    def refuse(self) -> None:
        """Stop at an instruction that no head model needs."""
        raise pickle.UnpicklingError("the pickle uses an instruction that no head model needs")

    dispatch[pickle.NEWOBJ[0]] = new_object
    dispatch[pickle.BUILD[0]] = build
    for code in (*REFUSED, pickle.NEWOBJ_EX):
        dispatch[code[0]] = refuse


def read_pickle(path: str | os.PathLike[str]) -> object:
    """Read a pickle of numbers, text, containers, and the records of this module. Python 2's text is taken as Latin-1.

    Raises:
        FormatError: it is damaged, or asks for anything else; the message names what.
        OSError: it cannot be read.
    """
    file = Path(path)
    with file.open("rb") as stream:
        data = stream.read(MAX_BYTES + 1)
    if len(data) > MAX_BYTES:
        raise FormatError(f"{file}: over {MAX_BYTES} bytes, which no head model has")
    try:
        return _Unpickler(io.BytesIO(data), encoding="latin1").load()
    except FormatError as error:
        raise FormatError(f"{file}: {error}") from error
    except FAULTS as error:
        raise FormatError(f"{file}: damaged pickle: {str(error)[:200] or type(error).__name__}") from error
