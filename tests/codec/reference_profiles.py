"""The archive and the paper profile, in plain Python, written from FORMAT.md alone: "Exact numbers", "Archive", "Paper"."""

from __future__ import annotations

import math
import struct

import numpy as np
from reference_motion import WIDTHS
from reference_places import coarse_to_fine
from reference_streams import AdaptiveIntegers, Fields, Tokens

LARGEST = float(np.finfo(np.float32).max)
STEPS = (161, 181, 203, 228, 256, 287)
RANGES = {"Colour": (-4, 8), "Harmonic": (-4, 8), "Opacity": (-7, 25), "Scale": (-26, 30), "Rotation": (-1, 2)}


def bits_of(x: float) -> int:
    """Bits of a binary32 number."""
    return struct.unpack("<I", struct.pack("<f", x))[0]


def number_of(bits: int) -> float:
    """The binary32 number of some bits."""
    return struct.unpack("<f", struct.pack("<I", bits))[0]


def ordered_bits(x: float) -> int:
    """Bits without sign, as an integer with the number's sign."""
    bits = bits_of(x)
    return -(bits & 0x7FFFFFFF) if bits >> 31 else bits


class Noise:
    """Bits, the highest of the first byte first."""

    def __init__(self, data: bytes) -> None:
        self.bits = "".join(f"{byte:08b}" for byte in data)

    def read(self, length: int) -> int:
        """Read a number of some bits."""
        value, self.bits = int(self.bits[:length] or "0", 2), self.bits[length:]
        return value


class Column:
    """Description of a column."""

    def __init__(self, fields: Fields) -> None:
        self.mode, self.centre = fields.read("Bf")
        if self.mode:
            self.zeros, self.anchor, *coefficients, n_thresholds = fields.read("BB4hB")
            self.a = [one * 2.0**-12 for one in coefficients]
            self.thresholds = fields.read(f"{n_thresholds}f")
            self.m = fields.read("I")[0] if self.mode == 4 else 0
            self.listed: list[int] = []

    def read_list(self, tokens: Tokens, noise: Noise, base: int) -> None:
        """Read the list of mode 4."""
        last = -(1 << 31)
        for symbol in tokens.batch([base + 251] * self.m):
            length = symbol + 16
            last += (1 << (length - 1) | noise.read(length - 1)) if length else 0
            self.listed.append(last)

    def expected(self, m: float, earlier: list[float], offsets: list[float]) -> float:
        """Expected number; earlier columns and their offsets, the nearest first."""
        if self.mode == 3:
            z, y, x = earlier[:3]
            root = math.sqrt(max(1 - ((x * x + y * y) + z * z), 0.0))
            return float(np.float32(-root if m < 0 else root))
        total = self.centre + self.a[0] * (m - self.centre)
        for a, offset in zip(self.a[1:], offsets, strict=False):
            total = total + a * offset
        return float(np.float32(min(max(total, -LARGEST), LARGEST)))


def exact_array(data: bytes, n: int, c: int) -> np.ndarray:
    """Section "Exact numbers"."""
    fields = Fields(data)
    g, head_bytes, noise_bytes = fields.read("BII")
    heads = Fields(fields.take(head_bytes))
    columns = [Column(heads) for _ in range(c)]
    noise = Noise(fields.take(noise_bytes))
    tokens = Tokens(fields.take(), 252 * g)
    passes, half = [], (1 << (n - 1).bit_length()) // 2 if n else 0
    for number, (_, rows) in enumerate(coarse_to_fine(n)):
        while number and half and rows != list(range(half, n, 2 * half)):
            half //= 2
        passes.append(
            [(row, row - half, row + half if row + half < n else row - half) for row in rows] if number else [(0, 0, 0)]
        )
    table = [[0.0] * c for _ in range(n)]
    offsets = [[0.0] * c for _ in range(n)]
    for j, column in enumerate(columns):
        if column.mode == 4:
            column.read_list(tokens, noise, j % g * 252)
        for number, members in enumerate(passes):
            read_pass(column, j, j % g * 252, members, number == 0, table, offsets, tokens, noise)
    tokens.end()
    assert len(noise.bits) < 8
    assert "1" not in noise.bits
    return np.array(table, np.float32).reshape(n, c)


