"""Colours of surfaces: asphalt, brick, windows, leaves; filtered to a pixel's footprint (numba).

After an edit here, touch `shading.py` (see `noise.py`).
"""

from __future__ import annotations

import math

from numba import njit

from pseudolidar.sources.worlds.materials import Material
from pseudolidar.sources.worlds.noise import band, fractal, fraction, joints, lit, mix, uniform

# Numba freezes enum members into constants.
PLAIN, ASPHALT, PAVEMENT, GRASS = (int(m) for m in list(Material)[:4])
BRICK, PLASTER, FACADE, ROOF, PAINT, CABIN = (int(m) for m in list(Material)[4:10])
RUBBER, CLOTH, BARK, LEAF, METAL = (int(m) for m in list(Material)[10:15])
PLANKS, POSTER, SHELF, FIELD, GRAVEL, SIGN = (int(m) for m in list(Material)[15:21])

# The hills' edge against the sky is this soft, slope: about a pixel.
HILL_EDGE = 0.0015


@njit(nogil=True, cache=True, error_model="numpy")
def _road(s, n, width, seed):  # type: ignore[no-untyped-def]
    """Asphalt brightness and share of white paint; (s, n) along and across the road."""
    grain = 0.26 * fractal(s, n, width, seed, 0.08, 3, 0.8)
    patches = 0.16 * fractal(s * 0.5, n, width, seed + 31, 2.4, 4, 0.65)
    wheels = -0.06 * (abs(abs(n) - 1.0) < 0.35)
    cracks = 0.0
    if width < 0.04:
        crack = abs(fractal(s, n, width, seed + 57, 1.7, 2, 0.5))
        cracks = -0.4 * band(crack, -1.0, 0.01, 0.02 + width) * (1.0 - width / 0.04)
    dashes = band(fraction(s, 9.0), 0.0, 3.0, width) * band(n, -0.07, 0.07, width)
    white = max(dashes, band(abs(n), 3.32, 3.46, width))
    if white > 0.0:
        white = min(1.0, white * (0.72 + 0.4 * fractal(s, n, width, seed + 77, 0.3, 4, 0.7)))
    return 1.0 + grain + patches + cracks + wheels, white


@njit(nogil=True, cache=True, error_model="numpy")
def _wall(a, h, width, seed, c):  # type: ignore[no-untyped-def]
    """Brick for some seeds, plaster with faint stains for the others."""
    if uniform(seed, 3, 11) < 0.4:
        joint, tint = joints(a, h, 0.25, 0.08, 0.014, width, seed)
        stain = 0.16 * fractal(a, h, width, seed, 1.6, 6, 0.7)
        return mix(lit(c, 1.0 + 0.25 * tint + stain), (0.32, 0.30, 0.27), joint)
    streaks = 0.06 * fractal(a * 3.0, 0.3 * h, width, seed + 9, 1.0, 3, 0.6)
    return lit(c, 1.0 + streaks + 0.05 * fractal(a, h, width, seed, 1.6, 7, 0.8))


@njit(nogil=True, cache=True, error_model="numpy")
def _pane(x, y, wide, high, cell, width, seed):  # type: ignore[no-untyped-def]
    """Colour of a window pane at (x, y) in it: dark room, curtains, a hint of sky."""
    glow = 0.05 + 0.10 * max(0.0, y / high - 0.4) + 0.02 * fractal(x, y, width, cell, 0.5, 3, 0.5)
    room = (glow, 1.05 * glow, 1.15 * glow)
    drawn = 0.15 + 0.25 * uniform(cell, 7, seed)
    pleats = 0.8 + 0.2 * math.sin(70.0 * x) * math.exp(-((width / 0.05) ** 2))
    curtain = band(abs(x - 0.5 * wide) / wide, 0.5 - drawn, 1.0, width) * (
        uniform(cell, 8, seed) < 0.7
    )
    light = 0.38 * pleats
    room = mix(room, (light, 0.97 * light, 0.88 * light), curtain)
    frame = 1.0 - band(x, 0.06, wide - 0.06, width) * band(y, 0.06, high - 0.06, width)
    frame = max(frame, band(x, 0.5 * wide - 0.03, 0.5 * wide + 0.03, width))
    return mix(room, (0.62, 0.61, 0.58), frame)


