"""Numbered jobs that threads take one after the other inside a kernel, so that each thread makes one call for all it does.

Source: own.
"""

# ruff: noqa: ARG001 - Numba looks at names and numbers of arguments
from __future__ import annotations

from llvmlite import ir
from numba import types
from numba.extending import intrinsic

from sacha_core.parallel.kernels.lanes import address

__all__ = ["take_turn"]


@intrinsic
def take_turn(typingctx, counter):
    """Give the number in an int64 array of one, and add 1 to it: no two threads get the same."""
    if counter.dtype != types.int64:
        return None

    def codegen(context, builder, signature, args):
        first = ir.Constant(ir.IntType(64), 0)
        place = address(context, builder, signature.args[0], args[0], first)
        return builder.atomic_rmw("add", place, ir.Constant(ir.IntType(64), 1), "monotonic")

    return types.int64(counter), codegen
