"""Truncated signed distances on blocks of voxels, one view at a time."""

from __future__ import annotations

import math

from numba import njit

from pseudolidar.structures.arrays import AnyArray

# Voxels along each side of a block.
BLOCK = 8
# Pixels that ask for blocks: every second one; a block is wider than two pixels wherever a depth
# is sure enough to count.
STRIDE_PX = 2
# Columns of a pixel's plane: normal x, y, z to the camera's side and `normal . point` in the
# camera's frame, depth, reach of its distances, weight (0: not used).
NX, NY, NZ, OFFSET, DEPTH, REACH, WEIGHT = range(7)
PLANE_COLUMNS = 7
# A voxel this many reaches behind the surface along the ray is not judged by it: the plane of a
# pixel is not believed farther off. A road seen at 1 in 12 needs as many.
BEHIND_REACHES = 12.0
# Bits of a block's coordinate in its key.
KEY_BITS, KEY_HALF = 21, 1 << 20
# Weight of "nothing is here" against that of a surface.
FREE_SHARE = 0.25

_kernel = njit(nogil=True, cache=True, boundscheck=False, error_model="numpy")


@_kernel
def block_keys(
    planes: AnyArray, focal: AnyArray, T_map_camera: AnyArray, block_m: float, keys: AnyArray
) -> int:
    """Keys of blocks that hold a surface or what lies within its reach, with repetitions.

    Args:
        planes: (H, W, PLANE_COLUMNS) float32.
        focal: (4,) fx, fy, cx, cy, px.
        T_map_camera: (4, 4).
        block_m: side of a block.
        keys: (N,) int64 out.

    Returns:
        How many were found; more than N where `keys` is too short, then the rest is not written.
    """
    height, width, _ = planes.shape
    fx, fy, cx, cy = focal[0], focal[1], focal[2], focal[3]
    count = 0
    for v in range(0, height, STRIDE_PX):
        last = -1
        for u in range(0, width, STRIDE_PX):
            plane = planes[v, u]
            if not plane[WEIGHT] > 0:
                continue
            z = plane[DEPTH]
            x, y = (u - cx) / fx * z, (v - cy) / fy * z
            steps = math.ceil(2 * plane[REACH] / (0.5 * block_m))
            for step in range(steps + 1):
                s = plane[REACH] * (2.0 * step / steps - 1.0)
                px, py, pz = x + s * plane[NX], y + s * plane[NY], z + s * plane[NZ]
                key = 0
                for row in range(3):
                    at = (
                        T_map_camera[row, 0] * px
                        + T_map_camera[row, 1] * py
                        + T_map_camera[row, 2] * pz
                        + T_map_camera[row, 3]
                    )
                    key = (key << KEY_BITS) | (math.floor(at / block_m) + KEY_HALF)
                if key == last:
                    continue
                last = key
                if count < len(keys):
                    keys[count] = key
                count += 1
    return count


@_kernel
def integrate(
    planes: AnyArray,
    rgb: AnyArray,
    focal: AnyArray,
    T_camera_map: AnyArray,
    blocks: AnyArray,
    places: AnyArray,
    voxel_m: float,
    distance: AnyArray,
    weight: AnyArray,
    colour: AnyArray,
) -> int:
    """Average a view into all blocks that it sees.

    The distance of a voxel is that to the plane of the pixel that it falls on: along the ray, a
    road seen at a grazing angle would lie many voxels away from those just beneath it.

    Args:
        planes: (H, W, PLANE_COLUMNS) float32.
        rgb: (H, W, 3) uint8.
        focal: (4,) fx, fy, cx, cy, px.
        T_camera_map: (4, 4).
        blocks: (B, 3) int32 block coordinates.
        places: (B,) rows of the blocks in the following arrays.
        voxel_m: side of a voxel.
        distance: (N, 8, 8, 8, 1) float32 m, in and out; axes z, y, x.
        weight: (N, 8, 8, 8, 1) float32, in and out.
        colour: (N, 8, 8, 8, 3) float32 0-255, in and out.

    Returns:
        How many blocks it saw.
    """
    height, width, _ = planes.shape
    fx, fy, cx, cy = focal[0], focal[1], focal[2], focal[3]
    T = T_camera_map
    radius = 0.87 * BLOCK * voxel_m  # half the diagonal of a block
    wide, high = max(cx, width - cx) / fx, max(cy, height - cy) / fy
    seen = 0
    for number in range(len(blocks)):
        x0 = blocks[number, 0] * BLOCK * voxel_m
        y0 = blocks[number, 1] * BLOCK * voxel_m
        z0 = blocks[number, 2] * BLOCK * voxel_m
        half = 0.5 * BLOCK * voxel_m
        mx, my, mz = x0 + half, y0 + half, z0 + half
        zc = T[2, 0] * mx + T[2, 1] * my + T[2, 2] * mz + T[2, 3]
        if zc < -radius:
            continue
        xc = T[0, 0] * mx + T[0, 1] * my + T[0, 2] * mz + T[0, 3]
        yc = T[1, 0] * mx + T[1, 1] * my + T[1, 2] * mz + T[1, 3]
        if abs(xc) > wide * zc + radius * math.sqrt(1 + wide * wide):
            continue
        if abs(yc) > high * zc + radius * math.sqrt(1 + high * high):
            continue
        place = places[number]
        touched = False
        for k in range(BLOCK):
            for j in range(BLOCK):
                for i in range(BLOCK):
                    wx, wy, wz = x0 + i * voxel_m, y0 + j * voxel_m, z0 + k * voxel_m
                    z = T[2, 0] * wx + T[2, 1] * wy + T[2, 2] * wz + T[2, 3]
                    if z <= 0.01:
                        continue
                    x = T[0, 0] * wx + T[0, 1] * wy + T[0, 2] * wz + T[0, 3]
                    y = T[1, 0] * wx + T[1, 1] * wy + T[1, 2] * wz + T[1, 3]
                    u = math.floor(fx * x / z + cx + 0.5)
                    v = math.floor(fy * y / z + cy + 0.5)
                    if u < 0 or v < 0 or u >= width or v >= height:
                        continue
                    plane = planes[v, u]
                    w = plane[WEIGHT]
                    if not w > 0:
                        continue
                    reach = plane[REACH]
                    ahead = plane[DEPTH] - z
                    d = plane[NX] * x + plane[NY] * y + plane[NZ] * z - plane[OFFSET]
                    if d < -reach or ahead < -BEHIND_REACHES * reach:
                        continue
                    touched = True
                    old = weight[place, k, j, i, 0]
                    if d > reach:
                        w *= FREE_SHARE
                        d = reach
                    else:
                        # The colour of empty space is that of what lies behind: left out. Where
                        # only empty space was seen so far, colour is black and counts for nothing.
                        mixed = colour[place, k, j, i]
                        bare = mixed[0] + mixed[1] + mixed[2] == 0
                        share = 1.0 if bare else w / (old + w)
                        for c in range(3):
                            mixed[c] += share * (rgb[v, u, c] - mixed[c])
                    mean = distance[place, k, j, i, 0]
                    distance[place, k, j, i, 0] = mean + w / (old + w) * (d - mean)
                    weight[place, k, j, i, 0] = old + w
        seen += touched
    return seen
