"""Binary adaptive coding of residuals whose size is expected: the loops alone, on sequences of plain integers.

Every function here runs unchanged as plain Python (on lists) and compiled by Numba (on int64 arrays). FORMAT.md, "Residuals", is the
specification. Where `arithmetic` learns every probability, here each class of expected size begins at what a two-sided geometric
distribution of that size says, so that a group of a few frames pays for no learning.

Source: own.
"""

from __future__ import annotations

from sacha_core.codec.kernels.arithmetic import MASK, ONE, TOP, decode_even, encode_even, next_byte, shift_low

CLASSES = 41  # half octaves of the expected magnitude, from 1/64 up
UNARY_BINS = 15  # of the magnitude's upper bits
LENGTH_BINS = 33  # of the suffix, under models that all classes share
MAX_SUFFIX_BITS = 32
FIRST_SHIFTED = 16  # from this class on the lowest bits are sent as they are
STATE = 2  # probability of a 0, in 65,536ths; how many bins it stands for
SEEN_AT_FIRST, SEEN_AT_MOST = 8, 100


def lowest_bits(kind):
    """How many bits of a magnitude of this class are sent as they are."""
    return (kind - FIRST_SHIFTED) // 2 + 1 if kind >= FIRST_SHIFTED else 0


def learn(models, at, bit):
    """Move the probability of a 0 towards `bit`, by as much as one of the bins that it stands for."""
    share = 2 * models[at + 1] + 3
    if bit:
        models[at] -= 2 * models[at] // share
    else:
        models[at] += 2 * (ONE - models[at]) // share
    if models[at + 1] < SEEN_AT_MOST:
        models[at + 1] += 1


def part_of_zero(models, at, width):
    """Part of the range that stands for a 0."""
    return (width >> 16) * min(max(models[at], 64), ONE - 64)


def put_bin(registers, out, models, at, bit):
    """Code one bin with the model at `at`."""
    bound = part_of_zero(models, at, registers[1])
    if bit:
        registers[0] += bound
        registers[1] -= bound
    else:
        registers[1] = bound
    learn(models, at, bit)
    while registers[1] < TOP:
        registers[1] = (registers[1] << 8) & MASK
        shift_low(registers, out)


def take_bin(registers, data, models, at):
    """Read one bin with the model at `at`."""
    bound = part_of_zero(models, at, registers[1])
    bit = 0
    if registers[0] >= bound:
        registers[0] -= bound
        registers[1] -= bound
        bit = 1
    else:
        registers[1] = bound
    learn(models, at, bit)
    while registers[1] < TOP:
        registers[1] = (registers[1] << 8) & MASK
        registers[0] = ((registers[0] << 8) & MASK) | next_byte(registers, data)
    return bit


def encode_residuals(registers, out, models, values, kinds):
    """Code `values` in order, each under its class."""
    for i in range(len(values)):
        magnitude = abs(values[i])
        shift = lowest_bits(kinds[i])
        upper = magnitude >> shift
        base = kinds[i] * UNARY_BINS * STATE
        for k in range(UNARY_BINS):
            more = 1 if upper > k else 0
            put_bin(registers, out, models, base + k * STATE, more)
            if not more:
                break
        if upper >= UNARY_BINS:
            suffix = upper - UNARY_BINS + 1
            length = 0
            while (suffix >> (length + 1)) > 0:
                length += 1
            lengths = CLASSES * UNARY_BINS * STATE
            for k in range(length):
                put_bin(registers, out, models, lengths + k * STATE, 1)
            put_bin(registers, out, models, lengths + length * STATE, 0)
            for k in range(length - 1, -1, -1):
                encode_even(registers, out, (suffix >> k) & 1)
        for k in range(shift - 1, -1, -1):
            encode_even(registers, out, (magnitude >> k) & 1)
        if magnitude > 0:
            encode_even(registers, out, 1 if values[i] < 0 else 0)


def take_residual(registers, data, models, kind):
    """Read one integer of a class; MASK where its suffix is longer than any encoder writes."""
    base = kind * UNARY_BINS * STATE
    upper = 0
    while upper < UNARY_BINS and take_bin(registers, data, models, base + upper * STATE):
        upper += 1
    if upper == UNARY_BINS:
        lengths = CLASSES * UNARY_BINS * STATE
        length = 0
        while length < MAX_SUFFIX_BITS and take_bin(registers, data, models, lengths + length * STATE):
            length += 1
        if length == MAX_SUFFIX_BITS:
            return MASK << 16
        suffix = 1
        for _ in range(length):
            suffix = (suffix << 1) | decode_even(registers, data)
        upper += suffix - 1
    for _ in range(lowest_bits(kind)):
        upper = (upper << 1) | decode_even(registers, data)
    if upper > 0 and decode_even(registers, data):
        return -upper
    return upper
