"""A pair at a reduced size: matched in a fraction of the time, to show where settings lead."""

from __future__ import annotations

from dataclasses import fields, is_dataclass, replace
from typing import Any, TypeVar

import numpy as np

from pseudolidar.geometry.depth import depth_map
from pseudolidar.running.products.converted import Converted
from pseudolidar.structures.arrays import AnyArray, Float32
from pseudolidar.structures.disparity import DisparityMap
from pseudolidar.structures.frame import PairMask, StereoFrame

Settings = TypeVar("Settings")
# Reduced pictures are at most so wide, px: a KITTI pair is halved.
WIDE_PX = 640
# Settings that count pixels, and by which power of the scale they shrink; ranges are searched in
# steps. Others hold at any size, or are left to themselves.
_POWERS = {"speckle_pixels": 2, "largest_px": 1, "disparities": 1, "max_disparity": 1}
_STEPPED, STEP_PX = "disparities", 32


def parts_of_width(width_px: int) -> int:
    """By what pictures of this width are divided: 1, 2, 4 ..."""
    parts = 1
    while width_px / parts > WIDE_PX:
        parts *= 2
    return parts


def reduced(frame: StereoFrame, parts: int) -> StereoFrame:
    """The pair with sides divided, without what belongs to its own pixels: truth and scan."""
    import cv2

    width, height = (max(side // parts, 1) for side in frame.size_px)

    def small(image: AnyArray, how: int) -> Any:
        return np.ascontiguousarray(cv2.resize(image, (width, height), interpolation=how))

    def small_mask(mask: AnyArray) -> AnyArray:
        return np.asarray(small(mask.astype(np.uint8), cv2.INTER_NEAREST) > 0)

    left, right = (small(image, cv2.INTER_AREA) for image in (frame.left, frame.right))
    mask = frame.mask and PairMask(small_mask(frame.mask.left), small_mask(frame.mask.right))
    rig = frame.rig.scaled_to(width, height)
    return replace(
        frame, left=left, right=right, rig=rig, mask=mask, truth=None, scan=None, labels=None
    )


def reduced_settings(settings: Settings, parts: int) -> Settings:
    """Settings of a matcher or a filter for such a pair; others come back as they are."""
    if not is_dataclass(settings):
        return settings
    changed = {}
    for name in (field.name for field in fields(settings)):
        value, power = getattr(settings, name), _POWERS.get(name)
        if power is None or value is None:
            continue
        small = value / parts**power
        if name == _STEPPED:
            small = max(round(small / STEP_PX), 1) * STEP_PX
        elif isinstance(value, int):
            small = max(round(small), min(value, 1))
        changed[name] = small
    return replace(settings, **changed)  # type: ignore[type-var] # it is a dataclass


def enlarged(converted: Converted, frame: StereoFrame) -> Converted:
    """What became of a reduced pair as of the whole one; its cloud keeps its fewer points."""
    assert converted.disparity is not None
    disparity = DisparityMap(
        _large(converted.disparity.values, frame),
        None if converted.disparity.sigma is None else _large(converted.disparity.sigma, frame),
    )
    cloud = converted.cloud
    if cloud.uv is not None:
        height, width = converted.disparity.values.shape
        ratios = np.array(frame.size_px, np.float32) / np.array((width, height), np.float32)
        uv = np.asarray((cloud.uv + 0.5) * ratios - 0.5, cloud.uv.dtype)
        cloud = replace(cloud, uv=uv)
    depth = depth_map(disparity, frame.rig)
    return replace(
        converted, frame=frame, cloud=cloud, disparity=disparity, depth=depth, removed=None
    )


def _large(values: Float32, frame: StereoFrame) -> Float32:
    """(H, W) px of the whole pair from those of the reduced one."""
    import cv2

    width, height = frame.size_px
    ratio = np.float32(width / values.shape[1])
    large = cv2.resize(values, (width, height), interpolation=cv2.INTER_NEAREST)
    return np.asarray(large * ratio, np.float32)