def read_pass(
    column: Column,
    j: int,
    base: int,
    members: list,
    first: bool,
    table: list,
    offsets: list,
    tokens: Tokens,
    noise: Noise,
) -> None:
    """Read one pass of column j."""
    means = [column.centre if first else (table[left][j] + table[right][j]) * 0.5 for _, left, right in members]
    if column.mode == 0:
        found = [column.centre] * len(members)
    else:
        expected = [
            column.expected(m, table[row][:j][::-1], offsets[row][:j][::-1])
            for m, (row, _, _) in zip(means, members, strict=True)
        ]
        bins = [sum(one < x for one in column.thresholds) for x in expected]
        spread = [
            0 if first else abs(ordered_bits(table[left][j]) - ordered_bits(table[right][j])).bit_length() // 3
            for _, left, right in members
        ]
        if column.mode == 1:
            lead = tokens.batch([base + 11 + one for one in bins])
            shown = [i for i, s in enumerate(lead) if s]
            families = [2 * min(abs(s) - 1, 5) + (s < 0) for s in lead]
            following = dict(
                zip(shown, tokens.batch([base + 59 + 12 * bins[i] + families[i] for i in shown]), strict=True)
            )
            found = [direct(column, s, following.get(i, 0), noise) for i, s in enumerate(lead)]
        elif column.mode == 4:
            lead = tokens.batch([base + one for one in spread])
            found = [listed(column, s, x) for s, x in zip(lead, expected, strict=True)]
        else:
            lead = tokens.batch([base + one for one in spread])
            following = tokens.batch([base + 27 + s + column.anchor for s in lead])
            found = [
                distant(column, s + column.anchor, f, x, noise)
                for s, f, x in zip(lead, following, expected, strict=True)
            ]
    for (row, _, _), x, m in zip(members, found, means, strict=True):
        table[row][j], offsets[row][j] = x, x - m


def listed(column: Column, s: int, expected: float) -> float:
    """Mode 4."""
    place = min(sum(one < order_integer(expected) for one in column.listed), column.m - 1) + s
    order = column.listed[place]
    return number_of(order if order >= 0 else (-1 - order) | 1 << 31)


def order_integer(x: float) -> int:
    """Order integer of a number."""
    bits = bits_of(x)
    return -1 - (bits & 0x7FFFFFFF) if bits >> 31 else bits


def direct(column: Column, s: int, f: int, noise: Noise) -> float:
    """Mode 1."""
    if s == 0:
        return 0.0
    rest = noise.read(19 - column.zeros) << column.zeros
    return number_of((s < 0) << 31 | (column.anchor + 1 - abs(s)) << 23 | f << 19 | rest)


def distant(column: Column, length: int, f: int, expected: float, noise: Noise) -> float:
    """Modes 2 and 3."""
    r = noise.read(max(length - 3, 0))
    d = 0
    if length:
        lower = f"{f & 3:02b}" + (f"{r:0{length - 3}b}" if length > 3 else "")
        d = int("1" + lower[: length - 1], 2)
    bits = bits_of(expected)
    size = (((bits & 0x7FFFFFFF) >> column.zeros) + (-d if f & 4 else d)) << column.zeros
    return number_of(size | ((bits >> 31) ^ (f >> 3)) << 31)


def archive_gaussians(sections: dict[str, bytes], n: int, degree: int, flags: int) -> dict[str, np.ndarray]:
    """Section "Archive"."""
    coded = AdaptiveIntegers(sections["Binding"][1:], 1)
    binding = np.cumsum(np.array(coded.run([0] * n), int))
    coded.end()
    order = sorted(range(n), key=lambda row: binding[row]) if sections["Binding"][0] else list(range(n))
    back = np.argsort(order)
    names = {
        "Position": "position",
        "Scale": "log_scale",
        "Rotation": "quaternion",
        "Opacity": "opacity_logit",
        "Colour": "sh_dc",
    }
    if flags & 4:
        names["Sensitiv"] = "sensitivity_logit"
    widths = {"Rotation": 4, "Opacity": 1, "Sensitiv": 1}
    found = {}
    for section, name in names.items():
        array = exact_array(sections[section], n, widths.get(section, 3))[back]
        found[name] = array[:, 0] if array.shape[1] == 1 else array
    fields, parts = Fields(sections.get("Harmonic", b"")), [np.zeros((n, 0, 3), np.float32)]
    for d in range(1, degree + 1):
        band = exact_array(fields.take(*fields.read("I")), n, 3 * (2 * d + 1))
        parts += [band.reshape(n, 2 * d + 1, 3)[back]]
    return found | {"sh_rest": np.concatenate(parts, axis=1), "binding": binding}


def archive_motion(sections: dict[str, bytes], t: int, e: int, s: int, o: int) -> dict[str, np.ndarray]:
    """Motion of an archive."""
    fields = Fields(sections["Static"])
    shape = exact_array(fields.take(*fields.read("I")), s, 1)[:, 0]
    found = {"shape": shape, "static_offset": exact_array(fields.take(*fields.read("I")), o, 3)}
    fields = Fields(sections["Motion"])
    fields.read("d")
    for name, width in (WIDTHS | {"expression": e}).items():
        found[name] = exact_array(fields.take(*fields.read("I")), t, width)
    return found


