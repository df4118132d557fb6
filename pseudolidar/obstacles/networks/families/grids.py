"""The cells that a detector predicts for: one grid a stride over the input, row after row."""

from __future__ import annotations

import functools

import numpy as np

from pseudolidar.structures.arrays import Float64
from pseudolidar.structures.image_size import ImageSize

# Of the published networks: three levels, with a coarser one, with a finer one, with both.
STRIDES = ((8, 16, 32), (8, 16, 32, 64), (4, 8, 16, 32), (4, 8, 16, 32, 64))


def cell_count(size: ImageSize, strides: tuple[int, ...]) -> int:
    """Cells of all grids."""
    return sum(-(-size.width // stride) * -(-size.height // stride) for stride in strides)


def strides_of(count: int, size: ImageSize, anchors: int = 1) -> tuple[int, ...] | None:
    """The strides whose cells, with so many anchors in each, make up a count; None if none do."""
    fitting = (s for s in STRIDES if anchors * cell_count(size, s) == count)
    return next(fitting, None)


@functools.lru_cache(maxsize=8)
def cells(size: ImageSize, strides: tuple[int, ...]) -> Float64:
    """(N, 3) column, row and stride of each cell; not to be written to."""
    parts = []
    for stride in strides:
        rows, columns = -(-size.height // stride), -(-size.width // stride)
        y, x = np.mgrid[:rows, :columns]
        parts.append(np.stack([x, y, np.full_like(x, stride)], axis=2).reshape(-1, 3))
    found = np.concatenate(parts).astype(np.float64)
    found.setflags(write=False)
    return found
