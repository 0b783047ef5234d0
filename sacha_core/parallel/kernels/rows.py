"""Sixteen rows of a table as columns of lanes, and back: fewer than sixteen, rows to leave out, and wide rows.

`load_strided` and `store_interleaved` of `lanes` are a little quicker where sixteen rows of a few numbers are there for certain.

Source: own.
"""

# ruff: noqa: ARG001 - Numba looks at names and numbers of arguments
from __future__ import annotations

from llvmlite import ir
from numba import types
from numba.core import cgutils
from numba.extending import intrinsic

from sacha_core.parallel.kernels.lanes import (
    BITS,
    FLOAT,
    INT,
    LANES,
    VECTOR,
    address,
    lanes_below,
    lanes_type,
    mask_type,
    masked_store,
    shuffle,
    transposed,
)

__all__ = [
    "first_lanes", "load_at", "load_columns", "load_rows", "load_wide", "store_columns", "store_products", "store_wide",
]  # fmt: skip

NOTHING = ir.Constant(VECTOR, None)
UNDEFINED = ir.Constant(VECTOR, ir.Undefined)


@intrinsic
def first_lanes(typingctx, count):
    """Give the mask of the first `count` lanes."""

    def codegen(context, builder, signature, args):
        return lanes_below(builder, args[0])

    return mask_type(types.intp), codegen


@intrinsic(prefer_literal=True)
def load_columns(typingctx, array, index, width, count):
    """Give the columns of `count` rows of `width` (a literal, up to 4) numbers of a flat float32 array from `index` on, zero beyond."""
    if not isinstance(width, types.IntegerLiteral) or array.dtype != types.float32:
        return None
    step = width.literal_value

    def codegen(context, builder, signature, args):
        start = address(context, builder, signature.args[0], args[0], args[1])
        end = builder.mul(args[3], ir.Constant(args[3].type, step))
        parts = []
        for k in range(step):
            mask = lanes_below(builder, builder.sub(end, ir.Constant(end.type, k * LANES)))
            parts.append(masked_load(builder, builder.gep(start, [INT(k * LANES)]), mask))
        table = joined(builder, parts)
        columns = [shuffle(builder, table, table, [lane * step + k for lane in range(LANES)]) for k in range(step)]
        return context.make_tuple(builder, signature.return_type, columns)

    return types.UniTuple(lanes_type, step)(array, types.intp, width, types.intp), codegen


@intrinsic(prefer_literal=True)
def store_columns(typingctx, array, index, width, count, columns):
    """Write the first columns of `count` rows of `width` (a literal, up to 4) numbers; what the rows hold beyond stays."""
    if not isinstance(width, types.IntegerLiteral) or array.dtype != types.float32:
        return None
    step = width.literal_value

    def codegen(context, builder, signature, args):
        start = address(context, builder, signature.args[0], args[0], args[1])
        columns = cgutils.unpack_tuple(builder, args[4])
        table, parts = joined(builder, columns), []
        for k in range(step):
            places = [divmod(k * LANES + lane, step) for lane in range(LANES)]  # row and column of each lane
            value = shuffle(builder, table, table, [min(c, len(columns) - 1) * LANES + row for row, c in places])
            given = ir.Constant(BITS, [ir.IntType(1)(c < len(columns)) for _, c in places])
            place = builder.bitcast(builder.gep(start, [INT(k * LANES)]), VECTOR.as_pointer())
            parts.append((k * LANES, place, given, value))
        whole = builder.icmp_signed(">=", args[3], ir.Constant(args[3].type, LANES))
        with builder.if_else(whole, likely=True) as (plain, partial):  # masked stores take several times as long
            with plain:
                for _, place, given, value in parts:
                    kept = value if len(columns) == step else builder.select(given, value, builder.load(place, align=4))
                    builder.store(kept, place, align=4)
            with partial:
                end = builder.mul(args[3], ir.Constant(args[3].type, step))
                for first, place, given, value in parts:
                    below = lanes_below(builder, builder.sub(end, ir.Constant(end.type, first)))
                    masked_store(builder, place, builder.and_(below, given), value)
        return context.get_dummy_value()

    return types.void(array, types.intp, width, types.intp, columns), codegen


