"""A decoder of `.sacha` files in plain Python, written from FORMAT.md alone: an oracle that shares nothing with the codec.

It trusts its input: what it must refuse is tested elsewhere. Sections follow the order of the page.
"""

from __future__ import annotations

import math
import struct
import zlib
from collections.abc import Callable, Iterable, Sequence

import numpy as np
from reference_coder import StackDecoder, cumulative

STEP = [math.isqrt(1 << e) for e in range(48)]
MOTION_WIDTHS = {"expression": 0, "rotation": 3, "neck": 3, "jaw": 3, "eyes": 6, "translation": 3}

Pass = tuple[int, list[tuple[int, tuple[int, ...]]]]  # kind; of each Gaussian: its row and the rows known beside it


class Fields:
    """Walks over the fields of a section."""

    def __init__(self, data: bytes) -> None:
        self.data, self.at = data, 0

    def read(self, layout: str) -> tuple:
        """Give the next values of a little-endian layout."""
        values = struct.unpack_from("<" + layout, self.data, self.at)
        self.at += struct.calcsize("<" + layout)
        return values

    def take(self, n_bytes: int | None = None) -> bytes:
        """Give the next bytes, or all that are left."""
        end = len(self.data) if n_bytes is None else self.at + n_bytes
        part, self.at = self.data[self.at : end], end
        assert end <= len(self.data)
        return part

    def text(self) -> str:
        """Give a text."""
        return self.take(*self.read("B")).decode()


def sections_of(data: bytes) -> dict[str, bytes]:
    """Split the container."""
    fields = Fields(data)
    _, major, _, n_sections, n_bytes, checksum = fields.read("8sHHIQI")
    table = fields.take(16 * n_sections)
    assert (major, n_bytes, checksum) == (1, len(data), zlib.crc32(data[:24] + bytes(4) + table))
    return {name.rstrip(b"\0").decode(): fields.take(n) for name, n, _ in struct.iter_unpack("<8sII", table)}


class AdaptiveIntegers:
    """Section "Adaptive integers"."""

    def __init__(self, data: bytes, n_contexts: int) -> None:
        self.data, self.at, self.code, self.range = data, 0, 0, (1 << 32) - 1
        self.models = [[32768, 32768, 0] for _ in range(n_contexts * 6 * 56)]
        for _ in range(4):
            self.code = self.code << 8 | self.next_byte()

    def next_byte(self) -> int:
        """Give the next byte, 0 past the end."""
        self.at += 1
        return self.data[self.at - 1] if self.at <= len(self.data) else 0

    def bin(self, number: int | None = None) -> int:
        """Read a bin with a model, or an even one."""
        if number is None:
            self.range >>= 1
            bound = self.range
        else:
            fast, slow, seen = model = self.models[number]
            bound = (self.range >> 16) * min(max((fast + slow) >> 1, 64), 65472)
        bit = int(self.code >= bound)
        self.code -= bound * bit
        if number is not None:
            self.range = self.range - bound if bit else bound
            for i, most in enumerate((4, 7)):
                shift = min(most, seen.bit_length() + 1)
                model[i] += -(model[i] >> shift) if bit else (65536 - model[i]) >> shift
            model[2] = min(seen + 1, 127)
        while self.range < 1 << 24:
            self.range = self.range << 8 & 0xFFFFFFFF
            self.code = self.code << 8 & 0xFFFFFFFF | self.next_byte()
        return bit

    def run(self, contexts: Iterable[int]) -> list[int]:
        """Read one integer under each context."""
        values = [0, 0]
        for context in contexts:
            activity = min((abs(values[-1]) + abs(values[-2])).bit_length(), 5)
            values.append(self.integer((context * 6 + activity) * 56))
        return values[2:]

    def integer(self, base: int) -> int:
        """Read one integer with the models from `base` on."""
        if not self.bin(base):
            return 0
        sign = -1 if self.bin(base + 1) else 1
        for magnitude in range(1, 15):
            if not self.bin(base + 1 + magnitude):
                return sign * magnitude
        length = 0
        while self.bin(base + 16 + min(length, 19)):
            length += 1
        u = 1
        for i in range(length):
            u = u << 1 | self.bin(base + 36 + min(length, 19) if i == 0 else None)
        return sign * (14 + u)

    def end(self) -> None:
        """Check that no byte was left unread."""
        assert self.at >= len(self.data)


