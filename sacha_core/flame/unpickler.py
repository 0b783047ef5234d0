"""A pickle reader that builds numbers, text, and arrays of numbers, and runs nothing.

A pickle is a program. This one may only name the few things below, every one of them a passive record defined here; what the file calls
NumPy, SciPy or chumpy becomes such a record, and turns into an array only after the program has ended.
"""

from __future__ import annotations

import io
import os
import pickle
import struct
from collections.abc import Callable
from pathlib import Path
from typing import Any, ClassVar

import numpy as np

from sacha_core.errors import FormatError

__all__ = ["ArrayRecord", "ChumpyRecord", "SparseRecord", "parse_pickle", "read_pickle"]

MAX_BYTES = 1 << 30  # FLAME's pickles have 50 to 110 MB
NUMBER_CODES = frozenset(["f2", "f4", "f8", "i1", "i2", "i4", "i8", "u1", "u2", "u4", "u8", "b1"])
MAX_SIDE = 1 << 31  # of an array
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
        if not isinstance(code, str) or self.order not in ("<", ">", "|"):  # a tuple: what is asked may have no hash
            raise FormatError("an array's dtype is not understood")
        if code not in NUMBER_CODES:
            raise FormatError(f"an array is of dtype {code[:20]!r}, expected plain numbers")
        return np.dtype(code).newbyteorder(">" if self.order == ">" else "<")


class ArrayRecord:
    """A NumPy array: shape, dtype and bytes."""

    def __init__(self, *_: object) -> None:
        self.state: object = ()

    def __setstate__(self, state: object) -> None:
        self.state = state

    def array(self) -> np.ndarray:
        """Give the array, if its bytes are as many as its shape and dtype say."""
        if not isinstance(self.state, tuple) or len(self.state) != 5:
            raise FormatError("an array has no contents")
        _, shape, dtype, fortran_order, data = self.state
        if not (isinstance(dtype, DtypeRecord) and isinstance(data, str | bytes | bytearray)):
            raise FormatError("an array's contents are not bytes of numbers")
        if not isinstance(shape, tuple) or not all(type(side) is int and 0 <= side < MAX_SIDE for side in shape):
            raise FormatError("an array's shape is no tuple of sizes")
        kind = dtype.dtype()
        try:
            flat = np.frombuffer(data.encode("latin1") if isinstance(data, str) else data, kind).copy()
            return flat.reshape(shape[::-1]).T if fortran_order else flat.reshape(shape)
        except ValueError as error:
            raise FormatError(
                f"an array of shape {str(shape)[:80]} and {kind} has contents of {len(data)} bytes"
            ) from error


class StateRecord:
    """An object that keeps its attributes as the pickle gives them."""

    def __init__(self, *_: object) -> None:
        self.state: dict[str, object] = {}

    def __setstate__(self, state: object) -> None:
        # Slots may follow the attributes; no object that is kept here has any
        attributes = state[0] if isinstance(state, tuple) and state else state
        if isinstance(attributes, dict):
            self.state = attributes


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


def _bytes_of_text(text: object, encoding: object) -> str:
    """Keep bytes as the text that they are written as: a program may ask for the same ones a million times."""
    if not (isinstance(text, str) and isinstance(encoding, str) and encoding in {"latin1", "latin-1"}):
        raise pickle.UnpicklingError("bytes are written in another way than pickles write them")
    return text


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
    pickle.NEWOBJ_EX,
    pickle.EMPTY_SET,
    pickle.ADDITEMS,
    pickle.FROZENSET,
)


class _Unpickler(pickle._Unpickler):
    """The standard library's reader in Python, whose memory grows with the file only; a few instructions are narrowed or refused.

    What a program can call it must have named, so whatever it calls is in this module.
    """

    dispatch: ClassVar[dict[int, Callable[..., None]]] = dict(pickle._Unpickler.dispatch)
    stack: list[Any]
    append: Callable[[Any], None]
    read: Callable[[int], bytes]
    pop_mark: Callable[[], list[Any]]

    def find_class(self, module: str, name: str) -> Any:  # the signature of the standard library
        if (module, name) not in NAMES:
            raise FormatError(
                f"the pickle asks for {f'{module}.{name}'[:120]}, which is not among what a head model needs; nothing was run"
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

    def set_item(self) -> None:
        """Put one entry into a dictionary."""
        value = self.stack.pop()
        self.put([self.stack.pop(), value])

    def set_items(self) -> None:
        """Put entries into a dictionary."""
        self.put(self.pop_mark())

    def make_dictionary(self) -> None:
        """Make a dictionary with entries."""
        items = self.pop_mark()
        self.append({})
        self.put(items)

    def put(self, items: list[Any]) -> None:
        """Put keys and values into the dictionary on top; keys must be text, since hashing deep tuples overruns the machine's stack."""
        into = self.stack[-1]
        if not isinstance(into, dict) or len(items) % 2 or not all(isinstance(key, str) for key in items[::2]):
            raise pickle.UnpicklingError("a dictionary is filled with something else than names and values")
        into.update(zip(items[::2], items[1::2], strict=True))

    def array_of_bytes(self) -> None:
        """Read bytes that may be changed; the standard library's reader takes memory for as many as the file only claims."""
        (n_bytes,) = struct.unpack("<Q", self.read(8))
        self.append(bytearray(self.read(n_bytes)))

    def refuse(self) -> None:
        """Stop at an instruction that no head model needs."""
        raise pickle.UnpicklingError("the pickle uses an instruction that no head model needs")

    dispatch[pickle.NEWOBJ[0]] = new_object
    dispatch[pickle.BUILD[0]] = build
    dispatch[pickle.SETITEM[0]] = set_item
    dispatch[pickle.SETITEMS[0]] = set_items
    dispatch[pickle.DICT[0]] = make_dictionary
    dispatch[pickle.BYTEARRAY8[0]] = array_of_bytes
    for code in REFUSED:
        dispatch[code[0]] = refuse


def read_pickle(path: str | os.PathLike[str]) -> object:
    """Read a pickle of numbers, text, containers, and the records of this module. Python 2's text is taken as Latin-1.

    Raises:
        FormatError: it is damaged, or asks for anything else; the message names what.
        OSError: it cannot be read.
    """
    file = Path(path)
    n_bytes = file.stat().st_size
    if n_bytes > MAX_BYTES:
        raise FormatError(f"{file}: {n_bytes} bytes, which no head model has; expected at most {MAX_BYTES}")
    with file.open("rb") as stream:
        data = stream.read(n_bytes)
    try:
        return parse_pickle(data)
    except FormatError as error:
        raise FormatError(f"{file}: {error}") from error


def parse_pickle(data: bytes) -> object:
    """Read a pickle as `read_pickle` does, from its bytes.

    Raises:
        FormatError: it is damaged, or asks for anything else than arrays; the message names what.
    """
    try:
        return _Unpickler(io.BytesIO(data), encoding="latin1").load()
    except FAULTS as error:
        raise FormatError(f"damaged pickle ({type(error).__name__}: {str(error)[:200]})") from error
