"""What earlier frames say about the disparities of a frame: looked up, and carried over."""

from __future__ import annotations

import numpy as np
from numba import njit

from pseudolidar.structures.arrays import AnyArray

# Neighbours of a look between pixels belong to one surface within this step: px, or as a share of
# the disparity. Beyond it the nearest pixel counts alone.
SAME_SURFACE_PX, SAME_SURFACE_SHARE = 1.0, 0.05

_kernel = njit(nogil=True, cache=True, boundscheck=False, error_model="numpy")


@_kernel
def _look(values: AnyArray, sigma: AnyArray, u: float, v: float) -> tuple[float, float]:
    """Disparity and sigma between the pixels of a map; NaN where there is none."""
    x, y = int(np.floor(u)), int(np.floor(v))
    near_x, near_y = int(np.rint(u)), int(np.rint(v))
    nearest = values[near_y, near_x]
    if np.isnan(nearest):
        return np.nan, np.nan
    step = max(SAME_SURFACE_PX, SAME_SURFACE_SHARE * nearest)
    total = weights = 0.0
    for j in range(2):
        for i in range(2):
            if y + j >= values.shape[0] or x + i >= values.shape[1]:
                continue
            d = values[y + j, x + i]
            if not abs(d - nearest) <= step:
                continue
            w = (1 - abs(u - x - i)) * (1 - abs(v - y - j))
            total += w * d
            weights += w
    if not weights > 0.5:  # a slope would be tilted by what is missing
        return nearest, sigma[near_y, near_x]
    return total / weights, sigma[near_y, near_x]


@_kernel
def gather(
    values: AnyArray,
    sigma: AnyArray,
    earlier: AnyArray,
    earlier_sigma: AnyArray,
    T_earlier_now: AnyArray,
    now_camera: AnyArray,
    earlier_camera: AnyArray,
    gate: float,
    drift_px2: float,
    drift_m: float,
    sums: AnyArray,
    weights: AnyArray,
    agreeing: AnyArray,
    contradicting: AnyArray,
) -> None:
    """Add what an earlier frame measured of each surface that is measured now.

    The point of a pixel is looked up in the earlier frame, and what that measured there is carried
    back. It counts where both agree: what moved, or is seen only now, does not.

    Args:
        values: (H, W) float32 px now, systematic error taken off.
        sigma: (H, W) float32 px.
        earlier: like `values`, of the earlier frame.
        earlier_sigma: its sigma.
        T_earlier_now: (4, 4) float64, m.
        now_camera: (fx, fy, cx, cy, f B, doffs) of the rig now.
        earlier_camera: of the earlier one.
        gate: largest disagreement, in standard deviations of it.
        drift_px2: variance that sub-pixel shifts add.
        drift_m: standard deviation of the distance that poses say was moved.
        sums: (H, W) float64, weighted deviations from `values` are added.
        weights: (H, W) float64, weights are added.
        agreeing: (H, W) uint8, frames that agree are added.
        contradicting: (H, W) uint8, frames that measured something else there are added.
    """
    height, width = values.shape
    fx, fy, cx, cy, fB, doffs = now_camera
    gx, gy, hx, hy, gB, goffs = earlier_camera
    T = T_earlier_now
    for y in range(height):
        for x in range(width):
            d = values[y, x]
            if not d + doffs > 0:
                continue
            z = fB / (d + doffs)
            px, py = z * (x - cx) / fx, z * (y - cy) / fy
            qz = T[2, 0] * px + T[2, 1] * py + T[2, 2] * z + T[2, 3]
            if not qz > 0:
                continue
            u = gx * (T[0, 0] * px + T[0, 1] * py + T[0, 2] * z + T[0, 3]) / qz + hx
            v = gy * (T[1, 0] * px + T[1, 1] * py + T[1, 2] * z + T[1, 3]) / qz + hy
            if not (0 <= u <= earlier.shape[1] - 1 and 0 <= v <= earlier.shape[0] - 1):
                continue
            e, s = _look(earlier, earlier_sigma, u, v)
            if not e + goffs > 0:
                continue
            ez = gB / (e + goffs)
            # Back into the frame now: only the depth is asked for.
            ex, ey = ez * (u - hx) / gx - T[0, 3], ez * (v - hy) / gy - T[1, 3]
            nz = T[0, 2] * ex + T[1, 2] * ey + T[2, 2] * (ez - T[2, 3])
            if not nz > 0:
                continue
            carried = fB / nz - doffs
            stretch = (carried + doffs) / (e + goffs) * (gB / fB)
            by_pose = (carried + doffs) * drift_m / nz
            variance = (s * stretch) ** 2 + drift_px2 + by_pose * by_pose
            apart = carried - d
            near = abs(apart) <= max(SAME_SURFACE_PX, SAME_SURFACE_SHARE * d)
            if near and apart * apart <= gate * gate * (variance + sigma[y, x] ** 2):
                sums[y, x] += apart / variance
                weights[y, x] += 1 / variance
                agreeing[y, x] += 1
            else:
                contradicting[y, x] += 1