@intrinsic(prefer_literal=True)
def load_wide(typingctx, array, index, pitch, width, wanted):
    """Give `width` (a literal, up to 16) columns of sixteen rows `pitch` numbers apart; rows not wanted are zero and not touched."""
    if not isinstance(width, types.IntegerLiteral) or array.dtype != types.float32:
        return None
    numbers = width.literal_value

    def codegen(context, builder, signature, args):
        zeros = cgutils.global_constant(builder, "zero_row", ir.Constant(ir.ArrayType(FLOAT, LANES), [0.0] * LANES))
        instead = builder.bitcast(zeros, FLOAT.as_pointer())
        word = builder.bitcast(args[4], ir.IntType(LANES))
        mask = ir.Constant(BITS, [ir.IntType(1)(lane < numbers) for lane in range(LANES)])
        place, rows = address(context, builder, signature.args[0], args[0], args[1]), []
        for row in range(LANES):
            bit = builder.and_(word, ir.Constant(word.type, 1 << row))
            chosen = builder.select(builder.icmp_unsigned("!=", bit, ir.Constant(word.type, 0)), place, instead)
            rows.append(masked_load(builder, chosen, mask))
            place = builder.gep(place, [args[2]])
        return context.make_tuple(builder, signature.return_type, transposed(builder, rows)[:numbers])

    return types.UniTuple(lanes_type, numbers)(array, types.intp, types.intp, width, mask_type), codegen


@intrinsic
def load_at(typingctx, array, rows, at, count):
    """Give the numbers of a flat float32 array that `rows` names from `at` on; in the lanes beyond `count` the first of them."""

    def codegen(context, builder, signature, args):
        value = UNDEFINED
        for lane, place in enumerate(named_places(context, builder, signature.args, args, 1, 1)):
            value = builder.insert_element(value, builder.load(place, align=4), INT(lane))
        return value

    return lanes_type(array, rows, types.intp, types.intp), codegen


@intrinsic(prefer_literal=True)
def load_rows(typingctx, array, rows, at, count, width, stride):
    """Give sixteen rows of `width` (a literal, up to 16) numbers of a flat float32 array as columns.

    Every `stride`-th (a literal) number of `rows` from `at` on names a row; the lanes beyond `count` get the first.
    """
    literals = isinstance(width, types.IntegerLiteral) and isinstance(stride, types.IntegerLiteral)
    if not literals or array.dtype != types.float32:
        return None
    numbers, step = width.literal_value, stride.literal_value

    def codegen(context, builder, signature, args):
        mask = ir.Constant(BITS, [ir.IntType(1)(lane < numbers) for lane in range(LANES)])
        places = named_places(context, builder, signature.args, args, numbers, step)
        table = transposed(builder, [masked_load(builder, place, mask) for place in places])
        return context.make_tuple(builder, signature.return_type, table[:numbers])

    return types.UniTuple(lanes_type, numbers)(array, rows, types.intp, types.intp, width, stride), codegen


def named_places(context, builder, kinds, args, width, step):
    """Give where rows begin whose numbers lie in another array; arguments of `load_rows`, and their types."""
    array, rows, at, count = args[:4]
    places = []
    for lane in range(LANES):
        inside = builder.icmp_signed(">", count, ir.Constant(count.type, lane))
        offset = builder.select(inside, ir.Constant(at.type, lane * step), ir.Constant(at.type, 0))
        row = builder.load(address(context, builder, kinds[1], rows, builder.add(at, offset)))
        start = builder.mul(context.cast(builder, row, kinds[1].dtype, types.intp), ir.Constant(at.type, width))
        places.append(address(context, builder, kinds[0], array, start))
    return places


