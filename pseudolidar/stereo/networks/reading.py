"""A network's outputs as disparity maps."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from pseudolidar.errors import ModelOutput
from pseudolidar.stereo.networks.layout import NetworkLayout
from pseudolidar.structures.arrays import AnyArray, Float32

# An output whose values differ by less than this share of the largest says nothing about a pair.
_CONSTANT = 1e-6
# Up to this share of values that are no numbers is masked (16-bit networks overflow at places);
# more means that the network does not work.
_MOST_NOT_FINITE = 0.5


@dataclass(frozen=True, eq=False)
class OutputMap:
    """One map among a network's outputs.

    Args:
        output: name.
        channel: index among the maps of that output.
        values: (h, w) as they come.
    """

    output: str
    channel: int
    values: Float32


def output_maps(names: list[str], arrays: list[AnyArray]) -> list[OutputMap]:
    """Every map that the outputs hold.

    Two of the axes are rows and columns, the last two or, before one of length 1 or 2, the two
    before; what is left counts channels, iterations or the batch.
    """
    found = []
    for name, array in zip(names, arrays, strict=True):
        if array.dtype.kind != "f" or array.ndim < 2:
            continue
        values = np.asarray(array, np.float32)
        if values.ndim >= 3 and values.shape[-1] <= 2 < values.shape[-2]:
            values = np.moveaxis(values, -1, -3)
        maps = values.reshape(-1, *values.shape[-2:])
        found += [OutputMap(name, i, plane) for i, plane in enumerate(maps)]
    return found


def chosen_map(maps: list[OutputMap], layout: NetworkLayout) -> Float32:
    """The map that the layout names."""
    for candidate in maps:
        if (candidate.output, candidate.channel) == (layout.output, layout.channel or 0):
            return candidate.values
    have = ", ".join(f"{m.output}[{m.channel}] {m.values.shape}" for m in maps)
    raise ModelOutput(
        f"no output {layout.output}[{layout.channel or 0}]", want=f"one of {have or 'none'}"
    )


def disparity_px(values: Float32, layout: NetworkLayout, size_px: tuple[int, int]) -> Float32:
    """(H, W) disparity in pixels of the network's image; NaN where the output is no number.

    Args:
        values: (h, w) of the output.
        layout: with sign, unit and scale.
        size_px: (width, height) of the image that the network saw.

    Raises:
        ModelOutput: more than half of the values are no numbers, or all are the same.
    """
    finite = np.isfinite(values)
    share = float(finite.mean()) if values.size else 0.0
    if share < 1 - _MOST_NOT_FINITE:
        raise ModelOutput(
            f"{1 - share:.0%} of the output is NaN or infinite",
            want="disparities",
            fix="A 16-bit network may overflow: take a 32-bit export. Or leave the frame out.",
        )
    known = values[finite]
    if np.ptp(known) <= _CONSTANT * max(float(np.abs(known).max()), 1.0):
        raise ModelOutput(
            f"the output is {float(known[0]):g} everywhere",
            want="disparities",
            fix="The network sees nothing in this pair, or is fed wrongly.",
        )
    factor = (layout.scale or 1.0) * (-1 if layout.sign == "negative" else 1)
    if layout.unit == "width":
        factor *= size_px[0]
    found = np.where(finite, values, np.nan) * np.float32(factor)
    return resized_map(np.asarray(found, np.float32), size_px)


def resized_map(values: Float32, size_px: tuple[int, int]) -> Float32:
    """A map at another size, its values as they are; no value between two surfaces is invented.

    Linear where the neighbours belong together, the nearest one elsewhere.
    """
    import cv2

    if values.shape[::-1] == size_px:
        return values
    nearest = cv2.resize(values, size_px, interpolation=cv2.INTER_NEAREST_EXACT)
    smooth = cv2.resize(values, size_px, interpolation=cv2.INTER_LINEAR)
    together = np.abs(smooth - nearest) <= SAME_SURFACE_PX
    return np.asarray(np.where(together, smooth, nearest), np.float32)


# Neighbours within a pixel are one surface, as for speckles.
SAME_SURFACE_PX = 1.0