@njit(nogil=True, cache=True, error_model="numpy")
def _facade(a, h, width, seed, c):  # type: ignore[no-untyped-def]
    """A wall with windows and doors; (a, h) along the wall and above the ground."""
    c = _wall(a, h, width, seed, c)
    plinth = band(h, -9.0, 0.45, width)
    if plinth > 0.0:
        stone = 0.15 * (1.0 + 0.25 * fractal(a, h, width, seed + 5, 0.4, 5, 0.7))
        c = mix(c, (stone, stone, 0.95 * stone), plinth)
    pitch, storey = 2.3 + 0.9 * uniform(seed, 1, 2), 2.9
    wide, high = 1.0 + 0.5 * uniform(seed, 1, 3), 1.35
    column, floor = math.floor(a / pitch), math.floor(h / storey)
    cell = column * 131 + floor * 17 + seed
    x, y = a - column * pitch - 0.5 * (pitch - wide), h - floor * storey - 0.95
    door = floor == 0 and uniform(column, 5, seed) < 0.3
    if door:
        y, high = y + 0.95, 2.1
    opening = band(x, 0.0, wide, width) * band(y, 0.0, high, width) * (h > 0.0)
    sill = band(x, -0.08, wide + 0.08, width) * band(y, -0.1, 0.0, width)
    c = mix(c, (0.45, 0.44, 0.42), sill * (not door))
    if opening <= 0.0:
        return c
    if door:
        panel = 0.6 + 0.4 * band(fraction(y, 0.7), 0.08, 0.62, width) * band(
            x, 0.12, wide - 0.12, width
        )
        tone = 0.10 + 0.25 * uniform(cell, 2, 2)
        return mix(c, lit((tone, 0.12, 0.3 - tone * 0.6), panel), opening)
    return mix(c, _pane(x, y, wide, high, cell, width, seed), opening)


@njit(nogil=True, cache=True, error_model="numpy")
def _cabin(x, y, z, width, side, c):  # type: ignore[no-untyped-def]
    """Upper part of a car: glass between pillars; roof where the surface looks up."""
    if side == 2:
        return c
    glass = (0.035, 0.04, 0.045)
    pillar = 0.0
    if side == 1:
        pillar = max(band(x, -0.32, -0.22, width), band(abs(x + 0.2), 1.12, 9.0, width))
    top = band(z, 1.36, 9.0, width)
    shine = 0.025 * fractal(x + y, z, width, 5, 0.5, 4, 0.7)
    glass = (glass[0] + shine, glass[1] + shine, glass[2] + 1.2 * shine)
    return mix(glass, c, max(pillar, top))


@njit(nogil=True, cache=True, error_model="numpy")
def _paint(x, y, z, width, side, c):  # type: ignore[no-untyped-def]
    """Lower part of a car: paint with doors, lamps, bumpers and a number plate."""
    grime = 0.05 * fractal(x + 2.0 * y, z, width, 3, 0.6, 5, 0.6) - 0.5 * band(z, -1.0, 0.32, width)
    c = lit(c, 1.0 + grime)
    if side == 1:
        seam = max(band(abs(x + 0.25), 0.0, 0.012, width), band(abs(x + 0.25), 1.0, 1.012, width))
        handle = band(abs(x + 0.1), 0.55, 0.68, width) * band(z, 0.78, 0.82, width)
        return mix(c, (0.02, 0.02, 0.02), min(1.0, seam + handle))
    if side == 0:
        lamp = band(abs(y), 0.5, 0.82, width) * band(z, 0.62, 0.8, width)
        c = mix(c, (0.8, 0.8, 0.75) if x > 0.0 else (0.45, 0.02, 0.02), lamp)
        plate = band(abs(y), -1.0, 0.26, width) * band(z, 0.45, 0.56, width)
        letters = band(fraction(y, 0.075), 0.0, 0.04, width) * band(z, 0.47, 0.54, width)
        c = mix(c, (0.75, 0.75, 0.7), plate)
        c = mix(c, (0.03, 0.03, 0.03), plate * letters)
        bumper = band(z, 0.0, 0.42, width)
        return mix(c, (0.05, 0.05, 0.05), bumper)
    return c


