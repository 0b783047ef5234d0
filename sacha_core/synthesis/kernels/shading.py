"""From the depth buffer to a picture: interpolate, shade each sample, average samples to pixels."""

from __future__ import annotations

import numpy as np

from sacha_core.parallel.kernels.kernel import kernel
from sacha_core.synthesis.kernels.surface import SUBPIXEL_BITS

FAST = {"contract", "nsz", "arcp", "reassoc"}
UNIT = 1 << SUBPIXEL_BITS
HALF = UNIT >> 1

SKIN, EYE, HAIR, CLOTH = 0, 1, 2, 3  # kinds of triangle

# Columns of the table of vertices.
POSITION, NORMAL, IRRADIANCE, ALBEDO, REST, GLOSS, OPACITY, N_COLUMNS = 0, 3, 6, 9, 12, 15, 16, 17

f32 = np.float32


@kernel(fastmath=FAST, forceinline=True)
def lattice(x, y, z):
    """Give a value in [0, 1) that looks random for each point of the integer lattice."""
    key = (
        np.uint32(x) * np.uint32(0x8DA6B343)
        ^ np.uint32(y) * np.uint32(0xD8163841)
        ^ np.uint32(z) * np.uint32(0xCB1AB31F)
    )
    key = np.uint32((key ^ (key >> np.uint32(15))) * np.uint32(0x2C1B3C6D))
    key = np.uint32((key ^ (key >> np.uint32(12))) * np.uint32(0x297A2D39))
    return f32(key >> np.uint32(8)) * f32(1 / (1 << 24))


@kernel(fastmath=FAST, forceinline=True)
def noise(x, y, z):
    """Give smooth noise in [-1, 1] with features of unit size.

    Source: value noise, Perlin, SIGGRAPH 1985, in its simplest form.
    """
    i, j, k = int(np.floor(x)), int(np.floor(y)), int(np.floor(z))
    a, b, c = f32(x - i), f32(y - j), f32(z - k)
    a, b, c = a * a * (f32(3) - f32(2) * a), b * b * (f32(3) - f32(2) * b), c * c * (f32(3) - f32(2) * c)
    total = f32(0)
    for corner in range(8):
        di, dj, dk = corner & 1, (corner >> 1) & 1, corner >> 2
        weight = (a if di else f32(1) - a) * (b if dj else f32(1) - b) * (c if dk else f32(1) - c)
        total += weight * lattice(i + di, j + dj, k + dk)
    return f32(2) * total - f32(1)


@kernel
def noise_at(points, frequency):
    """Give the noise at points (n, 3), metres, with `frequency` features to a metre."""
    values = np.empty(len(points))
    for i in range(len(points)):
        values[i] = noise(points[i, 0] * frequency, points[i, 1] * frequency, points[i, 2] * frequency)
    return values


@kernel(fastmath=FAST, forceinline=True)
def step(low, high, x):
    """Rise smoothly from 0 at `low` to 1 at `high`."""
    t = min(max((x - low) / (high - low), f32(0)), f32(1))
    return t * t * (f32(3) - f32(2) * t)


@kernel(fastmath=FAST, forceinline=True)
def paint_eye(direction, iris, albedo):
    """Fill `albedo` (3,) with the colour of an eyeball seen in `direction` (3,) from its centre; z is where it looks.

    `iris`: (5,) linear RGB of the iris, sine of the angle of its border, of the pupil's.
    """
    radius = np.sqrt(direction[0] * direction[0] + direction[1] * direction[1])
    turn = np.arctan2(direction[1], direction[0])
    border, pupil = iris[3], iris[4]
    if direction[2] < 0 or radius > border * f32(1.12):
        vein = f32(0.5) + f32(0.5) * noise(direction[0] * f32(9), direction[1] * f32(24), direction[2] * f32(9))
        corner = step(f32(0.5), f32(1.0), radius)
        red = corner * (f32(0.25) + f32(0.5) * vein)
        albedo[0], albedo[1], albedo[2] = f32(0.78), f32(0.74) - f32(0.3) * red, f32(0.71) - f32(0.3) * red
        return
    fibre = noise(turn * f32(7), radius * f32(5), f32(0)) * f32(0.6) + noise(
        turn * f32(16), radius * f32(9), f32(7)
    ) * f32(0.4)
    inner = f32(1) - step(pupil, border * f32(0.8), radius)
    tone = f32(0.75) + f32(0.3) * fibre + f32(0.5) * inner
    limbus = step(border * f32(0.78), border, radius)
    dark = step(pupil * f32(0.88), pupil * f32(1.08), radius)
    white = step(border * f32(0.94), border * f32(1.1), radius)
    warm = inner * f32(0.25)
    for k in range(3):
        colour = iris[k] * tone * (f32(1) - f32(0.75) * limbus)
        if k == 0:
            colour += warm * f32(0.12)
        colour = f32(0.006) + (colour - f32(0.006)) * dark
        albedo[k] = colour + ((f32(0.78), f32(0.74), f32(0.71))[k] - colour) * white


