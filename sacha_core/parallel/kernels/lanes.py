"""Sixteen float32 numbers as one value, for Numba kernels.

The loop vectoriser is a matter of luck: one float64 literal, one possible alias or one processor that "prefers" 256-bit registers, and the
inner loop falls back to scalars. Here a kernel says what it wants: `a * b + c` on sixteen lanes is one LLVM vector instruction each, which
becomes one 512-bit, two 256-bit or four 128-bit instructions, whatever the processor has.

No fast-math flag is set, so every kernel that writes the same expression gets the same bits: the backward pass relies on it when it
repeats the forward pass. Where a fused multiply-add is wanted, say `fma`.

Source: own.
"""

# ruff: noqa: ARG001, PLW0108 - Numba looks at names and numbers of arguments, and overloads must be Python functions
from __future__ import annotations

import operator

import numpy as np
from llvmlite import ir
from numba import njit, types
from numba.core import cgutils
from numba.extending import intrinsic, models, overload, register_model

__all__ = [
    "LANES",
    "absolute",
    "bits",
    "ceiling",
    "every",
    "exponent",
    "floor",
    "fma",
    "inlined",
    "load",
    "load_bits",
    "load_first",
    "load_halves",
    "load_spread",
    "load_strided",
    "lowest_bit",
    "mantissa",
    "maximum",
    "minimum",
    "moved_up",
    "number",
    "power_of_two",
    "prefetch",
    "prefetch_to_write",
    "ramp",
    "select",
    "some",
    "splat",
    "square_root",
    "store",
    "store_first",
    "store_halves",
    "store_interleaved",
    "store_key",
    "store_transposed",
    "store_whole",
    "sums",
    "within",
    "zeros",
]

LANES = 16
WITHIN = {
    "no_cpython_wrapper": True,
    "no_cfunc_wrapper": True,
}  # for what only kernels call: compiles a good deal faster
within = njit(**WITHIN)
inlined = njit(forceinline=True, **WITHIN)  # a call that stays costs, for each array, locked counting of references
FLOAT = ir.FloatType()
INT = ir.IntType(32)
VECTOR = ir.VectorType(FLOAT, LANES)
INTS = ir.VectorType(INT, LANES)
BITS = ir.VectorType(ir.IntType(1), LANES)
LANE_KINDS = {
    types.float32: (FLOAT, "f32", 4),
    types.uint8: (ir.IntType(8), "i8", 1),
}  # what `load` reads, its name and bytes


class LanesType(types.Type):
    """Numba's type of sixteen float32."""

    def __init__(self):
        super().__init__(name="float32x16")


class MaskType(types.Type):
    """Numba's type of sixteen truth values."""

    def __init__(self):
        super().__init__(name="boolx16")


lanes_type = LanesType()
mask_type = MaskType()


@register_model(LanesType)
class LanesModel(models.PrimitiveModel):
    """Sixteen float32 lie in one vector register."""

    def __init__(self, dmm, fe_type):
        super().__init__(dmm, fe_type, VECTOR)


@register_model(MaskType)
class MaskModel(models.PrimitiveModel):
    """Sixteen truth values lie in one mask register."""

    def __init__(self, dmm, fe_type):
        super().__init__(dmm, fe_type, BITS)


# ---- memory -------------------------------------------------------------------------------------------------------------------------


def address(context, builder, array_type, array, index):
    data = context.make_array(array_type)(context, builder, array).data
    return builder.gep(data, [index], inbounds=True)


@intrinsic
def load(typingctx, array, index):
    """Give the sixteen numbers of a flat array, float32 or bytes, that begin at `index`."""
    lane, _, width = LANE_KINDS[array.dtype]

    def codegen(context, builder, signature, args):
        pointer = address(context, builder, signature.args[0], args[0], args[1])
        kind = ir.VectorType(lane, LANES)
        value = builder.load(builder.bitcast(pointer, kind.as_pointer()), align=width)
        return value if lane == FLOAT else builder.uitofp(value, VECTOR)

    return lanes_type(array, types.intp), codegen


