"""Arguments laid out once as machine code has them, for kernels that are called with the same many again and again.

Who calls a kernel has each array looked at: its type, its shape, who owns it. For a hundred of them that takes some ten microseconds, and
four times as long where other kernels have driven them out of the caches; and each thread does so while it holds Python's lock, one after
the other. What is packed is one array, whatever it holds.

Source: own.
"""

# ruff: noqa: ARG001 - Numba looks at names and numbers of arguments
from __future__ import annotations

from hashlib import sha256
from typing import Any

import numpy as np
from numba import typeof, types
from numba.core import cgutils
from numba.core.registry import cpu_target
from numba.extending import intrinsic

from sacha_core.parallel.kernels.kernel import kernel

__all__ = ["Packed", "unpacked"]

WORD = 8  # bytes: of pointers and lengths, to whose multiples all is aligned
KINDS: dict[str, Any] = {}  # types of what was packed, by the name that tells them apart


class Packed:
    """A tuple, perhaps of tuples, of arrays and numbers.

    Numbers are those of now. Of arrays only the place is kept, and that they live on.

    Args:
        value: the tuple.

    Attributes:
        table: for kernels, which get the tuple back from `unpacked`; as long as this object lives.
    """

    def __init__(self, value: tuple[Any, ...]) -> None:
        self._value = value  # whose arrays nobody else may hold
        kind, context = typeof(value), cpu_target.target_context
        name = f"tuple_{sha256(str(kind).encode()).hexdigest()[:24]}"
        words = -(-context.get_abi_sizeof(context.get_data_type(kind)) // WORD)
        KINDS[name] = kind
        self.table = np.zeros(1, [(name, np.int64, (words,))])
        pack(self.table, value)


def unowned(context, builder, kind, value):
    """Give the same tuple, of whose arrays nobody counts the owners."""
    if isinstance(kind, types.BaseTuple):
        parts = [unowned(context, builder, part, builder.extract_value(value, k)) for k, part in enumerate(kind.types)]
        return context.make_tuple(builder, kind, parts)
    if isinstance(kind, types.Array):
        array = context.make_array(kind)(context, builder, value)
        array.meminfo, array.parent = (cgutils.get_null_value(owner.type) for owner in (array.meminfo, array.parent))
        return array._getvalue()
    return value


def place_in(context, builder, kind, table, inner):
    """Give where a table has its tuple."""
    start = context.make_array(kind)(context, builder, table).data
    return builder.bitcast(start, context.get_data_type(inner).as_pointer())


@intrinsic
def write_whole(typingctx, table, value):
    """Write a tuple to a table as machine code has it."""

    def codegen(context, builder, signature, args):
        plain = unowned(context, builder, value, args[1])
        data = context.data_model_manager[value].as_data(builder, plain)
        builder.store(data, place_in(context, builder, table, args[0], value), align=WORD)
        return context.get_dummy_value()

    return types.void(table, value), codegen


@kernel
def pack(table, value):
    """Write a tuple to a table as machine code has it."""
    write_whole(table, value)


@intrinsic
def unpacked(typingctx, table):
    """Give the tuple that a table has."""
    inner = KINDS[next(iter(table.dtype.fields))]

    def codegen(context, builder, signature, args):
        data = builder.load(place_in(context, builder, table, args[0], inner), align=WORD)
        return context.data_model_manager[inner].from_data(builder, data)

    return inner(table), codegen
