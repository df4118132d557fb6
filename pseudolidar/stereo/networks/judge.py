"""How near a network's answer comes to the truth, over every map, sign and scale in it."""

from __future__ import annotations

from dataclasses import dataclass, replace
from itertools import product
from typing import cast

import numpy as np

from pseudolidar.errors import ModelOutput
from pseudolidar.stereo.networks.layout import NetworkLayout, Sign, Unit
from pseudolidar.stereo.networks.reading import OutputMap, disparity_px
from pseudolidar.stereo.networks.scene import ProbeScene
from pseudolidar.structures.arrays import Float32

# A pixel is found within this, px or share of its disparity.
FOUND_PX, FOUND_SHARE_OF_DISPARITY = 1.5, 0.05
_LARGEST_ERROR_PX = 5.0  # an outlier counts no more
# A scale is what the median ratio to the truth is nearest to, within this.
_SCALE_TOLERANCE = 0.08
# Exporters divide by the number of disparities or by a fixed-point factor.
_SCALES = (1.0, 2.0, 4.0, 8.0, 16.0, 32.0, 64.0, 128.0, 192.0, 256.0)


@dataclass(frozen=True)
class Finding:
    """A layout and how well it did.

    Args:
        layout: all fields known but `pad`.
        found: share of the visible pixels whose disparity was found, 0-1.
        error_px: mean error, an outlier counted as 5 px.
    """

    layout: NetworkLayout
    found: float
    error_px: float


def best_reading(
    maps: list[OutputMap], feed: NetworkLayout, expected: NetworkLayout, scene: ProbeScene
) -> Finding | None:
    """The reading of the maps with the smallest error, None if none makes sense.

    Args:
        maps: what the network answered.
        feed: how it was fed, and what of its reading is settled.
        expected: what the names say.
        scene: what it was shown.
    """
    best: Finding | None = None
    # Later maps first: of a list of iterations the last is the best, or as good as the one before.
    largest_first = sorted(maps, key=lambda m: (m.values.size, m.channel), reverse=True)
    for candidate in largest_first:
        asked_for = feed.output in (None, candidate.output)
        if not asked_for or feed.channel not in (None, candidate.channel):
            continue
        for layout in _readings(candidate, feed, expected, scene):
            finding = _judged(candidate, layout, scene)
            if finding is not None and (best is None or finding.error_px < best.error_px):
                best = finding
    return best


def _readings(
    candidate: OutputMap, feed: NetworkLayout, expected: NetworkLayout, scene: ProbeScene
) -> list[NetworkLayout]:
    """Signs and scales that a map may have: the one expected, and the ones nearest to the truth."""
    height, width = scene.truth.shape
    layout = replace(feed, output=candidate.output, channel=candidate.channel)
    expected = replace(expected, output=None, channel=None, inputs=None, pad=None)
    filled = layout.filled(expected)
    found = [] if {"sign", "unit", "scale"} & set(filled.unknown) else [filled]
    values = _resized(candidate, (width, height))
    known = np.isfinite(values) & (values != 0) & scene.visible
    if np.count_nonzero(known) < known.size // 4:
        return found
    ratio = float(np.median(scene.truth[known] / values[known]))
    sign: Sign = "negative" if ratio < 0 else "positive"
    units = [("width", 1.0), ("width", 0.5)] + [
        ("pixel", s**e) for s, e in product(_SCALES, (1, -1))
    ]
    coarse = width / candidate.values.shape[1]
    units.append(("pixel", coarse))
    for unit, scale in dict.fromkeys(units):
        factor = scale * (width if unit == "width" else 1)
        if abs(abs(ratio) / factor - 1) < _SCALE_TOLERANCE:
            guess = NetworkLayout(sign=sign, unit=cast(Unit, unit), scale=scale)
            found.append(layout.filled(guess))
    return found


def _resized(candidate: OutputMap, size_px: tuple[int, int]) -> Float32:
    import cv2

    return np.asarray(cv2.resize(candidate.values, size_px, interpolation=cv2.INTER_NEAREST_EXACT))


def _judged(candidate: OutputMap, layout: NetworkLayout, scene: ProbeScene) -> Finding | None:
    height, width = scene.truth.shape
    try:
        disparity = disparity_px(candidate.values, layout, (width, height))
    except ModelOutput:
        return None
    truth = scene.truth[scene.visible]
    error = np.abs(disparity[scene.visible] - truth)
    error = np.where(np.isfinite(error), error, np.inf)
    found = error <= np.maximum(FOUND_PX, FOUND_SHARE_OF_DISPARITY * truth)
    mean = float(np.minimum(error, _LARGEST_ERROR_PX).mean())
    return Finding(layout, float(found.mean()), mean)
