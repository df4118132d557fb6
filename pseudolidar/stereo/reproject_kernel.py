"""The one pass over a disparity map that makes points with all their columns.

Import it late: it loads numba. Compiled for C-contiguous arrays, read-only ones included.
"""

from __future__ import annotations

import math

from numba import boolean, float32, float64, int64, njit, types, uint8

from pseudolidar.structures.correction import DisparityCorrection

# ITU-R BT.601 luma, the weights of OpenCV's RGB2GRAY, of a white of 255. Factors instead of
# quotients: a division takes as long as ten multiplications.
PER_LEVEL = 1.0 / 255.0
RED, GREEN, BLUE = 0.299 * PER_LEVEL, 0.587 * PER_LEVEL, 0.114 * PER_LEVEL
DISPARITY_UNIT_PX = DisparityCorrection.DISPARITY_UNIT_PX
# Order of the scalars in `pair` and `gates`.
DOFFS, STRETCH, TZ, SYSTEMATIC = range(4)
MIN_RANGE, MAX_RANGE, MIN_HEIGHT, MAX_HEIGHT, MAX_SIGMA, MAX_SIGMA_REL = range(6)


def _in(kind: types.Type, ndim: int) -> types.Array:
    return types.Array(kind, ndim, "C", readonly=True)


_VECTOR, _MATRIX = _in(float64, 1), _in(float64, 2)
_POINT = types.UniTuple(float64, 3)
_MAPS = (_in(float32, 2), _in(float32, 2), _in(uint8, 3))
_CAMERAS = (boolean, _MATRIX, _MATRIX, _MATRIX, _VECTOR, _MATRIX, _VECTOR)
_COLUMNS = (float32[:, ::1], uint8[:, ::1], float32[::1], float32[::1], float32[:, ::1])


@njit(int64(_MAPS[0]), nogil=True, cache=True, error_model="numpy")
def count_valid(values):  # type: ignore[no-untyped-def]
    """Number of pixels that have a disparity."""
    count = 0
    for v in range(values.shape[0]):
        for u in range(values.shape[1]):
            if not math.isnan(values[v, u]):
                count += 1
    return count


@njit(
    _POINT(_MATRIX, float64, float64, float64, _VECTOR), nogil=True, cache=True, error_model="numpy"
)
def _point_by_q(Q, u, v, d, pair):  # type: ignore[no-untyped-def]
    doffs = pair[DOFFS]
    ideal = (d + doffs) / (1.0 + (u - d) * pair[STRETCH]) - doffs
    scale = 1.0 / (Q[3, 0] * u + Q[3, 1] * v + Q[3, 2] * ideal + Q[3, 3])
    x = (Q[0, 0] * u + Q[0, 1] * v + Q[0, 2] * ideal + Q[0, 3]) * scale
    y = (Q[1, 0] * u + Q[1, 1] * v + Q[1, 2] * ideal + Q[1, 3]) * scale
    z = (Q[2, 0] * u + Q[2, 1] * v + Q[2, 2] * ideal + Q[2, 3]) * scale
    return x, y, z


@njit(
    _POINT(_MATRIX, _MATRIX, float64, float64, float64), nogil=True, cache=True, error_model="numpy"
)
def _point_by_p(L, R, u, v, d):  # type: ignore[no-untyped-def]
    w = u - d
    a0, a1, a2 = L[0, 0] - u * L[2, 0], L[0, 1] - u * L[2, 1], L[0, 2] - u * L[2, 2]
    b0, b1, b2 = L[1, 0] - v * L[2, 0], L[1, 1] - v * L[2, 1], L[1, 2] - v * L[2, 2]
    c0, c1, c2 = R[0, 0] - w * R[2, 0], R[0, 1] - w * R[2, 1], R[0, 2] - w * R[2, 2]
    a, b, c = u * L[2, 3] - L[0, 3], v * L[2, 3] - L[1, 3], w * R[2, 3] - R[0, 3]
    bc0, bc1, bc2 = b1 * c2 - b2 * c1, b2 * c0 - b0 * c2, b0 * c1 - b1 * c0
    scale = 1.0 / (a0 * bc0 + a1 * bc1 + a2 * bc2)
    x = (a * bc0 + b * (c1 * a2 - c2 * a1) + c * (a1 * b2 - a2 * b1)) * scale
    y = (a * bc1 + b * (c2 * a0 - c0 * a2) + c * (a2 * b0 - a0 * b2)) * scale
    z = (a * bc2 + b * (c0 * a1 - c1 * a0) + c * (a0 * b1 - a1 * b0)) * scale
    return x, y, z