class Tokens:
    """Section "Tokens"."""

    def __init__(self, data: bytes, n_contexts: int) -> None:
        fields = Fields(data)
        n_tables, table_bytes, raw_bytes = fields.read("BII")
        coded = AdaptiveIntegers(fields.take(table_bytes), 3)
        self.table_of = np.cumsum(coded.run([2] * n_contexts)).tolist()
        self.tables = []
        for _ in range(n_tables):
            first, n_tokens = coded.run([0, 0])
            self.tables.append((first, cumulative(np.cumsum(coded.run([1] * n_tokens)).tolist())))
        coded.end()
        self.raw = "".join(f"{byte:08b}" for byte in fields.take(raw_bytes))
        self.stack = StackDecoder([word for (word,) in struct.iter_unpack("<I", fields.take())])

    def batch(self, contexts: Sequence[int]) -> list[int]:
        """Read one integer under each context."""
        tables = [self.table_of[context] for context in contexts]
        tokens = [0] * len(contexts)
        for table in sorted(set(tables)):
            first, ends = self.tables[table]
            for i in (i for i, mine in enumerate(tables) if mine == table):
                tokens[i] = first + self.stack.decode(ends)
        return [self.integer(token) for token in tokens]

    def integer(self, token: int) -> int:
        """Complete a token by its raw bits."""
        j = abs(token) - 16
        if j < 0:
            return token
        length = j // 4 + 2
        magnitude = ((4 + j % 4) << length) + int(self.raw[:length], 2)
        self.raw = self.raw[length:]
        return -magnitude if token < 0 else magnitude

    def end(self) -> None:
        """Check that nothing is left."""
        assert not self.stack.words
        assert self.stack.state == 0
        assert self.raw in "0000000"


def curve_index(cell: Sequence[int]) -> int:
    """Place of a cell on the curve."""
    x = list(cell)
    for b in range(9, 0, -1):
        mask = (1 << b) - 1
        for a in range(3):
            if x[a] >> b & 1:
                x[0] ^= mask
            else:
                swap = (x[0] ^ x[a]) & mask
                x[0] ^= swap
                x[a] ^= swap
    x[1] ^= x[0]
    x[2] ^= x[1]
    w = 0
    for b in range(9, 0, -1):
        w ^= ((1 << b) - 1) * (x[2] >> b & 1)
    return int("".join(str((value ^ w) >> b & 1) for b in range(9, -1, -1) for value in x), 2)


