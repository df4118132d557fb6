"""Points as squares of pixels, the nearest in front."""

from __future__ import annotations

from numba import njit

from pseudolidar.structures.arrays import AnyArray


@njit(
    "void(uint8[:, :, ::1], float64[:, ::1], float64[::1], float64[::1], float64[::1],"
    " int64[::1], uint8[:, ::1])",
    nogil=True,
    cache=True,
)
def splat(
    picture: AnyArray,
    front: AnyArray,
    u: AnyArray,
    v: AnyArray,
    nearness: AnyArray,
    sides: AnyArray,
    rgb: AnyArray,
) -> None:
    """Draw points; of two at a pixel the nearer one is seen, and of equals the later.

    Args:
        picture: (H, W, 3) RGB, changed.
        front: (H, W) nearness of what is seen at each pixel, -inf where there is nothing; changed.
        u: (N,) columns.
        v: (N,) rows.
        nearness: (N,) larger for what is in front.
        sides: (N,) of the squares, px.
        rgb: (N, 3) colours.
    """
    height, width = front.shape
    for i in range(len(u)):
        half, side = sides[i] // 2, sides[i]
        # What is far outside would not fit into an integer.
        if not (-side < u[i] < width + side and -side < v[i] < height + side):
            continue
        # Floor: -0.5 lies in column -1, and not in the first one.
        left, top = int(u[i] + side) - side - half, int(v[i] + side) - side - half
        for row in range(max(top, 0), min(top + side, height)):
            for column in range(max(left, 0), min(left + side, width)):
                if nearness[i] >= front[row, column]:
                    front[row, column] = nearness[i]
                    picture[row, column, 0] = rgb[i, 0]
                    picture[row, column, 1] = rgb[i, 1]
                    picture[row, column, 2] = rgb[i, 2]