@intrinsic
def load_first(typingctx, array, index, count):
    """Give what `load` does, of which only the first `count` numbers are read; zero in the lanes beyond."""
    lane, name, width = LANE_KINDS[array.dtype]

    def codegen(context, builder, signature, args):
        pointer = address(context, builder, signature.args[0], args[0], args[1])
        kind = ir.VectorType(lane, LANES)
        pointer = builder.bitcast(pointer, kind.as_pointer())
        shape = ir.FunctionType(kind, [pointer.type, INT, BITS, kind])
        function = cgutils.get_or_insert_function(builder.module, shape, f"llvm.masked.load.v16{name}.p0")
        mask = lanes_below(builder, args[2])
        value = builder.call(function, [pointer, INT(width), mask, ir.Constant(kind, None)])
        return value if lane == FLOAT else builder.uitofp(value, VECTOR)

    return lanes_type(array, types.intp, types.intp), codegen


def lanes_below(builder, count):
    """Give the mask of the first `count` lanes."""
    empty = ir.Constant(INTS, ir.Undefined)
    limit = builder.insert_element(empty, builder.trunc(count, INT), INT(0))
    limit = builder.shuffle_vector(limit, empty, ir.Constant(INTS, None))
    return builder.icmp_signed(">", limit, ir.Constant(INTS, [INT(lane) for lane in range(LANES)]))


@intrinsic
def store(typingctx, array, index, value):
    """Write sixteen numbers to a flat float32 array from `index` on."""

    def codegen(context, builder, signature, args):
        pointer = address(context, builder, signature.args[0], args[0], args[1])
        builder.store(args[2], builder.bitcast(pointer, VECTOR.as_pointer()), align=4)
        return context.get_dummy_value()

    return types.void(array, types.intp, lanes_type), codegen


@intrinsic
def store_first(typingctx, array, index, count, value):
    """Write the first `count` of sixteen numbers to a flat float32 array from `index` on."""

    def codegen(context, builder, signature, args):
        pointer = address(context, builder, signature.args[0], args[0], args[1])
        pointer = builder.bitcast(pointer, VECTOR.as_pointer())
        whole = builder.icmp_signed(">=", args[2], ir.Constant(args[2].type, LANES))
        with builder.if_else(whole, likely=True) as (plain, partial):  # masked stores take several times as long
            with plain:
                builder.store(args[3], pointer, align=4)
            with partial:
                masked_store(builder, pointer, lanes_below(builder, args[2]), args[3])
        return context.get_dummy_value()

    return types.void(array, types.intp, types.intp, lanes_type), codegen


def masked_store(builder, pointer, mask, value):
    """Write the lanes of a mask."""
    shape = ir.FunctionType(ir.VoidType(), [VECTOR, pointer.type, INT, BITS])
    function = cgutils.get_or_insert_function(builder.module, shape, "llvm.masked.store.v16f32.p0")
    builder.call(function, [value, pointer, INT(4), mask])


@intrinsic
def load_spread(typingctx, array, index):
    """Give one number of a flat float32 array, repeated in every lane."""

    def codegen(context, builder, signature, args):
        return spread(builder, builder.load(address(context, builder, signature.args[0], args[0], args[1]), align=4))

    return lanes_type(array, types.intp), codegen


@intrinsic(prefer_literal=True)
def load_strided(typingctx, array, index, stride, part):
    """Give every `stride`-th number from `index + part` on: one column of sixteen rows; `stride` and `part` are literals."""
    if not (isinstance(stride, types.IntegerLiteral) and isinstance(part, types.IntegerLiteral)):
        return None
    step, offset = stride.literal_value, part.literal_value

    def codegen(context, builder, signature, args):
        pointer = address(context, builder, signature.args[0], args[0], args[1])
        wide = ir.VectorType(FLOAT, LANES * step)
        rows = builder.load(builder.bitcast(pointer, wide.as_pointer()), align=4)
        return shuffle(builder, rows, rows, [lane * step + offset for lane in range(LANES)])

    return lanes_type(array, types.intp, stride, part), codegen