@kernel(fastmath=FAST, forceinline=True)
def paint_shirt(rest, shirt, albedo):
    """Cover `albedo` (3,) by the shirt below its collar, with a ribbed neckband, and shade the skin above; give how much is cloth."""
    below = (shirt[3] - shirt[4] * rest[2] - rest[1]) / shirt[6]
    cover = step(f32(-0.012), f32(0.012), below)
    turn = np.arctan2(rest[0], rest[2] - shirt[5])
    band = step(f32(0.24), f32(0.21), below)
    weave = f32(0.08) * np.sin(f32(70) * turn) * band
    weave += f32(0.04) * (f32(1) - band) * noise(rest[0] * f32(500), rest[1] * f32(500), rest[2] * f32(500))
    seam = f32(0.35) * np.exp(-(((below - f32(0.225)) / f32(0.02)) ** 2))
    edge = f32(0.25) * np.exp(-((below / f32(0.03)) ** 2))
    shadow = f32(1) - f32(0.45) * np.exp(-(((below - f32(0.0)) / f32(0.07)) ** 2))
    for k in range(3):
        cloth = shirt[k] * (f32(1) + weave - seam + edge)
        albedo[k] = albedo[k] * shadow * (f32(1) - cover) + cloth * cover
    return cover


@kernel(fastmath=FAST, forceinline=True)
def add_surface_highlights(vertex, view, lamps, shade, gloss, strength, colour):
    """Add what a smooth surface reflects: a lobe for each lamp, and the sky at grazing angles.

    `vertex` (17,) interpolated; `view` (3,) unit, towards the camera; `shade`: how much of the light gets here, 0 to 1.
    """
    nx, ny, nz = vertex[NORMAL], vertex[NORMAL + 1], vertex[NORMAL + 2]
    facing = max(nx * view[0] + ny * view[1] + nz * view[2], f32(0))
    grazing = (f32(1) - facing) ** 5
    exponent = f32(8) * f32(2) ** (f32(6) * gloss)
    for i in range(len(lamps)):
        lx, ly, lz = lamps[i, 0], lamps[i, 1], lamps[i, 2]
        lit = nx * lx + ny * ly + nz * lz
        if lit <= 0:
            continue
        hx, hy, hz = lx + view[0], ly + view[1], lz + view[2]
        length = np.sqrt(hx * hx + hy * hy + hz * hz)
        if length < f32(1e-4):
            continue
        half = max((nx * hx + ny * hy + nz * hz) / length, f32(0))
        towards = max((view[0] * hx + view[1] * hy + view[2] * hz) / length, f32(0))
        fresnel = f32(0.04) + f32(0.96) * (f32(1) - towards) ** 5
        lobe = half**exponent * (exponent + f32(8)) * f32(0.125) * lit * fresnel * strength * shade
        for k in range(3):
            colour[k] += lobe * lamps[i, 3 + k]
    for k in range(3):
        colour[k] += grazing * strength * shade * f32(0.22) * vertex[IRRADIANCE + k]


@kernel(fastmath=FAST, forceinline=True)
def add_hair_highlights(vertex, view, lamps, shade, tint, colour):
    """Add the two highlights of hair, of which the tangent stands in the normal's place.

    Source: Kajiya and Kay, Rendering fur with three dimensional textures, SIGGRAPH 1989; the coloured second lobe after Marschner 2003.
    """
    tx, ty, tz = vertex[NORMAL], vertex[NORMAL + 1], vertex[NORMAL + 2]
    for i in range(len(lamps)):
        hx, hy, hz = lamps[i, 0] + view[0], lamps[i, 1] + view[1], lamps[i, 2] + view[2]
        length = np.sqrt(hx * hx + hy * hy + hz * hz)
        if length < f32(1e-4):
            continue
        along = (tx * hx + ty * hy + tz * hz) / length
        white = np.sqrt(max(f32(1) - (along - f32(0.12)) ** 2, f32(0))) ** 60
        coloured = np.sqrt(max(f32(1) - (along + f32(0.14)) ** 2, f32(0))) ** 16
        for k in range(3):
            colour[k] += shade * lamps[i, 3 + k] * (f32(0.022) * white + f32(0.22) * coloured * tint[k])


@kernel(fastmath=FAST, forceinline=True)
def paint_surface_sample(vertex, kind, iris, shirt, albedo):
    """Give `vertex` a unit normal and `albedo` (3,) its fine detail; return gloss and strength of highlights."""
    length = np.sqrt(vertex[NORMAL] ** 2 + vertex[NORMAL + 1] ** 2 + vertex[NORMAL + 2] ** 2)
    for k in range(3):
        vertex[NORMAL + k] /= max(length, f32(1e-6))
    rest = vertex[REST : REST + 3]
    if kind == EYE:
        paint_eye(rest, iris, albedo)
        return f32(1), f32(1.6)
    pore = noise(rest[0] * f32(520), rest[1] * f32(520), rest[2] * f32(520))
    for k in range(3):
        albedo[k] *= f32(1) + f32(0.035) * pore
    strength = (f32(0.15) + f32(0.75) * vertex[GLOSS]) * (f32(1) + f32(0.2) * pore)
    if kind == CLOTH:
        strength *= f32(1) - f32(0.8) * paint_shirt(rest, shirt, albedo)
    return vertex[GLOSS], strength