@njit(nogil=True, cache=True, error_model="numpy")
def _poster(a, b, width, seed):  # type: ignore[no-untyped-def]
    """A picture: patches of strong colour with fine structure."""
    warp = fractal(a, b, width, seed, 0.3, 3, 0.6)
    u = 0.5 + 0.5 * math.sin(6.0 * warp + 3.0 * uniform(seed, 1, 1))
    v = 0.5 + 0.5 * math.sin(9.0 * fractal(b, a, width, seed + 40, 0.22, 3, 0.6))
    fine = 1.0 + 0.5 * fractal(a, b, width, seed + 80, 0.05, 4, 0.8)
    return lit((0.08 + 0.6 * u, 0.07 + 0.4 * v, 0.1 + 0.5 * (1.0 - u) * v), fine)


@njit(nogil=True, cache=True, error_model="numpy")
def _books(a, b, width, seed):  # type: ignore[no-untyped-def]
    """A shelf of books: boards, and spines of random width, height and colour."""
    row = math.floor(b / 0.36)
    y = b - row * 0.36
    column = math.floor(a / 0.045)
    x = a - column * 0.045
    top = 0.22 + 0.1 * uniform(column, row, seed)
    tone = 0.06 + 0.5 * uniform(column, row, seed + 1)
    spine = (
        tone,
        0.05 + 0.4 * uniform(column, row, seed + 2),
        0.05 + 0.4 * uniform(column, row, seed + 3),
    )
    title = band(y, 0.08, 0.16, width) * band(x, 0.012, 0.03, width)
    spine = mix(spine, (0.7, 0.65, 0.5), 0.7 * title)
    book = band(y, 0.03, top, width) * band(x, 0.002, 0.043, width)
    c = mix((0.03, 0.025, 0.02), spine, book)
    board = band(y, 0.0, 0.03, width)
    wood = 0.25 * (1.0 + 0.3 * fractal(a * 0.2, b * 3.0, width, seed, 0.1, 4, 0.7))
    return mix(c, (wood, 0.7 * wood, 0.45 * wood), board)