@intrinsic
def store_wide(typingctx, array, index, count, columns):
    """Write the first `count` of sixteen rows, one after the other, of as many numbers (eight to sixteen) as there are columns."""
    if array.dtype != types.float32:
        return None

    def codegen(context, builder, signature, args):
        columns, count = cgutils.unpack_tuple(builder, args[3]), args[2]
        place, width = address(context, builder, signature.args[0], args[0], args[1]), len(columns)
        mask = ir.Constant(BITS, [ir.IntType(1)(lane < width) for lane in range(LANES)])
        for lane, row in enumerate(transposed(builder, columns + [UNDEFINED] * (LANES - width))):
            number = ir.Constant(count.type, lane + 1)
            pointer = builder.bitcast(place, VECTOR.as_pointer())
            if number.constant < LANES:
                with builder.if_then(builder.icmp_signed(">", count, number), likely=True):
                    builder.store(row, pointer, align=4)  # of which the next row writes over what is too much
            with builder.if_then(builder.icmp_signed("==" if number.constant < LANES else ">=", count, number)):
                masked_store(builder, pointer, mask, row)
            place = builder.gep(place, [INT(width)])
        return context.get_dummy_value()

    return types.void(array, types.intp, types.intp, columns), codegen


@intrinsic
def store_products(typingctx, array, index, values, factors):
    """Write for each of sixteen lanes a table of all products of values and factors, row after row of factors.

    `values` are up to sixteen and `factors` up to four vectors. Tables lie one after the other and are written sixteen numbers at a time
    from `index` on, as they will be read: what is read across two writes has to wait for both.
    """
    if array.dtype != types.float32:
        return None

    def codegen(context, builder, signature, args):
        values, factors = (cgutils.unpack_tuple(builder, arg) for arg in args[2:])
        width, numbers = len(factors), len(values) * len(factors)
        rows = transposed(builder, (values + [UNDEFINED] * LANES)[:LANES])
        table = joined(builder, factors)
        parts = [
            shuffle(builder, table, table, [(k * LANES + lane) % width * LANES + (k * LANES + lane) // width for lane in range(LANES)])
            for k in range(width)
        ]  # fmt: skip
        place = address(context, builder, signature.args[0], args[0], args[1])
        for first in range(0, LANES * numbers, LANES):
            places = [divmod(first + lane, numbers) for lane in range(LANES)]  # row, and place in its table
            value = picked(builder, rows, [row * LANES + at // width for row, at in places])
            factor = picked(builder, parts, [row * width + at % width for row, at in places])
            target = builder.bitcast(builder.gep(place, [INT(first)]), VECTOR.as_pointer())
            builder.store(builder.fmul(value, factor), target, align=4)
        return context.get_dummy_value()

    return types.void(array, types.intp, values, factors), codegen


def picked(builder, vectors, numbers):
    """Give sixteen numbers of a row of vectors, of one or of two of them."""
    first, last = min(numbers) // LANES, max(numbers) // LANES
    inside = {number // LANES for number in numbers}
    assert inside <= {first, last}
    places = [number % LANES + (LANES if number // LANES == last != first else 0) for number in numbers]
    return shuffle(builder, vectors[first], vectors[last], places)


def joined(builder, parts):
    """Give up to four vectors as one of 64 lanes."""
    parts = [*parts, *[UNDEFINED] * (4 - len(parts))]
    halves = [shuffle(builder, parts[k], parts[k + 1], range(2 * LANES)) for k in (0, 2)]
    return shuffle(builder, *halves, range(4 * LANES))


def masked_load(builder, pointer, mask):
    pointer = builder.bitcast(pointer, VECTOR.as_pointer())
    shape = ir.FunctionType(VECTOR, [pointer.type, INT, BITS, VECTOR])
    function = cgutils.get_or_insert_function(builder.module, shape, "llvm.masked.load.v16f32.p0")
    return builder.call(function, [pointer, INT(4), mask, NOTHING])