def paper_points(tokens: Tokens, n: int) -> list[tuple[int, int, int]]:
    """Points of `Geometry`, sorted."""
    boxes = [((0, 0, 0), n)] if n else []
    for batch in range(54 if n else 0):
        told = tokens.batch([32 * (batch // 6) + (m - 1 if m <= 8 else 8 + min(m.bit_length(), 23)) for _, m in boxes])
        halves = []
        for (corner, m), integer in zip(boxes, told, strict=True):
            lower = integer + (0 if m <= 8 else m >> 1)
            for upper, count in ((0, lower), (1, m - lower)):
                axes = list(corner)
                axes[batch % 3] = axes[batch % 3] << 1 | upper
                halves += [(tuple(axes), count)] if count else []
        boxes = halves
    tokens.end()
    return sorted(point for point, m in boxes for _ in range(m))


def paper_columns(data: bytes, n: int, width: int) -> list[list[int]]:
    """Columns of an attribute, row by row."""
    fields = Fields(data)
    heads = [fields.read("BH") for _ in range(width)]
    tokens, told = Tokens(fields.take(), 4 * width), [[] for _ in range(n)]
    for column in range(width):
        contexts = [4 * column + min(sum(map(abs, row[-2:])).bit_length(), 3) for row in told]
        for row, integer in zip(told, tokens.batch(contexts), strict=True):
            row.append(integer)
    tokens.end()
    rows = []
    for row in told:
        values = []
        for integer, (qp, centre) in zip(row, heads, strict=True):
            step = STEPS[max(qp, 4) % 6] << max(qp, 4) // 6
            off = (abs(integer) * step + 128) >> 8
            values.append(min(max(centre - off if integer < 0 else centre + off, 0), 4095))
        rows.append(values)
    return rows


def paper_binding(data: bytes, n: int) -> list[int]:
    """Section `Binding` of the paper profile."""
    fields = Fields(data)
    n_known, n_bytes = fields.read("II")
    coded = AdaptiveIntegers(fields.take(n_bytes), 1)
    known, last = [], -1
    for gap in coded.run([0] * n_known):
        last += gap + 1
        known.append(last)
    coded.end()
    tokens = Tokens(fields.take(), 2)
    high, low = tokens.batch([0] * n), tokens.batch([1] * n)
    tokens.end()
    return [known[32 * a + b + 16] for a, b in zip(high, low, strict=True)]


def rgb_of(y: float, u: float, v: float) -> tuple[float, float, float]:
    """RGB."""
    return y + 1.13983 * v, (y - 0.39465 * u) - 0.5806 * v, y + 2.03211 * u


def paper_gaussians(sections: dict[str, bytes], n: int, degree: int) -> dict[str, np.ndarray]:
    """Section "Paper"."""
    k = (degree + 1) ** 2 - 1
    fields = Fields(sections["Geometry"])
    *least, coder = fields.read("3fB")
    assert coder == 0
    widths = {"Colour": 3, "Harmonic": 3 * k, "Opacity": 1, "Scale": 3, "Rotation": 4}
    rows = [list(point) for point in paper_points(Tokens(fields.take(), 288), n)]
    for name, width in widths.items():
        more = paper_columns(sections[name], n, width) if width else [[]] * n
        rows = [row + columns for row, columns in zip(rows, more, strict=True)]
    rows.sort()
    found: dict[str, list] = {name: [] for name in ("position", *widths)}
    for row in rows:
        found["position"].append([x * 256.0 / 262143 + low for x, low in zip(row, least, strict=False)])
        at = 3
        for name, width in widths.items():
            low, extent = RANGES[name]
            found[name].append([float(x) * extent / 4095 + low for x in row[at : at + width]])
            at += width
    rest = [[rgb_of(*(one[c * k + i] for c in range(3))) for i in range(k)] for one in found["Harmonic"]]
    return {
        "position": np.array(found["position"]).reshape(n, 3),
        "log_scale": np.array(found["Scale"]).reshape(n, 3),
        "quaternion": np.array(found["Rotation"]).reshape(n, 4),
        "opacity_logit": np.array(found["Opacity"]).reshape(n),
        "sh_dc": np.array([rgb_of(*one) for one in found["Colour"]]).reshape(n, 3),
        "sh_rest": np.array(rest).reshape(n, k, 3),
        "binding": np.array(paper_binding(sections["Binding"], n), int),
    }


def paper_motion(sections: dict[str, bytes], t: int, e: int, s: int, o: int) -> dict[str, np.ndarray]:
    """Motion of the paper profile."""
    fields = Fields(sections["Static"])
    shape_step, offset_step = fields.read("dd")
    coded = AdaptiveIntegers(fields.take(), 4)
    found = {"shape": np.array(coded.run([0] * s), float) * shape_step}
    found["static_offset"] = np.array(coded.run([1, 2, 3] * o), float).reshape(o, 3).cumsum(axis=0) * offset_step
    coded.end()
    fields = Fields(sections["Motion"])
    _, *steps = fields.read("4d")
    coded = AdaptiveIntegers(fields.take(), 6)
    widths = WIDTHS | {"expression": e}
    kinds = np.repeat(range(6), list(widths.values())).tolist()
    frames = np.array([coded.run(kinds) for _ in range(t)], float).reshape(t, e + 18).cumsum(axis=0)
    coded.end()
    columns = np.split(frames, np.cumsum(list(widths.values()))[:-1], axis=1)
    return found | {
        name: column * steps[step] for name, column, step in zip(widths, columns, [0, 1, 1, 1, 1, 2], strict=True)
    }