@njit(nogil=True, cache=True, error_model="numpy")
def albedo(material, x, y, z, side, width, seed, c):  # type: ignore[no-untyped-def]
    """Linear colour of a surface point.

    Args:
        material: `Material`.
        x: texture coordinate, metres.
        y: texture coordinate, metres.
        z: texture coordinate, metres.
        side: axis of the texture frame that the surface faces most: 0, 1 or 2.
        width: footprint that the colour is averaged over, metres.
        seed: which wall, which tree.
        c: base colour.
    """
    a, b = (y, z) if side == 0 else ((x, z) if side == 1 else (x, y))
    if material == ASPHALT:
        level, white = _road(a, b, width, seed)
        return mix(lit(c, level), (0.62, 0.62, 0.6), white)
    if material == FACADE and side != 2:
        return _facade(a, b, width, seed, c)
    if material == PLASTER:
        return lit(c, 1.0 + 0.06 * fractal(a, b, width, seed, 2.0, 9, 0.76))
    if material in (BRICK, FACADE):
        return _wall(a, b, width, 4, c)
    if material == LEAF:
        level = 1.0 + 0.30 * fractal(a + 0.37 * z, b + 0.61 * y, width, seed, 0.5, 6, 1.0)
        yellow = 0.2 * fractal(a, b, width, seed + 3, 1.1, 2, 0.6)
        return lit((c[0] * (1.0 + yellow), c[1], c[2]), level)
    if material == GRASS:
        level = 1.0 + 0.2 * fractal(a, b, width, seed, 0.8, 7, 0.95)
        dry = 0.25 + 0.3 * fractal(a, b, width, seed + 20, 6.0, 5, 0.6)
        return lit(mix(c, (1.5 * c[1], 1.3 * c[1], c[2]), min(1.0, max(0.0, dry))), level)
    if material == PAVEMENT:
        joint, tint = joints(a, b, 0.5, 0.5, 0.015, width, seed)
        level = 1.0 + 0.10 * tint + 0.16 * fractal(a, b, width, seed, 0.8, 7, 0.75)
        return lit(c, level * (1.0 - 0.55 * joint))
    if material == ROOF:
        joint, tint = joints(a, b, 0.3, 0.22, 0.03, width, seed)
        level = 1.0 + 0.2 * tint + 0.15 * fractal(a, b, width, seed, 1.5, 6, 0.7)
        return lit(c, level * (1.0 - 0.5 * joint))
    if material == PAINT:
        return _paint(x, y, z, width, side, c)
    if material == CABIN:
        return _cabin(x, y, z, width, side, c)
    if material == BARK:
        return lit(c, 1.0 + 0.4 * fractal(a * 4.0, b * 0.7, width, seed, 0.4, 5, 0.75))
    if material == CLOTH:
        return lit(c, 1.0 + 0.3 * fractal(a, b, width, seed, 0.25, 5, 0.8))
    if material in (METAL, RUBBER):
        return lit(c, 1.0 + 0.15 * fractal(a, b, width, seed, 0.3, 5, 0.7))
    if material == PLANKS:
        joint, tint = joints(a, b, 1.4, 0.14, 0.006, width, seed)
        level = 1.0 + 0.22 * tint + 0.3 * fractal(a * 0.15, b, width, seed, 0.08, 5, 0.7)
        return lit(c, level * (1.0 - 0.6 * joint))
    if material == POSTER:
        return _poster(a, b, width, seed)
    if material == SHELF:
        return _books(a, b, width, seed)
    if material == FIELD:
        rows = 0.22 * math.sin(a * 8.0) * math.exp(-((width / 0.5) ** 2))
        return lit(c, 1.0 + rows + 0.24 * fractal(a, b, width, seed, 4.0, 10, 0.8))
    if material == GRAVEL:
        return lit(c, 1.0 + 0.25 * fractal(a, b, width, seed, 1.0, 8, 0.85))
    if material == SIGN:
        radius = math.sqrt(a * a + b * b)
        rim = 1.0 - band(radius, -1.0, 0.22, width)
        bar = band(abs(b), -1.0, 0.05, width) * band(abs(a), -1.0, 0.16, width)
        return mix((0.75, 0.75, 0.75), c, max(rim, bar))
    return lit(c, 1.0 + 0.05 * fractal(a, b, width, seed, 0.5, 5, 0.7))


@njit(nogil=True, cache=True, error_model="numpy")
def sky(d, seed):  # type: ignore[no-untyped-def]
    """Linear colour of direction `d` (world, z up): gradient, clouds, and hills on the horizon."""
    flat = math.sqrt(d[0] * d[0] + d[1] * d[1]) + 1e-9
    slope = d[2] / flat
    azimuth = math.atan2(d[1], d[0])
    hill = 0.018 + 0.014 * fractal(azimuth * 6.0, 0.5, 0.0, seed + 900, 1.0, 5, 0.5)
    ground = min(1.0, max(0.0, (hill - slope) / HILL_EDGE + 0.5))
    tone = 0.30 + 0.03 * fractal(azimuth * 60.0, slope * 200.0, 0.0, seed + 3, 1.0, 4, 0.7)
    far = (tone * 0.95, tone * 1.05, tone * 1.1)
    if ground >= 1.0:
        return far
    up = min(1.0, max(0.0, slope) / 0.7)
    blue = (0.72 - 0.45 * up, 0.84 - 0.36 * up, 0.95 - 0.13 * up)
    reach = 1.0 / (max(0.0, slope) + 0.12)
    cloud = fractal(d[0] / flat * reach, d[1] / flat * reach, 0.0, seed + 500, 1.6, 6, 0.55)
    share = min(1.0, max(0.0, 1.4 * cloud + 0.25)) * min(1.0, max(0.0, slope) / 0.08)
    return mix(mix(blue, (0.98, 0.97, 0.96), 0.8 * share), far, ground)
