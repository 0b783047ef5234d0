"""Binary adaptive range coder over signed integers: the loops alone, on sequences of plain integers.

Every function here runs unchanged as plain Python (on lists) and compiled by Numba (on int64 arrays): only integers below 2**63, no
exceptions, no allocation. FORMAT.md, "Adaptive integers", is the specification.

Source: own; range coder with carry after Martin (1979) and LZMA; two-rate probability estimation after VVC (H.266), 9.3.4.
"""

from __future__ import annotations

UNARY_BINS = 14  # magnitudes 1 to 14 end inside the unary prefix
LENGTH_BINS = 20  # a longer suffix shares the model of this length
BINS = 2 + UNARY_BINS + 2 * LENGTH_BINS  # zero flag, sign, prefix, length of the suffix, its second bit
STATE = 3  # fast estimate, slow estimate, number of bins seen (stops at 127)
ACTIVITY_CLASSES = 6
MAX_SUFFIX_BITS = 32

# registers of the encoder: low, range, cached byte (-1: none yet), pending 0xFF bytes, bytes written
# registers of the decoder: code, range, next byte
TOP = 1 << 24
MASK = (1 << 32) - 1
ONE = 1 << 16


def activity(first, second):
    """Class 0 to 5 of the sum of the magnitudes of the two integers before: its bit length."""
    total = abs(first) + abs(second)
    length = 0
    while total > 0 and length < ACTIVITY_CLASSES - 1:
        total >>= 1
        length += 1
    return length


def adapt(models, at, bit):
    """Move both estimates of the probability of a 0 towards `bit`, quickly while few bins were seen."""
    seen = models[at + 2]
    length = 0
    rest = seen
    while rest > 0:
        rest >>= 1
        length += 1
    fast = min(4, length + 1)
    slow = min(7, length + 1)
    if bit:
        models[at] -= models[at] >> fast
        models[at + 1] -= models[at + 1] >> slow
    else:
        models[at] += (ONE - models[at]) >> fast
        models[at + 1] += (ONE - models[at + 1]) >> slow
    if seen < 127:
        models[at + 2] = seen + 1


def split(models, at, width):
    """Part of the range that stands for a 0."""
    probability = (models[at] + models[at + 1]) >> 1
    probability = min(max(probability, 64), ONE - 64)
    return (width >> 16) * probability


def shift_low(registers, out):
    """Write the byte of `low` that no carry can change any more."""
    low = registers[0]
    if low < 0xFF000000 or low > MASK:
        carry = low >> 32
        if registers[2] >= 0:
            out[registers[4]] = (registers[2] + carry) & 0xFF
            registers[4] += 1
        while registers[3] > 0:
            out[registers[4]] = (0xFF + carry) & 0xFF
            registers[4] += 1
            registers[3] -= 1
        registers[2] = (low >> 24) & 0xFF
    else:
        registers[3] += 1
    registers[0] = (low << 8) & MASK


def encode_bit(registers, out, models, at, bit):
    """Code one bin with the model at `at`."""
    bound = split(models, at, registers[1])
    if bit:
        registers[0] += bound
        registers[1] -= bound
    else:
        registers[1] = bound
    adapt(models, at, bit)
    while registers[1] < TOP:
        registers[1] = (registers[1] << 8) & MASK
        shift_low(registers, out)


def encode_even(registers, out, bit):
    """Code one bin of probability one half."""
    registers[1] >>= 1
    if bit:
        registers[0] += registers[1]
    while registers[1] < TOP:
        registers[1] = (registers[1] << 8) & MASK
        shift_low(registers, out)


def decode_bit(registers, data, models, at):
    """Read one bin with the model at `at`."""
    bound = split(models, at, registers[1])
    if registers[0] >= bound:
        registers[0] -= bound
        registers[1] -= bound
        bit = 1
    else:
        registers[1] = bound
        bit = 0
    adapt(models, at, bit)
    while registers[1] < TOP:
        registers[1] = (registers[1] << 8) & MASK
        registers[0] = ((registers[0] << 8) & MASK) | next_byte(registers, data)
    return bit


def decode_even(registers, data):
    """Read one bin of probability one half."""
    registers[1] >>= 1
    bit = 0
    if registers[0] >= registers[1]:
        registers[0] -= registers[1]
        bit = 1
    while registers[1] < TOP:
        registers[1] = (registers[1] << 8) & MASK
        registers[0] = ((registers[0] << 8) & MASK) | next_byte(registers, data)
    return bit


def next_byte(registers, data):
    """Give the next byte; zero past the end, since the encoder leaves trailing zeros out."""
    at = registers[2]
    registers[2] = at + 1
    return data[at] if at < len(data) else 0


def encode_integers(registers, out, models, values, contexts):
    """Code `values` in order; each model set is chosen by its context and by the two values before it."""
    before = 0
    last = 0
    for i in range(len(values)):
        value = values[i]
        base = (contexts[i] * ACTIVITY_CLASSES + activity(last, before)) * BINS * STATE
        before = last
        last = value
        encode_bit(registers, out, models, base, 1 if value != 0 else 0)
        if value == 0:
            continue
        encode_bit(registers, out, models, base + STATE, 1 if value < 0 else 0)
        rest = abs(value) - 1
        for k in range(UNARY_BINS):
            more = 1 if rest > k else 0
            encode_bit(registers, out, models, base + (2 + k) * STATE, more)
            if not more:
                break
        if rest >= UNARY_BINS:
            suffix = rest - UNARY_BINS + 1
            length = 0
            while (suffix >> (length + 1)) > 0:
                length += 1
            lengths = base + (2 + UNARY_BINS) * STATE
            for k in range(length):
                encode_bit(registers, out, models, lengths + min(k, LENGTH_BINS - 1) * STATE, 1)
            encode_bit(registers, out, models, lengths + min(length, LENGTH_BINS - 1) * STATE, 0)
            if length > 0:
                second = lengths + (LENGTH_BINS + min(length, LENGTH_BINS - 1)) * STATE
                encode_bit(registers, out, models, second, (suffix >> (length - 1)) & 1)
            for k in range(length - 2, -1, -1):
                encode_even(registers, out, (suffix >> k) & 1)


def decode_integers(registers, data, models, values, contexts):
    """Read len(values) integers into `values`; give False where a suffix is longer than any encoder writes."""
    before = 0
    last = 0
    for i in range(len(values)):
        base = (contexts[i] * ACTIVITY_CLASSES + activity(last, before)) * BINS * STATE
        before = last
        last = 0
        if decode_bit(registers, data, models, base):
            negative = decode_bit(registers, data, models, base + STATE)
            rest = 0
            while rest < UNARY_BINS and decode_bit(registers, data, models, base + (2 + rest) * STATE):
                rest += 1
            if rest == UNARY_BINS:
                lengths = base + (2 + UNARY_BINS) * STATE
                length = 0
                while length <= MAX_SUFFIX_BITS and decode_bit(
                    registers, data, models, lengths + min(length, LENGTH_BINS - 1) * STATE
                ):
                    length += 1
                if length > MAX_SUFFIX_BITS:
                    return False
                suffix = 1
                if length > 0:
                    second = lengths + (LENGTH_BINS + min(length, LENGTH_BINS - 1)) * STATE
                    suffix = 2 | decode_bit(registers, data, models, second)
                for _ in range(length - 1):
                    suffix = (suffix << 1) | decode_even(registers, data)
                rest += suffix - 1
            last = -(rest + 1) if negative else rest + 1
        values[i] = last
    return True
