"""Normal equations of a camera's motion and its disparity offset; import late: it loads numba."""

from __future__ import annotations

import numpy as np
from numba import njit

from pseudolidar.structures.arrays import AnyArray

# Columns: a twist on the left of the motion, `1 + x^2` of the offset, and `x^2` of the bend.
UNKNOWNS = 8

_kernel = njit(nogil=True, cache=True, boundscheck=False, error_model="numpy")


@_kernel
def normal_equations(
    T: AnyArray,
    tracks: AnyArray,
    offset_px: AnyArray,
    camera: AnyArray,
    robust: AnyArray,
    H: AnyArray,
    b: AnyArray,
    weights: AnyArray,
) -> None:
    """The same as `pnp.linearised`, its weights and its products, in one pass over the tracks.

    Args:
        T: (4, 4) float64 `T_to_from`.
        tracks: (6, N) float64 px: u, v, d of the first pair, u, v, d of the second.
        offset_px: (2, N) float64 that measured disparities are too large by.
        camera: (8,) float64: fx, fy, cx, cy, f B px m, doffs px, least disparity (plus doffs) px,
            nearest depth m.
        robust: (3,) float64: sigma of a track px, of the kernel in sigmas, power of its weight.
        H: (8, 8) float64 out.
        b: (8,) float64 out.
        weights: (N,) float64 out, 0-1.
    """
    fx, fy, cx, cy, fB, doffs, least, nearest = camera
    sigma2, kernel2, power = robust[0] ** 2, robust[1] ** 2, robust[2]
    columns = np.zeros((3, UNKNOWNS))
    whitened = np.empty((3, UNKNOWNS))
    H[:], b[:] = 0.0, 0.0
    for i in range(tracks.shape[1]):
        u, v, u_to, v_to = tracks[0, i], tracks[1, i], tracks[3, i], tracks[4, i]
        above = max(tracks[2, i] - offset_px[0, i] + doffs, least)
        z = fB / above
        x, y = (u - cx) / fx * z, (v - cy) / fy * z
        px = T[0, 0] * x + T[0, 1] * y + T[0, 2] * z
        py = T[1, 0] * x + T[1, 1] * y + T[1, 2] * z
        pz = T[2, 0] * x + T[2, 1] * y + T[2, 2] * z
        qx, qy, qz = px + T[0, 3], py + T[1, 3], pz + T[2, 3]
        depth = max(qz, nearest)
        ax, ay = fx / depth, fy / depth
        bx, by, bd = -fx * qx / depth**2, -fy * qy / depth**2, -fB / depth**2
        e0 = u_to - (fx * qx / depth + cx)
        e1 = v_to - (fy * qy / depth + cy)
        e2 = tracks[5, i] - offset_px[1, i] - (fB / depth - doffs)
        # By the first disparity: points move towards the camera by their own length over it.
        g0 = -(ax * px + bx * pz) / above
        g1 = -(ay * py + by * pz) / above
        g2 = -bd * pz / above
        columns[0, 0], columns[0, 2] = ax, bx
        columns[1, 1], columns[1, 2] = ay, by
        columns[2, 2] = bd
        columns[0, 3], columns[0, 4], columns[0, 5] = bx * qy, ax * qz - bx * qx, -ax * qy
        columns[1, 3], columns[1, 4], columns[1, 5] = by * qy - ay * qz, -by * qx, ay * qx
        columns[2, 3], columns[2, 4], columns[2, 5] = bd * qy, -bd * qx, 0.0
        from2, to2 = ((u - cx) / fx) ** 2, ((u_to - cx) / fx) ** 2
        columns[0, 6], columns[0, 7] = -g0 * (1.0 + from2), -g0 * from2
        columns[1, 6], columns[1, 7] = -g1 * (1.0 + from2), -g1 * from2
        columns[2, 6], columns[2, 7] = -g2 * (1.0 + from2) + 1.0 + to2, -g2 * from2 + to2
        shared = 1.0 / (1.0 + g0 * g0 + g1 * g1 + g2 * g2)
        along = (g0 * e0 + g1 * e1 + g2 * e2) * shared
        chi2 = (e0 * (e0 - g0 * along) + e1 * (e1 - g1 * along) + e2 * (e2 - g2 * along)) / sigma2
        weight = (1.0 / (1.0 + chi2 / kernel2)) ** power
        weights[i] = weight
        scale = weight / sigma2
        for k in range(UNKNOWNS):
            c0, c1, c2 = columns[0, k], columns[1, k], columns[2, k]
            along = (g0 * c0 + g1 * c1 + g2 * c2) * shared
            w0, w1, w2 = c0 - g0 * along, c1 - g1 * along, c2 - g2 * along
            whitened[0, k], whitened[1, k], whitened[2, k] = w0 * scale, w1 * scale, w2 * scale
            b[k] += whitened[0, k] * e0 + whitened[1, k] * e1 + whitened[2, k] * e2
        for k in range(UNKNOWNS):
            for m in range(k, UNKNOWNS):
                H[k, m] += (
                    columns[0, k] * whitened[0, m]
                    + columns[1, k] * whitened[1, m]
                    + columns[2, k] * whitened[2, m]
                )
    for k in range(UNKNOWNS):
        for m in range(k):
            H[k, m] = H[m, k]
