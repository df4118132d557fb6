"""Noise and pattern primitives in metres, filtered to the footprint of a pixel (numba).

numba's cache notices edits of the file that a compiled function stands in, not of those it calls
into: after an edit here, touch `surfaces.py` and `shading.py`.
"""

from __future__ import annotations

import math

from numba import njit

# Odd 64-bit multipliers of the lattice hash (from SplitMix64 and Murmur), they only have to mix.
LATTICE_I, LATTICE_J, LATTICE_SEED = 0x1E3779B97F4A7C15, 0x3F58476D1CE4E5B9, 0x14D049BB133111EB


@njit(nogil=True, cache=True, error_model="numpy")
def _scramble(h):  # type: ignore[no-untyped-def]
    """Uniform number 0-1 of a 64-bit number."""
    h = (h ^ (h >> 29)) * 0x369DEA0F31A53F85
    return ((h ^ (h >> 32)) & 0xFFFFFF) / 16777216.0


@njit(nogil=True, cache=True, error_model="numpy")
def uniform(i, j, seed):  # type: ignore[no-untyped-def]
    """Uniform number 0-1 of a lattice point."""
    return _scramble(i * LATTICE_I + j * LATTICE_J + seed * LATTICE_SEED)


@njit(nogil=True, cache=True, error_model="numpy")
def _noise(x, y, seed):  # type: ignore[no-untyped-def]
    """Smooth value noise, -1 to 1, wavelength about 2."""
    i, j = math.floor(x), math.floor(y)
    a, b = x - i, y - j
    a, b = a * a * (3.0 - 2.0 * a), b * b * (3.0 - 2.0 * b)
    h = int(i) * LATTICE_I + int(j) * LATTICE_J + seed * LATTICE_SEED
    low, high = _scramble(h), _scramble(h + LATTICE_J)
    low += (_scramble(h + LATTICE_I) - low) * a
    high += (_scramble(h + LATTICE_I + LATTICE_J) - high) * a
    return 2.0 * (low + (high - low) * b) - 1.0


@njit(nogil=True, cache=True, error_model="numpy")
def fractal(x, y, width, seed, cell_m, octaves, gain):  # type: ignore[no-untyped-def]
    """Octaves of noise from cells of `cell_m` downwards, each faded by the footprint `width`."""
    total, amplitude, scale = 0.0, 1.0, 1.0 / cell_m
    for k in range(octaves):
        # What averaging over the footprint leaves of an octave; nothing once it is a cell wide.
        left = 1.0 - width * width * scale * scale
        if left <= 0.0:
            break
        total += amplitude * left * left * _noise(x * scale, y * scale, seed + k)
        amplitude *= gain
        scale *= 2.0
    return total


@njit(nogil=True, cache=True, error_model="numpy")
def band(x, low, high, width):  # type: ignore[no-untyped-def]
    """Share of the footprint around `x` that lies in [low, high]."""
    half = 0.5 * width + 1e-6
    left = min(1.0, max(0.0, (x - low) / (2.0 * half) + 0.5))
    right = min(1.0, max(0.0, (high - x) / (2.0 * half) + 0.5))
    return max(0.0, left + right - 1.0)


@njit(nogil=True, cache=True, error_model="numpy")
def fraction(x, period):  # type: ignore[no-untyped-def]
    """`x` modulo `period`, 0 to `period`."""
    return x - period * math.floor(x / period)


@njit(nogil=True, cache=True, error_model="numpy")
def joints(a, b, cell_a, cell_b, joint, width, seed):  # type: ignore[no-untyped-def]
    """Share of joint in a bond of stones, and the tint -1 to 1 of the stone."""
    row = math.floor(b / cell_b)
    shifted = a + 0.5 * cell_a * (int(row) & 1)
    column = math.floor(shifted / cell_a)
    x, y = shifted - column * cell_a, b - row * cell_b
    stone = band(x, joint, cell_a, width) * band(y, joint, cell_b, width)
    tint = (2.0 * uniform(int(column), int(row), seed) - 1.0) * math.exp(
        -0.5 * (width / cell_b) ** 2
    )
    return 1.0 - stone, tint


@njit(nogil=True, cache=True, error_model="numpy")
def mix(c, d, share):  # type: ignore[no-untyped-def]
    """Colour `c` with `share` of it replaced by colour `d`."""
    return (
        c[0] + (d[0] - c[0]) * share,
        c[1] + (d[1] - c[1]) * share,
        c[2] + (d[2] - c[2]) * share,
    )


@njit(nogil=True, cache=True, error_model="numpy")
def lit(c, level):  # type: ignore[no-untyped-def]
    """Colour `c` times a brightness that never gets black."""
    level = max(0.05, level)
    return (c[0] * level, c[1] * level, c[2] * level)
