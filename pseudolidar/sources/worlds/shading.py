"""What a ray sees where it meets a triangle: exact depth, filtered colour, light and shadow."""

from __future__ import annotations

import math

import numpy as np
from numba import njit

from pseudolidar.sources.worlds.materials import Material
from pseudolidar.sources.worlds.noise import fractal
from pseudolidar.sources.worlds.surfaces import albedo, sky

LEAF = int(Material.LEAF)
# Columns of a triangle's row: first corner, its two edges, the same of its texture coordinates
# (metres in the object's own frame), colour (linear).
CORNER, EDGE_1, EDGE_2, TEX, TEX_1, TEX_2, COLOUR, ROW_LENGTH = 0, 3, 6, 9, 12, 15, 18, 21
# Samples along the longer side of a pixel's footprint.
MOST_SAMPLES = 3
# Ambient light on a surface that looks sideways, and how much more from above, share.
AMBIENT_SIDE, AMBIENT_UP = 0.75, 0.25
# Distance at which a lamp's light has halved, metres.
LAMP_REACH_M = 6.0
# A shadow ray starts this far off its surface, or it would meet it, metres.
SHADOW_OFFSET_M = 0.01
# How strongly leaves turn the normal of a crown, and the size of a cluster of them, metres.
LEAF_TURN, LEAF_CELL_M = 0.8, 0.16


@njit(nogil=True, cache=True, error_model="numpy")
def pixel_directions(M, u, v):  # type: ignore[no-untyped-def]
    """(N, 3) ray directions `M (u, v, 1)`; their length makes the ray parameter the depth Z."""
    out = np.empty((len(u), 3))
    for i in range(len(u)):
        for k in range(3):
            out[i, k] = M[k, 0] * u[i] + M[k, 1] * v[i] + M[k, 2]
    return out


@njit(nogil=True, cache=True, error_model="numpy")
def single_rays(origin, directions):  # type: ignore[no-untyped-def]
    """(N, 6) float32 rays from one origin (3,)."""
    rays = np.empty((len(directions), 6), np.float32)
    for i in range(len(directions)):
        for k in range(3):
            rays[i, k], rays[i, 3 + k] = origin[k], directions[i, k]
    return rays


@njit(nogil=True, cache=True, error_model="numpy")
def _leafy(normal, tex, width, seed):  # type: ignore[no-untyped-def]
    """The normal turned as the leaves of a crown turn it, so that its facets do not show."""
    x, y, z = tex[0] + 0.5 * tex[2], tex[1] - 0.5 * tex[2], tex[2] + 0.3 * tex[0]
    a = LEAF_TURN * fractal(x, y, width, seed + 11, LEAF_CELL_M, 3, 0.8)
    b = LEAF_TURN * fractal(y, z, width, seed + 12, LEAF_CELL_M, 3, 0.8)
    c = LEAF_TURN * fractal(z, x, width, seed + 13, LEAF_CELL_M, 3, 0.8)
    x, y, z = 0.5 * normal[0] + a, 0.5 * normal[1] + b, 0.5 * normal[2] + 0.25 + c
    length = math.sqrt(x * x + y * y + z * z) + 1e-9
    return x / length, y / length, z / length


