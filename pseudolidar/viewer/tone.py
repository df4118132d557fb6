"""Which light makes a page show a colour.

viser draws the colours of points as they are, and all surfaces through the tone curve of films that
its three.js applies (ACES); without regard to it a photo on a mesh comes out dark.

Source: three.js r186, `tonemapping_pars_fragment.glsl.js`, ACESFilmicToneMapping, exposure 1; the
fit is Stephen Hill's.
"""

from __future__ import annotations

import numpy as np

from pseudolidar.formats.meshes.glb import linear_light
from pseudolidar.structures.arrays import Float32, UInt8

INPUT = np.array(
    [[0.59719, 0.35458, 0.04823], [0.07600, 0.90834, 0.01566], [0.02840, 0.13383, 0.83777]]
)
OUTPUT = np.array(
    [[1.60475, -0.53108, -0.07367], [-0.10208, 1.10813, -0.00605], [-0.00327, -0.07276, 1.07602]]
)
# y = (x (x + A) - B) / (x (C x + D) + E)
A, B, C, D, E = 0.0245786, 0.000090537, 0.983729, 0.4329510, 0.238081
EXPOSURE = 1 / 0.6


def light_shown_as(rgb: UInt8) -> Float32:
    """(V, 3) linear light that is seen as these colours (V, 3), sRGB; it may be below 0."""
    y = linear_light(rgb) @ np.linalg.inv(OUTPUT).T
    # The curve as a quadratic in x: (1 - C y) x^2 + (A - D y) x - (B + E y) = 0.
    a, b, c = 1 - C * y, A - D * y, -(B + E * y)
    x = (-b + np.sqrt(b * b - 4 * a * c)) / (2 * a)
    return np.asarray(x @ np.linalg.inv(INPUT).T / EXPOSURE, np.float32)
