"""A decoder of `.sacha` files in plain Python, written from FORMAT.md alone: an oracle that shares nothing with the codec.

It trusts its input: what it must refuse is tested elsewhere. Sections follow the order of the page.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence

import numpy as np
from reference_axes import Axes, Quaternion, likeness, product
from reference_motion import dynamic_of, static_of
from reference_places import Head, Pass, Places, Trusted, all_passes, first_passes, known_head, mean, unknown_head
from reference_profiles import archive_gaussians, archive_motion, paper_gaussians, paper_motion, rgb_of
from reference_streams import AdaptiveIntegers, Fields, Tokens, sections_of

STEP = [math.isqrt(math.isqrt(math.isqrt(1 << e))) for e in range(224)]
COUNT_BOUNDS = (1, 4, 8, 12, 16, 20, 24, 32, 40, 48, 64, 96, 128, 256, 512)
Classes = tuple[int, int, int, int]  # T, Z, E, H


class Rule:
    """Section "Steps"."""

    def __init__(self, fields: Fields) -> None:
        *self.weights, self.reference, self.low, self.high, self.base, self.of_hidden = fields.read("5b3B")

    def shift(self, classes: Classes) -> int:
        """Shift of the exponent."""
        t, z, e, h = classes
        of_t, of_z, of_e = self.weights
        return min(max(of_t * t + of_z * (self.reference - z) - of_e * e, self.low), self.high) + self.of_hidden * h

    def step(self, classes: Classes) -> int:
        """Step of a Gaussian."""
        return STEP[self.base + self.shift(classes)]


def numbers_of(data: bytes, head: Head) -> tuple[bool, list[int]]:
    """Section "Order of Gaussians": whether places are vertices, and how many Gaussians each carries."""
    by_vertex = data[0] == 1
    places = head.vertices if by_vertex else head.triangles
    assert places is not None
    tokens, numbers = Tokens(data[1:], 16), [0] * len(places.point)
    for step in first_passes(places, list(range(len(numbers))), by_vertex):
        sixteenths = [16 * min(one, 1 << 30) for one in numbers]
        contexts = [sum(bound <= mean(sixteenths, near) for bound in COUNT_BOUNDS) for near in step.near]
        for row, integer in zip(step.rows, tokens.batch(contexts), strict=True):
            numbers[row] = integer
    tokens.end()
    return by_vertex, numbers


def differences(
    fields: Fields,
    passes: list[Pass],
    n: int,
    width: int,
    step: Callable[[int, int], int],
    take: Callable[[Pass, int, list[int]], None],
) -> None:
    """Section "Differences": `step` tells that of a row and component, `take` is given those of a pass and component."""
    (n_bytes,) = fields.read("B")
    coded = AdaptiveIntegers(fields.take(n_bytes), 3)
    weights = np.array(coded.run([0] * (width * 2 * (width + 3))), int).reshape(width, 2, width + 3).tolist()
    floors = np.array(coded.run([1] * (width * 2)), int).reshape(width, 2).tolist()
    offsets = np.array(coded.run([2] * (width * 4)), int).reshape(width, 4).tolist()
    coded.end()
    tokens = Tokens(fields.take(), 22)
    sizes = [[0] * n for _ in range(width)]
    for one in passes:
        group = int(one.kind == 3)
        for i in range(width):
            contexts = []
            for row, near, mates in zip(one.rows, one.near, one.mates, strict=True):
                features = [mean(sizes[i], near), sum(mean(of, near) for of in sizes), mean(sizes[i], mates)]
                features += [sum(mean(of, mates) for of in sizes), *(sizes[c][row] for c in range(i))]
                weighed = sum(a * feature for a, feature in zip(weights[i][group], features, strict=False)) >> 6
                estimate = 16 * (weighed + STEP[floors[i][group]]) // step(row, i) + offsets[i][one.kind]
                contexts.append(sum(math.isqrt(1 << k) <= estimate for k in range(2, 23)))
            integers = tokens.batch(contexts)
            for row, integer in zip(one.rows, integers, strict=True):
                sizes[i][row] = min(abs(integer) * step(row, i), 1 << 40)
            take(one, i, [integer * step(row, i) for row, integer in zip(one.rows, integers, strict=True)])
    tokens.end()


def predicted(
    fields: Fields, passes: list[Pass], n: int, width: int, step: Callable[[int, int], int]
) -> list[list[int]]:
    """Section "Predicted values": of each row its components."""
    centre = fields.read(f"{width}q")
    weights = [[fields.read(f"{width}b") for _ in range(2)] for _ in range(4)]
    across = [fields.read(f"{i}b") for i in range(width)]
    values, off_prediction = [[0] * n for _ in range(width)], [[0] * n for _ in range(width)]

    def take(one: Pass, i: int, off: list[int]) -> None:
        fresh = []
        for row, near, mates, difference in zip(one.rows, one.near, one.mates, off, strict=True):
            terms = [mean(values[i], known) - centre[i] if known else 0 for known in (near, mates)]
            total = sum(term * weights[one.kind][k][i] for k, term in enumerate(terms))
            by_others = sum(off_prediction[c][row] * across[i][c] for c in range(i))
            off_prediction[i][row] = ((by_others + 32) >> 6) + difference
            fresh.append((row, centre[i] + ((total + 32) >> 6) + off_prediction[i][row]))
        for row, value in fresh:
            values[i][row] = value

    differences(fields, passes, n, width, step, take)
    return [list(row) for row in zip(*values, strict=True)]


def offsets_of(fields: Fields, places: Places) -> list[list[int]]:
    """Way 1 of section "Static": integers of every vertex."""
    own = [one for one, middle in enumerate(places.middle) if not middle]
    values = predicted(fields, first_passes(places, own, True), len(places.point), 3, lambda _row, _i: 1)
    return [values[place] for place in sorted(own, key=lambda one: places.own[one])]


def hidden_of(data: bytes, passes: list[Pass], n: int) -> list[int]:
    """Section "Hidden"."""
    if data[0] == 0:
        assert len(data) == 1
        return [0] * n
    return [h for (h,) in predicted(Fields(data[1:]), passes, n, 1, lambda _row, _i: 1)]


def opacity_of(data: bytes, passes: list[Pass], hidden: list[int], slot: list[int]) -> tuple[list[float], list[int]]:
    """Section "Opacity": logits and transparency classes; `slot` tells the first Gaussian of the slot of each."""
    fields = Fields(data)
    u, of_hidden, kind = fields.read("HBB")
    spacing = [min(STEP[min(of_hidden * h, 223)], u) for h in hidden]
    if kind == 1:
        values = predicted(fields, passes, len(hidden), 1, lambda row, _: spacing[row])
        index = [min(max(value, 0), u) for (value,) in values]
    else:
        index = fallen_of(fields, passes, u, spacing, slot)
    angles = [math.pi / 2 * max(0.25, min(i, u - 0.25)) / u for i in index]
    logits = [0.0 if 2 * i == u else 2 * math.log(math.tan(angle)) for i, angle in zip(index, angles, strict=True)]
    return logits, [min(round(-2 * math.log2(math.sin(angle) ** 2)), 24) for angle in angles]


def fallen_of(fields: Fields, passes: list[Pass], u: int, spacing: list[int], slot: list[int]) -> list[int]:
    """Opacity of kind 0: indices that fall within a slot."""
    (start,) = fields.read("H")
    tokens, index = Tokens(fields.take(), 256), [0] * len(spacing)
    for number, one in enumerate(passes):
        if one.kind == 3:
            low = min(row - slot[row] for row in one.rows)
            expected = [index[slot[row] + low - 1] for row in one.rows]
        else:
            expected = [mean(index, near) if number else start for near in one.near]
        octaves = [0 if s == 1 else 1 if s <= 3 else 2 if s <= 7 else 3 for s in (spacing[row] for row in one.rows)]
        contexts = [(one.kind * 4 + o) * 16 + min(16 * x // u, 15) for o, x in zip(octaves, expected, strict=True)]
        for row, x, integer in zip(one.rows, expected, tokens.batch(contexts), strict=True):
            index[row] = index[row - 1] - integer * spacing[row] if one.kind == 3 else x + integer * spacing[row]
    tokens.end()
    return index


def scales_of(data: bytes, passes: list[Pass], classes: list[Classes]) -> list[list[int]]:
    """Section "Scale": l1, l2, l3 of each Gaussian."""
    fields = Fields(data)
    rules = [Rule(fields) for _ in range(3)]
    return predicted(fields, passes, len(classes), 3, lambda row, i: rules[i].step(classes[row]))


def rotations_of(data: bytes, passes: list[Pass], classes: list[Classes], axes: list[Axes]) -> list[Quaternion]:
    """Section "Rotation"."""
    fields = Fields(data)
    (domain,) = fields.read("B")
    rules = [Rule(fields) for _ in range(3)]
    weights = [fields.read("2B") for _ in range(4)]
    n = len(classes)
    known: list[Quaternion] = [(1.0, 0.0, 0.0, 0.0)] * n
    steps = [[rule.step(one) for rule in rules] for one in classes]
    turns = [[0, 0, 0] for _ in range(n)]

    def expected(kind: int, near: Trusted, mates: Trusted) -> Quaternion:
        total: Quaternion = (0.0, 0.0, 0.0, 0.0)
        for weight, others in ((weights[kind][1], mates), (weights[kind][0], near)):
            for row, trust in others if weight else []:
                alike = likeness(known[row], total)
                total = tuple(a + b * (weight * trust) for a, b in zip(total, alike, strict=True))
        w, x, y, z = total
        length = math.sqrt(w * w + x * x + y * y + z * z)
        return tuple(one / length for one in total) if length else (1.0, 0.0, 0.0, 0.0)

    def take(one: Pass, i: int, off: list[int]) -> None:
        for row, difference in zip(one.rows, off, strict=True):
            turns[row][i] = difference
        if i == 2:
            fresh = []
            for row, near, mates in zip(one.rows, one.near, one.mates, strict=True):
                x, y, z = (value * 2.0**-14 for value in turns[row])
                s = (x * x + y * y) + z * z
                w = math.sqrt(max(1 - s, 0.0))
                length = math.sqrt(w * w + s)
                turn = (w / length, x / length, y / length, z / length)
                fresh.append((row, product(expected(one.kind, near, mates), turn)))
            for row, orientation in fresh:
                known[row] = orientation

    differences(fields, passes, n, 3, lambda row, i: steps[row][i], take)
    if domain:
        for row, axis in enumerate(axes):
            w, x, y, z = axis.quaternion()
            known[row] = product((w, -x, -y, -z), known[row])
    return known


def positions_of(
    data: bytes,
    passes: list[Pass],
    classes: list[Classes],
    z: list[int],
    axes: list[Axes],
    places: list[Sequence[float]],
) -> list[list[float]]:
    """Section "Position"; `places` are those that domain 1 starts from."""
    fields = Fields(data)
    (domain,) = fields.read("B")
    rule = Rule(fields)
    exponents = [rule.base + rule.shift(one) - (0 if domain else size) for one, size in zip(classes, z, strict=True)]
    values = predicted(fields, passes, len(classes), 3, lambda row, _: STEP[min(max(exponents[row], 0), 223)])
    if not domain:
        return [[value * 2.0**-16 for value in row] for row in values]
    found = []
    for row, axis, place in zip(values, axes, places, strict=True):
        x, y, z_ = (value / 16 + c for value, c in zip(row, place, strict=True))
        found.append([((axis.at(0, j) * x + axis.at(1, j) * y) + axis.at(2, j) * z_) / axis.scale for j in range(3)])
    return found


class Harmonics:
    """Section "Harmonic": what precedes its tokens."""

    def __init__(self, fields: Fields, k: int) -> None:
        self.rule = Rule(fields)
        self.functions = fields.read("3B")
        f = max(self.functions)
        self.shares = [fields.read("3b") for _ in range(3)]
        self.coefficients = [fields.read(f"{k}b") for _ in range(f)]
        self.exponents = fields.read(f"{f}b")
        self.components = [(one, a) for one in range(f) for a in range(3) if one < self.functions[a]]
        c = len(self.components)
        self.weights = [[fields.read(f"{c}b") for _ in range(2)] for _ in range(2)]
        self.a = [fields.read("2B") for _ in range(2)]
        self.floors = fields.read(f"{c}B")
        self.tokens = Tokens(fields.take(), 96)

    def context(self, t: int, scale: int, features: list[int], group: int, i: int) -> int:
        """Context of component i."""
        weighed = sum(a * feature for a, feature in zip(self.a[group], features, strict=True))
        estimate = STEP[self.floors[i]] + (weighed // scale >> 2)
        return min(t, 3) * 24 + sum(STEP[e] <= estimate for e in range(20, 109, 4))


def weighed(sizes: list[int], known: Trusted) -> int:
    """Sum of sizes times trust."""
    return sum(trust * sizes[row] for row, trust in known)


def harmonics_of(data: bytes, degree: int, passes: list[Pass], classes: list[Classes]) -> list[list[list[float]]]:
    """Section "Harmonic": coefficients of each Gaussian."""
    k, n = (degree + 1) ** 2 - 1, len(classes)
    told = Harmonics(Fields(data), k)
    values, sizes = ([[0] * n for _ in told.components] for _ in range(2))
    shifts = [told.rule.shift(one) for one in classes]
    scales = [STEP[64 + min(shift - told.rule.low, 127)] for shift in shifts]
    for one in passes:
        group = int(one.kind == 3)
        members = list(zip(one.rows, one.near, one.mates, strict=True))
        contexts = [
            told.context(classes[row][0], scales[row], [weighed(sizes[i], near), weighed(sizes[i], mates)], group, i)
            for row, near, mates in members
            for i in range(len(told.components))
        ]
        integers = iter(told.tokens.batch(contexts))
        fresh = []
        for row, near, mates in members:
            for i, (f, _) in enumerate(told.components):
                integer = next(integers)
                total = sum(
                    mean(values[i], known) * told.weights[group][term][i] for term, known in enumerate((near, mates))
                )
                step = STEP[told.rule.base + shifts[row] + told.exponents[f]]
                fresh.append((i, row, ((total + 32) >> 6) + integer * step, min(abs(integer) * scales[row], 1 << 28)))
        for i, row, value, size in fresh:
            values[i][row], sizes[i][row] = value, size
    told.tokens.end()

    def colour(row: int, j: int, channel: int) -> float:
        parts = enumerate(told.components)
        return (
            sum(values[i][row] * told.coefficients[f][j] * told.shares[axis][channel] for i, (f, axis) in parts)
            * 2.0**-28
        )

    return [[[colour(row, j, channel) for channel in range(3)] for j in range(k)] for row in range(n)]


def gaussians_of(sections: dict[str, bytes], degree: int, head: Head) -> dict[str, np.ndarray]:
    """All sections of the Gaussians of a lossy file."""
    by_vertex, numbers = numbers_of(sections["Counts"], head)
    places = head.vertices if by_vertex else head.triangles
    assert places is not None
    passes = all_passes(places, numbers, by_vertex)
    where = [one for one, number in enumerate(numbers) for _ in range(number)]
    slot, n = [where.index(one) for one in where], len(where)
    binding = [places.triangle[one] for one in where]
    z = [head.z[face] for face in binding]
    hidden = hidden_of(sections["Hidden"], passes, n)
    logits, transparency = opacity_of(sections["Opacity"], passes, hidden, slot)
    seen = list(zip(transparency, hidden, strict=True))
    scales = scales_of(sections["Scale"], passes, [(t, 0, 0, h) for t, h in seen])
    classes = [
        (t, (a + b) * 189093 >> 29, max((a - b) * 189093 >> 28, 0), h)
        for (t, h), (a, b, _) in zip(seen, scales, strict=True)
    ]
    corners, axes = [head.corners[face] for face in binding], [head.axes[face] for face in binding]
    starts: list[Sequence[float]] = [(0.0, 0.0, 0.0)] * n
    if by_vertex:
        starts = [
            [(3 * x - 2 * sum(c[i] for c in three)) / 6 for i, x in enumerate(places.point[one])]
            for one, three in zip(where, corners, strict=True)
        ]
    fields = Fields(sections["Colour"])
    colour = [Rule(fields) for _ in range(3)]
    yuv = predicted(fields, passes, n, 3, lambda row, i: colour[i].step(classes[row]))
    rest = harmonics_of(sections["Harmonic"], degree, passes, classes) if degree else []
    log_scales = [[(x - (size * 90852 >> 8)) * 2.0**-12 for x in scale] for size, scale in zip(z, scales, strict=True)]
    return {
        "position": np.array(positions_of(sections["Position"], passes, classes, z, axes, starts)).reshape(n, 3),
        "log_scale": np.array(log_scales).reshape(n, 3),
        "quaternion": np.array(rotations_of(sections["Rotation"], passes, classes, axes)).reshape(n, 4),
        "opacity_logit": np.array(logits).reshape(n),
        "sh_dc": np.array([rgb_of(*(one * 2.0**-14 for one in row)) for row in yuv]).reshape(n, 3),
        "sh_rest": np.array(rest).reshape(n, (degree + 1) ** 2 - 1, 3),
        "binding": np.array(binding, int),
    }


def reference_decode(data: bytes, vertices: np.ndarray, faces: np.ndarray) -> dict[str, dict[str, np.ndarray]]:
    """Give the arrays of Gaussians and motion; `vertices` and `faces` are the unposed head's."""
    sections = sections_of(data)
    profile, _, degree, flags, n, _, f, t, e, s, o = Fields(sections["Header"]).read("BhBB7I")
    motion = {}
    if profile == 1:
        gaussians = archive_gaussians(sections, n, degree, flags)
        motion = archive_motion(sections, t, e, s, o) if flags & 1 else {}
    elif profile == 2:
        gaussians = paper_gaussians(sections, n, degree)
        motion = paper_motion(sections, t, e, s, o) if flags & 1 else {}
    else:
        head = known_head(vertices, faces) if flags & 2 else unknown_head(f)
        gaussians = gaussians_of(sections, degree, head)
        motion = (
            static_of(sections["Static"], s, o, lambda fields: offsets_of(fields, head.vertices))
            | dynamic_of(sections["Motion"], t, e)
            if flags & 1
            else {}
        )
    integers = {"binding": np.int32}
    parts = {"gaussians": {name: array.astype(integers.get(name, np.float32)) for name, array in gaussians.items()}}
    return parts | ({"motion": {name: array.astype(np.float32) for name, array in motion.items()}} if motion else {})