@kernel(fastmath=FAST, forceinline=True)
def shade_sample(vertex, kind, back, lamps, iris, shirt, centre, view, albedo, colour):
    """Fill `colour` (3,), linear RGB between 0 and 1, of one interpolated vertex."""
    vx, vy, vz = centre[0] - vertex[0], centre[1] - vertex[1], centre[2] - vertex[2]
    scale = f32(1) / np.sqrt(vx * vx + vy * vy + vz * vz)
    view[0], view[1], view[2] = vx * scale, vy * scale, vz * scale
    shade = min((vertex[IRRADIANCE] + vertex[IRRADIANCE + 1] + vertex[IRRADIANCE + 2]) * f32(0.25), f32(1))
    for k in range(3):
        albedo[k] = vertex[ALBEDO + k]
    if back:  # inside of the head, seen through an opening
        for k in range(3):
            colour[k] = f32(0.02) * albedo[k]
        return
    if kind == HAIR:
        for k in range(3):
            colour[k] = albedo[k] * vertex[IRRADIANCE + k]
        add_hair_highlights(vertex, view, lamps, shade, albedo, colour)
    else:
        gloss, strength = paint_surface_sample(vertex, kind, iris, shirt, albedo)
        for k in range(3):
            colour[k] = albedo[k] * vertex[IRRADIANCE + k]
        add_surface_highlights(vertex, view, lamps, shade, gloss, strength, colour)
    for k in range(3):
        colour[k] = f32(1) - np.exp(-colour[k])  # the camera's shoulder


@kernel(fastmath=FAST)
def shade_image(
    ids,
    screen,
    inverse_depth,
    faces,
    kinds,
    n_surface,
    table,
    lamps,
    iris,
    shirt,
    centre,
    encode,
    supersample,
    image,
    mask,
):
    """Shade all samples of a drawn depth buffer and average them to `image` (h, w, 3) and `mask` (h, w), uint8, on white.

    Vertices from `n_surface` on are pairs on both sides of a strand's point: they share a row of `table`. `encode` is a table from
    linear [0, 1] to sRGB bytes.
    """
    height, width = mask.shape
    vertex = np.empty(N_COLUMNS, np.float32)
    view, albedo, colour = np.empty(3, np.float32), np.empty(3, np.float32), np.empty(3, np.float32)
    share = f32(1) / f32(supersample * supersample)
    top = f32(len(encode) - 1)
    for row in range(height):
        for column in range(width):
            red = green = blue = cover = f32(0)
            for sample in range(supersample * supersample):
                y, x = row * supersample + sample // supersample, column * supersample + sample % supersample
                face = ids[y, x]
                if face < 0:
                    red += f32(1)
                    green += f32(1)
                    blue += f32(1)
                    continue
                a, b, c = faces[face, 0], faces[face, 1], faces[face, 2]
                xa, ya = int(screen[a, 0]), int(screen[a, 1])
                xb, yb = int(screen[b, 0]), int(screen[b, 1])
                xc, yc = int(screen[c, 0]), int(screen[c, 1])
                px, py = x * UNIT + HALF, y * UNIT + HALF
                wa = f32((xc - xb) * (py - yb) - (yc - yb) * (px - xb)) * inverse_depth[a]
                wb = f32((xa - xc) * (py - yc) - (ya - yc) * (px - xc)) * inverse_depth[b]
                wc = f32((xb - xa) * (py - ya) - (yb - ya) * (px - xa)) * inverse_depth[c]
                scale = f32(1) / (wa + wb + wc)
                wa, wb, wc = wa * scale, wb * scale, wc * scale
                kind = kinds[face]
                area = (xb - xa) * (yc - ya) - (yb - ya) * (xc - xa)
                back = (
                    area > 0 and kind != HAIR
                )  # y points down: what is counter-clockwise in the world is clockwise here
                if a >= n_surface:
                    a, b, c = (a + n_surface) >> 1, (b + n_surface) >> 1, (c + n_surface) >> 1
                for k in range(N_COLUMNS):
                    vertex[k] = wa * table[a, k] + wb * table[b, k] + wc * table[c, k]
                shade_sample(vertex, kind, back, lamps, iris, shirt, centre, view, albedo, colour)
                opacity = f32(0) if back and kind == CLOTH else vertex[OPACITY]  # the bust is open below
                cover += opacity
                clear = f32(1) - opacity
                red += opacity * colour[0] + clear
                green += opacity * colour[1] + clear
                blue += opacity * colour[2] + clear
            image[row, column, 0] = encode[int(min(red * share, f32(1)) * top + f32(0.5))]
            image[row, column, 1] = encode[int(min(green * share, f32(1)) * top + f32(0.5))]
            image[row, column, 2] = encode[int(min(blue * share, f32(1)) * top + f32(0.5))]
            mask[row, column] = int(min(cover * share, f32(1)) * f32(255) + f32(0.5))