@njit(nogil=True, cache=True, error_model="numpy")
def light_of(colour, normals, rays, depth, lit, points, light):  # type: ignore[no-untyped-def]
    """Turn albedo into light in place: lamp or sun where `lit`, ambient light, haze.

    Args:
        colour: (N, 3) float32 albedo, becomes light; skies (depth NaN) stay.
        normals: (N, 3) float32.
        rays: (N, 3) directions.
        depth: (N,) in lengths of the rays.
        lit: (N,) the light reaches the point.
        points: (N, 3) m, scene coordinates.
        light: (14,) towards (3), is a lamp, sun (3), ambient (3), haze_m, haze (3).
    """
    for i in range(len(depth)):
        z = depth[i]
        if math.isnan(z):
            continue
        tx, ty, tz = light[0], light[1], light[2]
        direct = 0.0
        if lit[i]:
            fall = 1.0
            if light[3] > 0.0:
                tx, ty, tz = tx - points[i, 0], ty - points[i, 1], tz - points[i, 2]
                square = tx * tx + ty * ty + tz * tz
                fall = 1.0 / ((1.0 + square / (LAMP_REACH_M * LAMP_REACH_M)) * math.sqrt(square))
            cosine = tx * normals[i, 0] + ty * normals[i, 1] + tz * normals[i, 2]
            direct = max(0.0, cosine) * fall
        around = AMBIENT_SIDE + AMBIENT_UP * normals[i, 2]
        share = 0.0
        if light[10] > 0.0:
            d = rays[i]
            far = z * math.sqrt(d[0] * d[0] + d[1] * d[1] + d[2] * d[2])
            share = 1.0 - math.exp(-far / light[10])
        for k in range(3):
            level = colour[i, k] * (direct * light[4 + k] + around * light[7 + k])
            colour[i, k] = level + share * (light[11 + k] - level)


@njit(nogil=True, cache=True, error_model="numpy")
def shadow_rays(points, facing, depth, light):  # type: ignore[no-untyped-def]
    """Rays from the points that face the light towards it.

    Args:
        points: (N, 3) m, scene coordinates.
        facing: (N, 3) normals of the triangles.
        depth: (N,), NaN for none.
        light: as in `light_of`.

    Returns:
        (K, 6) float32 rays, and (K,) the points that they belong to.
    """
    rays, which = np.empty((len(depth), 6), np.float32), np.empty(len(depth), np.int64)
    n = 0
    for i in range(len(depth)):
        if math.isnan(depth[i]):
            continue
        tx, ty, tz = light[0], light[1], light[2]
        if light[3] > 0.0:
            tx, ty, tz = tx - points[i, 0], ty - points[i, 1], tz - points[i, 2]
        if tx * facing[i, 0] + ty * facing[i, 1] + tz * facing[i, 2] <= 0.0:
            continue
        for k in range(3):
            rays[n, k] = points[i, k] + SHADOW_OFFSET_M * facing[i, k]
        rays[n, 3], rays[n, 4], rays[n, 5] = tx, ty, tz
        which[n] = i
        n += 1
    return rays[:n], which[:n]