@njit(float64(_MATRIX, float64), nogil=True, cache=True, error_model="numpy")
def _factor(scale, d):  # type: ignore[no-untyped-def]
    """As `SigmaScale.at`."""
    if d <= scale[0, 0]:
        return scale[1, 0]
    for k in range(1, scale.shape[1]):
        if d < scale[0, k]:
            share = (d - scale[0, k - 1]) / (scale[0, k] - scale[0, k - 1])
            return scale[1, k - 1] + share * (scale[1, k] - scale[1, k - 1])
    return scale[1, -1]


@njit(
    int64(*_MAPS, *_CAMERAS, _VECTOR, boolean, *_COLUMNS),
    nogil=True,
    cache=True,
    error_model="numpy",
)
def reproject_pixels(  # type: ignore[no-untyped-def]
    values,
    sigma,
    image,
    by_p,
    Q,
    L,
    R,
    correction,
    scale,
    pair,
    gates,
    organised,
    xyz,
    rgb,
    grey,
    ray,
    uv,
):
    """Fill the columns of the points of all pixels; returns the number of points.

    Args:
        values: (H, W) px, NaN = none.
        sigma: (H, W) px, or (0, 0) when there is none.
        image: (H, W, 1) grey or (H, W, 3) RGB.
        by_p: solve the projection equations instead of applying Q.
        Q: (4, 4).
        L: (3, 4) projection of the left camera.
        R: (3, 4) projection of the right camera.
        correction: (10,) coefficients of `DisparityCorrection`, zeros for none.
        scale: (2, K) disparities px, ascending, and factors on the map's sigma at these.
        pair: (4,) doffs px, tz / fB 1/px, tz m, systematic sigma px.
        gates: (6,) range m, height m, sigma m, sigma relative to range.
        organised: write every pixel at its place, NaN where there is no point.
        xyz: (N, 3) out, m.
        rgb: (N, 3) out, or (0, 3) for grey images.
        grey: (N,) out, 0-1.
        ray: (N,) out, sigma along the ray, m; (0,) when there is none.
        uv: (N, 2) out, px.
    """
    height, width = values.shape
    coloured, no_sigma = image.shape[2] == 3, sigma.size == 0
    x_scale, y_scale = 2.0 / (width - 1), 2.0 / (height - 1)
    systematic = pair[SYSTEMATIC] * pair[SYSTEMATIC]
    per_px = correction[1] / DISPARITY_UNIT_PX
    nan = float32(math.nan)
    n = 0
    for v in range(height):
        y = v * y_scale - 1.0
        # offset(x, d) = row0 + x (row1 + x (row2 + x (c7 + x c9))) + c1 d / 50
        row0 = correction[0] + y * (correction[3] + y * correction[6])
        row1 = correction[2] + y * correction[5]
        row2 = correction[4] + y * correction[8]
        for u in range(width):
            d = float64(values[v, u])
            x = u * x_scale - 1.0
            bent = row2 + x * (correction[7] + x * correction[9])
            d -= row0 + x * (row1 + x * bent) + per_px * d
            kept = d + pair[DOFFS] > 0.0
            error_m = 0.0
            if kept:
                if by_p:
                    X, Y, Z = _point_by_p(L, R, float64(u), float64(v), d)
                else:
                    X, Y, Z = _point_by_q(Q, float64(u), float64(v), d, pair)
                reach = math.sqrt(X * X + Y * Y + Z * Z)
                kept = gates[MIN_RANGE] <= reach <= gates[MAX_RANGE]
                kept &= gates[MIN_HEIGHT] <= -Y <= gates[MAX_HEIGHT]
                if not no_sigma:
                    s = _factor(scale, float64(values[v, u])) * float64(sigma[v, u])
                    ray_per_px = (Z + pair[TZ]) * reach / ((d + pair[DOFFS]) * Z)
                    error_m = math.sqrt(s * s + systematic) * ray_per_px
                    kept &= error_m <= gates[MAX_SIGMA]
                    kept &= error_m <= gates[MAX_SIGMA_REL] * reach
            if not (kept or organised):
                continue
            if kept:
                xyz[n, 0], xyz[n, 1], xyz[n, 2] = X, Y, Z
            else:
                xyz[n, 0], xyz[n, 1], xyz[n, 2] = nan, nan, nan
                error_m = math.nan
            if not no_sigma:
                ray[n] = error_m
            if coloured:
                red, green, blue = image[v, u, 0], image[v, u, 1], image[v, u, 2]
                rgb[n, 0], rgb[n, 1], rgb[n, 2] = red, green, blue
                grey[n] = RED * red + GREEN * green + BLUE * blue
            else:
                grey[n] = image[v, u, 0] * PER_LEVEL
            uv[n, 0], uv[n, 1] = u, v
            n += 1
    return n
