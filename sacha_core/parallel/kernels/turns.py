"""Numbered jobs that threads take one after the other inside a kernel, so that each thread makes one call for all it does.

Work of several parts, each of which needs all of the one before, wants a row of `new_turns` for each. A thread waits for jobs that others
have taken, and never for a thread that has not come yet: one that the system keeps elsewhere holds nobody up.

Source: own.
"""

# ruff: noqa: ARG001 - Numba looks at names and numbers of arguments
from __future__ import annotations

import sys

import numpy as np
from llvmlite import ir
from numba import types
from numba.core import cgutils
from numba.extending import intrinsic

from sacha_core.parallel.kernels.lanes import address, inlined

__all__ = ["DONE", "finish_turn", "new_turns", "take_turn", "wait_for_turns"]

DONE = 8  # where the number of jobs done lies in a row, on a cache line of its own
LINE = 16  # numbers of a row
PATIENCE = 2000  # looks, some microseconds, until a thread lets others have its processor


def new_turns(parts: int):
    """Give a row of counters for each part of some work: no job is taken, none is done."""
    return np.zeros((parts, LINE), np.int64)


@intrinsic
def take_turn(typingctx, counter):
    """Give the first number in an int64 array, and add 1 to it: no two threads get the same."""
    if counter.dtype != types.int64:
        return None

    def codegen(context, builder, signature, args):
        return add_one(context, builder, signature.args[0], args[0], 0, "monotonic")

    return types.int64(counter), codegen


@intrinsic
def finish_turn(typingctx, counter):
    """Count a job of a row as done: who learns of it sees all that was written before."""
    if counter.dtype != types.int64:
        return None

    def codegen(context, builder, signature, args):
        return add_one(context, builder, signature.args[0], args[0], DONE, "release")

    return types.int64(counter), codegen


@intrinsic
def turns_done(typingctx, counter):
    """Give the number of jobs of a row that are done, and see what they wrote."""
    if counter.dtype != types.int64:
        return None

    def codegen(context, builder, signature, args):
        place = address(context, builder, signature.args[0], args[0], ir.Constant(ir.IntType(64), DONE))
        return builder.load_atomic(place, "acquire", 8)

    return types.int64(counter), codegen


@intrinsic
def let_others_run(typingctx):
    """Give the processor to another thread that is waiting for one, where the system has a name for that."""

    def codegen(context, builder, signature, args):
        if sys.platform != "win32":
            shape = ir.FunctionType(ir.IntType(32), [])
            builder.call(cgutils.get_or_insert_function(builder.module, shape, "sched_yield"), [])
        return context.get_dummy_value()

    return types.void(), codegen


@inlined
def wait_for_turns(counter, jobs):
    """Wait until so many jobs of a row are done, which all have been taken."""
    looks = 0
    while turns_done(counter) < jobs:
        looks += 1
        if looks > PATIENCE:
            let_others_run()


def add_one(context, builder, kind, counter, at, order):
    """Add 1 to a number of an array, and give what it was."""
    place = address(context, builder, kind, counter, ir.Constant(ir.IntType(64), at))
    return builder.atomic_rmw("add", place, ir.Constant(ir.IntType(64), 1), order)