def shuffle(builder, a, b, order):
    return builder.shuffle_vector(a, b, ir.Constant(ir.VectorType(INT, len(order)), [INT(k) for k in order]))


@intrinsic
def store_interleaved(typingctx, array, index, columns):
    """Write sixteen rows of two, three or four numbers, given as a tuple of columns."""

    def codegen(context, builder, signature, args):
        pointer = address(context, builder, signature.args[0], args[0], args[1])
        parts = cgutils.unpack_tuple(builder, args[2])
        order = [part * LANES + lane for lane in range(LANES) for part in range(len(parts))]
        parts += [ir.Constant(VECTOR, ir.Undefined)] * (4 - len(parts))
        pairs = [shuffle(builder, parts[k], parts[k + 1], list(range(2 * LANES))) for k in (0, 2)]
        rows = shuffle(builder, *pairs, order)
        builder.store(rows, builder.bitcast(pointer, rows.type.as_pointer()), align=4)
        return context.get_dummy_value()

    return types.void(array, types.intp, columns), codegen


@intrinsic
def load_halves(typingctx, array, low, high):
    """Give eight numbers that begin at `low` and eight that begin at `high`."""

    def codegen(context, builder, signature, args):
        half = ir.VectorType(FLOAT, LANES // 2).as_pointer()
        places = [address(context, builder, signature.args[0], args[0], args[k]) for k in (1, 2)]
        parts = [builder.load(builder.bitcast(place, half), align=4) for place in places]
        return shuffle(builder, *parts, list(range(LANES)))

    return lanes_type(array, types.intp, types.intp), codegen


@intrinsic
def store_halves(typingctx, array, low, high, value):
    """Write the first eight lanes from `low` on and the others from `high` on."""

    def codegen(context, builder, signature, args):
        for part, index in enumerate(args[1:3]):
            eight = shuffle(builder, args[3], args[3], list(range(8 * part, 8 * part + 8)))
            place = address(context, builder, signature.args[0], args[0], index)
            builder.store(eight, builder.bitcast(place, eight.type.as_pointer()), align=4)
        return context.get_dummy_value()

    return types.void(array, types.intp, types.intp, lanes_type), codegen


def transposed(builder, level):
    """Give the columns of sixteen vectors as vectors."""
    for width in (1, 2, 4, 8):  # swap blocks of this width across the diagonal
        low = [k if k & width == 0 else k - width + LANES for k in range(LANES)]
        swapped = list(level)
        for k in range(LANES):
            if k & width == 0:
                swapped[k] = shuffle(builder, level[k], level[k + width], low)
                swapped[k + width] = shuffle(builder, level[k], level[k + width], [j + width for j in low])
        level = swapped
    return level


@intrinsic
def store_transposed(typingctx, array, index, columns):
    """Write sixteen rows of sixteen numbers, given as a tuple of sixteen columns."""

    def codegen(context, builder, signature, args):
        for row, value in enumerate(transposed(builder, cgutils.unpack_tuple(builder, args[2]))):
            offset = builder.add(args[1], ir.Constant(args[1].type, row * LANES))
            place = address(context, builder, signature.args[0], args[0], offset)
            builder.store(value, builder.bitcast(place, VECTOR.as_pointer()), align=4)
        return context.get_dummy_value()

    return types.void(array, types.intp, columns), codegen


@intrinsic
def load_bits(typingctx, array, index, shift, mask):
    """Give (word >> shift) & mask of sixteen words of a flat int64 array from `index` on."""

    def codegen(context, builder, signature, args):
        pointer = address(context, builder, signature.args[0], args[0], args[1])
        wide = ir.VectorType(ir.IntType(64), LANES)
        words = builder.trunc(builder.load(builder.bitcast(pointer, wide.as_pointer()), align=8), INTS)
        amount, kept = (spread_whole(builder, builder.trunc(a, INT)) for a in args[2:])
        return builder.sitofp(builder.and_(builder.lshr(words, amount), kept), VECTOR)

    return lanes_type(array, types.intp, types.intp, types.intp), codegen


def spread_whole(builder, scalar):
    empty = ir.Constant(INTS, ir.Undefined)
    return builder.shuffle_vector(builder.insert_element(empty, scalar, INT(0)), empty, ir.Constant(INTS, None))


@intrinsic
def store_whole(typingctx, array, index, value):
    """Write sixteen whole numbers to a flat int32 array from `index` on."""

    def codegen(context, builder, signature, args):
        pointer = address(context, builder, signature.args[0], args[0], args[1])
        builder.store(builder.fptosi(args[2], INTS), builder.bitcast(pointer, INTS.as_pointer()), align=4)
        return context.get_dummy_value()

    return types.void(array, types.intp, lanes_type), codegen


@intrinsic
def store_key(typingctx, array, index, tile, first, last):
    """Write tile << 10 | first << 5 | last of sixteen triples of whole numbers to a flat int32 array from `index` on."""

    def codegen(context, builder, signature, args):
        pointer = address(context, builder, signature.args[0], args[0], args[1])
        tile, first, last = (builder.fptosi(value, INTS) for value in args[2:])
        word = builder.or_(
            builder.shl(tile, ir.Constant(INTS, [INT(10)] * LANES)),
            builder.shl(first, ir.Constant(INTS, [INT(5)] * LANES)),
        )
        builder.store(builder.or_(word, last), builder.bitcast(pointer, INTS.as_pointer()), align=4)
        return context.get_dummy_value()

    return types.void(array, types.intp, lanes_type, lanes_type, lanes_type), codegen


def prefetching(name, writing):
    """Make the intrinsic that asks for a cache line, to be read or to be written."""

    @intrinsic
    def function(typingctx, array, index):
        def codegen(context, builder, signature, args):
            data = context.make_array(signature.args[0])(context, builder, args[0]).data
            pointer = builder.bitcast(builder.gep(data, [args[1]]), ir.PointerType(ir.IntType(8)))
            kind = ir.FunctionType(ir.VoidType(), [pointer.type, INT, INT, INT])
            called = cgutils.get_or_insert_function(builder.module, kind, "llvm.prefetch.p0")
            builder.call(called, [pointer, INT(writing), INT(3), INT(1)])
            return context.get_dummy_value()

        return types.void(array, types.intp), codegen

    function.__doc__ = name
    return function


prefetch = prefetching(
    "Ask for the cache line of `array[index]`; any index is allowed, and the contents are not touched.", 0
)
prefetch_to_write = prefetching("Ask for the cache line of `array[index]` to be written; any index is allowed.", 1)


@intrinsic(prefer_literal=True)
def moved_up(typingctx, x, by):
    """Give the lanes moved up by a literal, zeros below."""
    if not isinstance(by, types.IntegerLiteral):
        return None
    step = by.literal_value

    def codegen(context, builder, signature, args):
        order = [lane - step if lane >= step else LANES for lane in range(LANES)]
        return shuffle(builder, args[0], ir.Constant(VECTOR, None), order)

    return lanes_type(lanes_type, by), codegen


# ---- arithmetic ---------------------------------------------------------------------------------------------------------------------


def spread(builder, scalar):
    empty = ir.Constant(VECTOR, ir.Undefined)
    first = builder.insert_element(empty, scalar, INT(0))
    return builder.shuffle_vector(first, empty, ir.Constant(INTS, None))


@intrinsic
def splat(typingctx, number):
    """Repeat a number in every lane."""

    def codegen(context, builder, signature, args):
        return spread(builder, context.cast(builder, args[0], signature.args[0], types.float32))

    return lanes_type(number), codegen


@intrinsic
def ramp(typingctx):
    """Give 0, 1, ... 15."""

    def codegen(context, builder, signature, args):
        return ir.Constant(VECTOR, [FLOAT(float(lane)) for lane in range(LANES)])

    return lanes_type(), codegen


@within
def zeros():
    """Give sixteen zeros."""
    return splat(np.float32(0))


def unary(name, kind):
    """Make the intrinsic of one of LLVM's functions of one vector."""

    @intrinsic
    def function(typingctx, x):
        def codegen(context, builder, signature, args):
            called = cgutils.get_or_insert_function(builder.module, ir.FunctionType(VECTOR, [VECTOR]), kind)
            return builder.call(called, args)

        return lanes_type(lanes_type), codegen

    function.__doc__ = name
    return function


absolute = unary("Absolute value.", "llvm.fabs.v16f32")
square_root = unary("Square root, correctly rounded.", "llvm.sqrt.v16f32")
floor = unary("Largest whole number not above.", "llvm.floor.v16f32")
ceiling = unary("Smallest whole number not below.", "llvm.ceil.v16f32")


@intrinsic
def fma(typingctx, a, b, c):
    """Give a b + c, rounded once where the processor can."""

    def codegen(context, builder, signature, args):
        kind = ir.FunctionType(VECTOR, [VECTOR] * 3)
        return builder.call(cgutils.get_or_insert_function(builder.module, kind, "llvm.fmuladd.v16f32"), args)

    return lanes_type(lanes_type, lanes_type, lanes_type), codegen


@intrinsic
def minimum(typingctx, a, b):
    """Give the smaller of a and b; b where a is not a number."""

    def codegen(context, builder, signature, args):
        return builder.select(builder.fcmp_ordered("<", *args), *args)

    return lanes_type(lanes_type, lanes_type), codegen


@intrinsic
def maximum(typingctx, a, b):
    """Give the larger of a and b; b where a is not a number."""

    def codegen(context, builder, signature, args):
        return builder.select(builder.fcmp_ordered(">", *args), *args)

    return lanes_type(lanes_type, lanes_type), codegen


@intrinsic
def select(typingctx, mask, a, b):
    """Give a where the mask is true, b elsewhere."""

    def codegen(context, builder, signature, args):
        return builder.select(*args)

    return lanes_type(mask_type, lanes_type, lanes_type), codegen


@intrinsic
def some(typingctx, mask):
    """Is any lane of the mask true?"""

    def codegen(context, builder, signature, args):
        word = builder.bitcast(args[0], ir.IntType(LANES))
        return builder.icmp_unsigned("!=", word, ir.Constant(word.type, 0))

    return types.boolean(mask_type), codegen


@intrinsic
def number(typingctx, x, lane):
    """Give one lane as a float32."""

    def codegen(context, builder, signature, args):
        return builder.extract_element(*args)

    return types.float32(lanes_type, types.intp), codegen


@intrinsic
def every(typingctx, mask):
    """Are all lanes of the mask true?"""

    def codegen(context, builder, signature, args):
        word = builder.bitcast(args[0], ir.IntType(LANES))
        return builder.icmp_unsigned("==", word, ir.Constant(word.type, (1 << LANES) - 1))

    return types.boolean(mask_type), codegen


@intrinsic
def bits(typingctx, mask):
    """Give the mask as an integer whose bit k is lane k."""

    def codegen(context, builder, signature, args):
        return builder.zext(builder.bitcast(args[0], ir.IntType(LANES)), ir.IntType(64))

    return types.int64(mask_type), codegen


@intrinsic
def lowest_bit(typingctx, word):
    """Give the place of the lowest bit that is set of a 64-bit integer that is not zero."""

    def codegen(context, builder, signature, args):
        kind = ir.FunctionType(ir.IntType(64), [ir.IntType(64), ir.IntType(1)])
        called = cgutils.get_or_insert_function(builder.module, kind, "llvm.cttz.i64")
        return builder.call(called, [args[0], ir.Constant(ir.IntType(1), 1)])

    return types.int64(types.int64), codegen


@intrinsic
def exponent(typingctx, x):
    """Give the binary exponent of positive normal numbers: x = mantissa(x) 2^exponent(x)."""

    def codegen(context, builder, signature, args):
        bits = builder.lshr(builder.bitcast(args[0], INTS), ir.Constant(INTS, [INT(23)] * LANES))
        return builder.sitofp(builder.sub(bits, ir.Constant(INTS, [INT(127)] * LANES)), VECTOR)

    return lanes_type(lanes_type), codegen


@intrinsic
def mantissa(typingctx, x):
    """Give the mantissa of positive normal numbers, in [1, 2)."""

    def codegen(context, builder, signature, args):
        bits = builder.and_(builder.bitcast(args[0], INTS), ir.Constant(INTS, [INT(0x7FFFFF)] * LANES))
        return builder.bitcast(builder.or_(bits, ir.Constant(INTS, [INT(0x3F800000)] * LANES)), VECTOR)

    return lanes_type(lanes_type), codegen


def folded(builder, a, b, width):
    """Add halves: groups of `width` lanes of a and then of b become groups of `width` / 2."""
    half = width // 2
    low = [k for k in range(2 * LANES) if k % width < half]
    return builder.fadd(shuffle(builder, a, b, low), shuffle(builder, a, b, [k + half for k in low]))


@intrinsic
def sums(typingctx, columns):
    """Give a vector whose lane k is the sum of the lanes of the k-th of a tuple of up to sixteen vectors; lanes beyond are zero."""

    def codegen(context, builder, signature, args):
        level = cgutils.unpack_tuple(builder, args[0])
        nothing = ir.Constant(VECTOR, None)
        for width in (16, 8, 4, 2):
            level = [
                folded(builder, level[k], level[k + 1] if k + 1 < len(level) else nothing, width)
                for k in range(0, len(level), 2)
            ]
        return level[0]

    return lanes_type(columns), codegen


def binary(name):
    """Make the intrinsic of an arithmetic operator."""

    @intrinsic
    def function(typingctx, a, b):
        def codegen(context, builder, signature, args):
            return getattr(builder, name)(*args)

        return lanes_type(lanes_type, lanes_type), codegen

    return function


def comparison(sign):
    """Make the intrinsic of a comparison, which is false for what is not a number."""

    @intrinsic
    def function(typingctx, a, b):
        def codegen(context, builder, signature, args):
            return builder.fcmp_ordered(sign, *args)

        return mask_type(lanes_type, lanes_type), codegen

    return function


@intrinsic
def both(typingctx, a, b):
    def codegen(context, builder, signature, args):
        return builder.and_(*args)

    return mask_type(mask_type, mask_type), codegen


@intrinsic
def negative(typingctx, a):
    def codegen(context, builder, signature, args):
        return builder.fneg(args[0])

    return lanes_type(lanes_type), codegen


def bind(sign, function):
    """Let an operator work on lanes, and on lanes with a number on one side."""

    @overload(sign, jit_options=WITHIN)
    def operation(a, b):
        if a == lanes_type and b == lanes_type:
            return lambda a, b: function(a, b)
        if a == lanes_type and isinstance(b, types.Number):
            return lambda a, b: function(a, splat(b))
        if b == lanes_type and isinstance(a, types.Number):
            return lambda a, b: function(splat(a), b)
        return None


for sign, function in (
    (operator.add, binary("fadd")),
    (operator.sub, binary("fsub")),
    (operator.mul, binary("fmul")),
    (operator.truediv, binary("fdiv")),
    (operator.lt, comparison("<")),
    (operator.le, comparison("<=")),
    (operator.gt, comparison(">")),
    (operator.ge, comparison(">=")),
):
    bind(sign, function)


@overload(operator.and_, jit_options=WITHIN)
def mask_and(a, b):
    """Let & join masks."""
    if a == mask_type and b == mask_type:
        return lambda a, b: both(a, b)
    return None


@overload(operator.neg, jit_options=WITHIN)
def lanes_negative(a):
    """Let - turn the sign of lanes."""
    if a == lanes_type:
        return lambda a: negative(a)
    return None


@intrinsic
def power_of_two(typingctx, x):
    """Give 2^x for whole numbers x from -126 to 127."""

    def codegen(context, builder, signature, args):
        biased = builder.add(builder.fptosi(args[0], INTS), ir.Constant(INTS, [INT(127)] * LANES))
        return builder.bitcast(builder.shl(biased, ir.Constant(INTS, [INT(23)] * LANES)), VECTOR)

    return lanes_type(lanes_type), codegen