@njit(nogil=True, cache=True, error_model="numpy")
def shade(  # type: ignore[no-untyped-def]
    origin, directions, step_u, step_v, prims, fixed, fixed_kind, moving, moving_kind, sky_seed
):
    """Depth, colour and normal where each ray meets its triangle.

    Args:
        origin: (3,) m.
        directions: (N, 3), not normalised; depth is in units of their length.
        step_u: (3,) change of the direction across a pixel's width.
        step_v: (3,) down its height.
        prims: (N,) triangle of each ray: row of `fixed`, or of `moving` after those; -1 for none.
        fixed: (F, ROW_LENGTH) float32 what stands still.
        fixed_kind: (F, 3) int64 material, seed, object.
        moving: the same of what moves.
        moving_kind: the same.
        sky_seed: which sky.

    Returns:
        depth (N,) float64, NaN for the sky; points (N, 3) float64 m; colour (N, 3) float32 linear
        albedo, or the sky's light; normals (N, 3) float32 that light sees, and of the triangle,
        both towards the eye.
    """
    n = len(prims)
    depth, colour = np.full(n, np.nan), np.empty((n, 3), np.float32)
    normals, facing = np.zeros((n, 3), np.float32), np.zeros((n, 3), np.float32)
    points = np.zeros((n, 3))
    border = len(fixed)
    tex, along, down = np.empty(3), np.empty(3), np.empty(3)
    for i in range(n):
        d = directions[i]
        prim = prims[i]
        if prim < 0:
            colour[i, 0], colour[i, 1], colour[i, 2] = sky(d, sky_seed)
            continue
        row = fixed[prim] if prim < border else moving[prim - border]
        kind = fixed_kind[prim] if prim < border else moving_kind[prim - border]
        e1 = (float(row[3]), float(row[4]), float(row[5]))
        e2 = (float(row[6]), float(row[7]), float(row[8]))
        nx = e1[1] * e2[2] - e1[2] * e2[1]
        ny = e1[2] * e2[0] - e1[0] * e2[2]
        nz = e1[0] * e2[1] - e1[1] * e2[0]
        nn = nx * nx + ny * ny + nz * nz
        sx, sy, sz = row[0] - origin[0], row[1] - origin[1], row[2] - origin[2]
        height = nx * sx + ny * sy + nz * sz
        cosine = nx * d[0] + ny * d[1] + nz * d[2]
        z = height / cosine
        depth[i] = z
        sign = (-1.0 if cosine > 0.0 else 1.0) / math.sqrt(nn)
        normal = (nx * sign, ny * sign, nz * sign)
        t1 = (float(row[12]), float(row[13]), float(row[14]))
        t2 = (float(row[15]), float(row[16]), float(row[17]))
        for axis in range(3):
            # Where the middle of the pixel, its right and its lower neighbour meet the plane.
            if axis == 0:
                px, py, pz = z * d[0] - sx, z * d[1] - sy, z * d[2] - sz
            else:
                step = step_u if axis == 1 else step_v
                change = nx * step[0] + ny * step[1] + nz * step[2]
                # Derivative of d height / (n . d) along the step: exact slope, no second ray.
                dz = -z * change / cosine
                px = z * step[0] + dz * d[0]
                py = z * step[1] + dz * d[1]
                pz = z * step[2] + dz * d[2]
            u = (
                (py * e2[2] - pz * e2[1]) * nx
                + (pz * e2[0] - px * e2[2]) * ny
                + (px * e2[1] - py * e2[0]) * nz
            ) / nn
            v = (
                (e1[1] * pz - e1[2] * py) * nx
                + (e1[2] * px - e1[0] * pz) * ny
                + (e1[0] * py - e1[1] * px) * nz
            ) / nn
            for k in range(3):
                offset = u * t1[k] + v * t2[k]
                if axis == 0:
                    tex[k] = row[9 + k] + offset
                elif axis == 1:
                    along[k] = offset
                else:
                    down[k] = offset
        longest = math.sqrt(along[0] ** 2 + along[1] ** 2 + along[2] ** 2)
        shortest = math.sqrt(down[0] ** 2 + down[1] ** 2 + down[2] ** 2)
        major = along
        if shortest > longest:
            longest, shortest, major = shortest, longest, down
        samples = min(MOST_SAMPLES, max(1, math.ceil(longest / (shortest + 1e-9) - 0.3)))
        width = max(shortest, longest / samples)
        tx = abs(t1[1] * t2[2] - t1[2] * t2[1])
        ty = abs(t1[2] * t2[0] - t1[0] * t2[2])
        tz = abs(t1[0] * t2[1] - t1[1] * t2[0])
        side = 0 if tx >= ty and tx >= tz else (1 if ty >= tz else 2)
        base = (float(row[18]), float(row[19]), float(row[20]))
        turned = _leafy(normal, tex, width, kind[1]) if kind[0] == LEAF else normal
        for k in range(3):
            points[i, k] = origin[k] + z * d[k]
            normals[i, k], facing[i, k] = turned[k], normal[k]
        r, g, b = 0.0, 0.0, 0.0
        for k in range(samples):
            at = (k + 0.5) / samples - 0.5
            c = albedo(
                kind[0],
                tex[0] + at * major[0],
                tex[1] + at * major[1],
                tex[2] + at * major[2],
                side,
                width,
                kind[1],
                base,
            )
            r, g, b = r + c[0], g + c[1], b + c[2]
        colour[i, 0], colour[i, 1], colour[i, 2] = r / samples, g / samples, b / samples
    return depth, points, colour, normals, facing