def triangles_of(vertices: np.ndarray, faces: np.ndarray) -> tuple[list[int], list[int]]:
    """Section "Triangles": coding order, and size class of each triangle of the head."""
    wide = vertices.astype(float) - vertices.astype(float).min(axis=0)
    octave = math.frexp(wide.max())[1]
    grid = [[round(math.ldexp(float(x), 20 - octave)) for x in vertex] for vertex in wide]
    corners = [[grid[vertex] for vertex in face] for face in faces]
    sums = [[sum(axis) for axis in zip(*triangle, strict=True)] for triangle in corners]
    low = [min(axis) for axis in zip(*sums, strict=True)]
    cells = [[min((x - y) * 1024 // (3 << 20), 1023) for x, y in zip(total, low, strict=True)] for total in sums]
    classes = []
    for p, q, r in corners:
        (ax, ay, az), (bx, by, bz) = ([y - x for x, y in zip(p, end, strict=True)] for end in (q, r))
        x, y, z = float(ay * bz - az * by), float(az * bx - ax * bz), float(ax * by - ay * bx)
        classes.append(math.frexp((x * x + y * y) + z * z)[1] >> 1)
    middle = sorted(classes)[len(classes) // 2]
    order = sorted(range(len(cells)), key=lambda face: (curve_index(cells[face]), face))
    return order, [one - middle for one in classes]


def passes_of(slots: list[list[int]]) -> list[Pass]:
    """Section "Order of Gaussians"; a first has two rows beside it (none: the very first), a mate all earlier ones of its slot."""
    m = len(slots)
    passes: list[Pass] = [(0, [(slots[0][0], ())])] if m else []
    half = (1 << (m - 1).bit_length()) // 2 if m else 0
    while half:
        firsts = []
        for slot in range(half, m, 2 * half):
            behind = slot + half if slot + half < m else slot - half
            firsts.append((slots[slot][0], (slots[slot - half][0], slots[behind][0])))
        passes += [({1: 2, 2: 1}.get(half, 0), firsts)] if firsts else []
        half //= 2
    low = 1
    while low < max(map(len, slots), default=0):
        width = max(1, (1 << (low.bit_length() - 1)) // 2)
        mates = [(row, tuple(slot[:low])) for slot in slots for row in slot[low : low + width]]
        passes.append((3, mates))
        low += width
    return passes


class Rule:
    """Section "Steps"; classes are (T, Z, E)."""

    def __init__(self, fields: Fields) -> None:
        *self.weights, self.reference, self.low, self.high, self.base = fields.read("5bBB")
        self.n_classes = ((self.high - self.low) >> 1) + 1

    def shift(self, t: int, z: int, e: int) -> int:
        """Shift of the exponent."""
        of_t, of_z, of_e = self.weights
        return min(max((of_t * t + of_z * (self.reference - z) - of_e * e) >> 2, self.low), self.high)

    def step(self, classes: tuple[int, int, int]) -> int:
        """Step of a Gaussian."""
        return STEP[self.base + self.shift(*classes)]

    def step_class(self, classes: tuple[int, int, int]) -> int:
        """Step class of a Gaussian."""
        return (self.shift(*classes) - self.low) >> 1


def predicted(
    fields: Fields, passes: list[Pass], n: int, rule: Rule, classes: list, step: Callable[[int, int], int], width: int
) -> list[list[int]]:
    """Section "Predicted values"; `step` tells that of a row and component."""
    centre = fields.read(f"{width}q")
    weights = [fields.read(f"{width}B") for _ in range(4)]
    tokens = Tokens(fields.take(), 4 * width * rule.n_classes)
    values = [[0] * width for _ in range(n)]
    for kind, members in passes:
        cells = [(row, known, c) for row, known in members for c in range(width)]
        integers = tokens.batch(
            [(c * 4 + kind) * rule.n_classes + rule.step_class(classes[row]) for row, _, c in cells]
        )
        fresh = []
        for (row, known, c), integer in zip(cells, integers, strict=True):
            expected = centre[c]
            if known:
                total, count = sum(values[i][c] for i in known), len(known)
                mean = (2 * total + count) // (2 * count)
                expected += ((mean - centre[c]) * weights[kind][c] + 8) >> 4
            fresh.append((row, c, expected + integer * step(row, c)))
        for row, c, value in fresh:
            values[row][c] = value
    tokens.end()
    return values


def opacity_of(data: bytes, passes: list[Pass], n: int) -> tuple[list[float], list[int]]:
    """Section "Opacity": logits and transparency classes."""
    fields = Fields(data)
    u, start = fields.read("HH")
    tokens, index = Tokens(fields.take(), 64), [0] * n
    for kind, members in passes:
        if kind == 3:
            expected = [index[known[-1]] for _, known in members]
        else:
            expected = [(index[known[0]] + index[known[1]] + 1) >> 1 if known else start for _, known in members]
        integers = tokens.batch([kind * 16 + min(16 * one // u, 15) for one in expected])
        for (row, _), one, integer in zip(members, expected, integers, strict=True):
            index[row] = index[row - 1] - integer if kind == 3 else one + integer
    tokens.end()
    angles = [math.pi / 2 * max(0.25, min(i, u - 0.25)) / u for i in index]
    logits = [0.0 if 2 * i == u else 2 * math.log(math.tan(angle)) for i, angle in zip(index, angles, strict=True)]
    return logits, [min(round(-2 * math.log2(math.sin(angle) ** 2)), 24) for angle in angles]


def rgb_of(y: float, u: float, v: float) -> tuple[float, float, float]:
    """RGB of integers in units of 2^-14."""
    y, u, v = y * 2.0**-14, u * 2.0**-14, v * 2.0**-14
    return y + 1.13983 * v, (y - 0.39465 * u) - 0.5806 * v, y + 2.03211 * u


def quaternion_of(values: list[int]) -> list[float]:
    """Section "Rotation": wxyz."""
    x, y, z = (value * 2.0**-14 for value in values)
    s = (x * x + y * y) + z * z
    w = math.sqrt(max(1 - s, 0.0))
    length = math.sqrt(w * w + s)
    return [w / length, x / length, y / length, z / length]


def harmonics_of(data: bytes, degree: int, classes: list) -> list[list[tuple[float, float, float]]]:
    """Section "Harmonic": coefficients of each Gaussian."""
    fields = Fields(data)
    rules = [Rule(fields) for _ in range(2 * degree)]
    tokens = Tokens(fields.take(), 144)
    spent = [[0, 0] for _ in classes]
    coefficients: list[list[tuple[float, float, float]]] = [[] for _ in classes]
    for d in range(degree):
        luma, differences = rules[d], rules[degree + d]
        width = 2 * d + 3
        contexts = [
            ((d * 2 + min(c, 1)) * 6 + min(luma.step_class(one), 5)) * 4 + min(spent[row][min(c, 1)].bit_length(), 3)
            for row, one in enumerate(classes)
            for _ in range(width)
            for c in range(3)
        ]
        integers = np.array(tokens.batch(contexts), int).reshape(len(classes), width, 3).tolist()
        for row, one in enumerate(classes):
            for y, u, v in integers[row]:
                spent[row][0] += abs(y)
                spent[row][1] += abs(u) + abs(v)
                coarse = differences.step(one)
                coefficients[row].append(rgb_of(y * luma.step(one), u * coarse, v * coarse))
    tokens.end()
    return coefficients


def motion_of(static: bytes, dynamic: bytes, t: int, e: int, s: int, o: int) -> dict[str, np.ndarray]:
    """Sections "Static" and "Motion"."""
    fields = Fields(static)
    shape_step, offset_step = fields.read("dd")
    coded = AdaptiveIntegers(fields.take(), 4)
    shape, offsets = coded.run([0] * s), np.array(coded.run([1, 2, 3] * o), float).reshape(o, 3).cumsum(axis=0)
    coded.end()
    arrays = {"shape": np.array(shape, float) * shape_step, "static_offset": offsets * offset_step}
    fields = Fields(dynamic)
    *steps, _, group_frames = fields.read("ddddH")
    damping, base_bytes = fields.read("6B"), fields.read("I")[0]
    widths = MOTION_WIDTHS | {"expression": e}
    kinds = np.repeat(range(6), list(widths.values())).tolist()
    coded = AdaptiveIntegers(fields.take(base_bytes), 6)
    base = coded.run(kinds)
    coded.end()
    frames: list[list[int]] = []
    for n_bytes, checksum in [fields.read("II") for _ in range(-(-t // group_frames))]:
        group = fields.take(n_bytes)
        assert checksum == zlib.crc32(group)
        coded, difference = AdaptiveIntegers(group, 30), [4] * len(kinds)
        for i in range(min(group_frames, t - len(frames))):
            expected = base
            history = [4 if i == 0 else min(abs(one), 3) for one in difference]
            if i:
                last, before = frames[-1], frames[-min(i, 2)]
                moved = zip(last, before, kinds, strict=True)
                expected = [a + (((a - b) * damping[kind] + 4) >> 3) for a, b, kind in moved]
            difference = coded.run([kind * 5 + one for kind, one in zip(kinds, history, strict=True)])
            frames.append([a + b for a, b in zip(expected, difference, strict=True)])
        coded.end()
    columns = np.split(np.array(frames, float).reshape(t, e + 18), np.cumsum(list(widths.values()))[:-1], axis=1)
    for name, column, step in zip(widths, columns, [0, 1, 1, 1, 1, 2], strict=True):
        arrays[name] = column * steps[step]
    return arrays


def scales_of(data: bytes, passes: list[Pass], transparency: list[int]) -> list[tuple[int, int, int]]:
    """Section "Scale": l1, l2, l3 of each Gaussian."""
    fields, parts = Fields(data), []
    classes = [(one, 0, 0) for one in transparency]
    for _ in range(3):
        rule = Rule(fields)
        part = Fields(fields.take(*fields.read("I")))
        step = [rule.step(one) for one in classes]
        parts.append(predicted(part, passes, len(classes), rule, classes, lambda row, _, step=step: step[row], 1))
    return [(a, a - b, a - b - c) for (a,), (b,), (c,) in zip(*parts, strict=True)]


def gaussians_of(sections: dict[str, bytes], degree: int, z: list[int], passes: list[Pass]) -> dict[str, np.ndarray]:
    """All sections of the Gaussians but their counts; z is the size class of the triangle of each."""
    n = len(z)
    logits, transparency = opacity_of(sections["Opacity"], passes, n)
    scales = scales_of(sections["Scale"], passes, transparency)
    classes = [
        (one, (a + b) * 189093 >> 29, max((a - b) * 189093 >> 28, 0))
        for one, (a, b, _) in zip(transparency, scales, strict=True)
    ]
    fields = Fields(sections["Rotation"])
    turn = Rule(fields)
    turns = predicted(fields, passes, n, turn, classes, lambda row, _: turn.step(classes[row]), 3)
    fields = Fields(sections["Position"][1:])
    place = Rule(fields)
    exponents = [place.base + place.shift(*one) - size for one, size in zip(classes, z, strict=True)]
    places = predicted(fields, passes, n, place, classes, lambda row, _: STEP[min(max(exponents[row], 0), 47)], 3)
    fields = Fields(sections["Colour"])
    colour = [Rule(fields) for _ in range(3)]
    colours = predicted(fields, passes, n, colour[0], classes, lambda row, c: colour[c].step(classes[row]), 3)
    rest = harmonics_of(sections["Harmonic"], degree, classes) if degree else []
    log_scales = [[(x - (size * 363409 >> 8)) * 2.0**-12 for x in scale] for size, scale in zip(z, scales, strict=True)]
    return {
        "position": np.array(places, float).reshape(n, 3) * 2.0**-16,
        "log_scale": np.array(log_scales).reshape(n, 3),
        "quaternion": np.array([quaternion_of(one) for one in turns]).reshape(n, 4),
        "opacity_logit": np.array(logits).reshape(n),
        "sh_dc": np.array([rgb_of(*one) for one in colours]).reshape(n, 3),
        "sh_rest": np.array(rest).reshape(n, (degree + 1) ** 2 - 1, 3),
    }


def reference_decode(data: bytes, vertices: np.ndarray, faces: np.ndarray) -> dict[str, dict[str, np.ndarray]]:
    """Give the arrays of Gaussians and motion; `vertices` and `faces` are the unposed head's."""
    sections = sections_of(data)
    fields = Fields(sections["Header"])
    _, _, degree, flags, _, _, f, t, e, s, o = fields.read("BhBB7I")
    order, size = triangles_of(vertices, faces) if flags & 2 else (list(range(f)), [0] * f)
    coded = AdaptiveIntegers(sections["Counts"][1:], 1)
    counts = coded.run([0] * f)
    coded.end()
    if sections["Counts"][0]:
        counts = [counts[face] for face in order]
    binding = np.repeat(order, counts).tolist()
    ends = np.cumsum(counts).tolist()
    passes = passes_of([list(range(end - m, end)) for end, m in zip(ends, counts, strict=True) if m])
    gaussians = gaussians_of(sections, degree, [size[face] for face in binding], passes)
    parts = {"gaussians": {name: array.astype(np.float32) for name, array in gaussians.items()}}
    parts["gaussians"]["binding"] = np.array(binding, np.int32)
    if flags & 1:
        motion = motion_of(sections["Static"], sections["Motion"], t, e, s, o)
        parts["motion"] = {name: array.astype(np.float32) for name, array in motion.items()}
    return parts