@_kernel
def scatter(
    earlier: AnyArray,
    earlier_sigma: AnyArray,
    T_now_earlier: AnyArray,
    now_camera: AnyArray,
    earlier_camera: AnyArray,
    out: AnyArray,
    out_sigma: AnyArray,
) -> None:
    """Carry an earlier frame's disparities into the frame now, the nearest surface in front.

    Args:
        earlier: (H, W) float32 px, systematic error taken off.
        earlier_sigma: its sigma.
        T_now_earlier: (4, 4) float64, m.
        now_camera: (fx, fy, cx, cy, f B, doffs) of the rig now.
        earlier_camera: of the earlier one.
        out: (H, W) float32 px, NaN where nothing lands.
        out_sigma: (H, W) float32 px.
    """
    height, width = out.shape
    fx, fy, cx, cy, fB, doffs = now_camera
    gx, gy, hx, hy, gB, goffs = earlier_camera
    T = T_now_earlier
    out[:] = np.nan
    out_sigma[:] = np.nan
    for y in range(earlier.shape[0]):
        for x in range(earlier.shape[1]):
            e = earlier[y, x]
            if not e + goffs > 0:
                continue
            z = gB / (e + goffs)
            px, py = z * (x - hx) / gx, z * (y - hy) / gy
            qz = T[2, 0] * px + T[2, 1] * py + T[2, 2] * z + T[2, 3]
            if not qz > 0:
                continue
            u = int(np.rint(fx * (T[0, 0] * px + T[0, 1] * py + T[0, 2] * z + T[0, 3]) / qz + cx))
            v = int(np.rint(fy * (T[1, 0] * px + T[1, 1] * py + T[1, 2] * z + T[1, 3]) / qz + cy))
            if not (0 <= u < width and 0 <= v < height):
                continue
            carried = fB / qz - doffs
            if carried > 0 and not out[v, u] >= carried:
                out[v, u] = carried
                out_sigma[v, u] = earlier_sigma[y, x] * (carried + doffs) / (e + goffs) * (gB / fB)


@_kernel
def agree(
    layers: AnyArray,
    sigmas: AnyArray,
    holes: AnyArray,
    drift_px2: float,
    gate: float,
    least: int,
    out: AnyArray,
    out_sigma: AnyArray,
) -> None:
    """Mean of the layers that agree with the newest one of each hole pixel.

    Args:
        layers: (K, H, W) float32 px, newest first, NaN where nothing is known.
        sigmas: like `layers`.
        holes: (H, W) bool, where it is asked for.
        drift_px2: variance that each step back in time adds.
        gate: largest disagreement, in standard deviations of it.
        least: layers that must agree.
        out: (H, W) float32 px, NaN where too few agree.
        out_sigma: (H, W) float32 px, of the newest layer alone.
    """
    count, height, width = layers.shape
    for y in range(height):
        for x in range(width):
            out[y, x] = out_sigma[y, x] = np.nan
            if not holes[y, x]:
                continue
            agreeing = 0
            lead = lead_variance = total = weights = 0.0
            for k in range(count):
                d = layers[k, y, x]
                if np.isnan(d):
                    continue
                variance = sigmas[k, y, x] ** 2 + drift_px2 * (k + 1)
                if agreeing == 0:
                    lead, lead_variance = d, variance
                apart = d - lead
                near = abs(apart) <= max(SAME_SURFACE_PX, SAME_SURFACE_SHARE * lead)
                if near and apart * apart <= gate * gate * (variance + lead_variance):
                    agreeing += 1
                    total += d / variance
                    weights += 1 / variance
            if agreeing >= least:
                out[y, x] = total / weights
                out_sigma[y, x] = np.sqrt(lead_variance)
