"""Pictures as networks take them: order of colours, range of values, order of axes."""

from __future__ import annotations

from typing import Literal

import numpy as np

from pseudolidar.formats.onnx.model import TensorInfo
from pseudolidar.structures.arrays import AnyArray, Float32, UInt8

Normalisation = Literal["unit", "raw", "imagenet", "centred"]
Channels = Literal["rgb", "bgr", "grey"]

FLOAT_TYPES = ("float32", "float16", "float64")
IMAGE_TYPES = (*FLOAT_TYPES, "uint8")
# Channels of an input: both images of a pair in colour or grey, one image, a flow.
STACKED = {6: "rgb", 2: "grey"}
SINGLE = {3: "rgb", 1: "grey"}
COLOURS = {**STACKED, **SINGLE}
# Mean and deviation of ImageNet's R, G, B in 0..1, which many networks were trained with.
IMAGENET_MEAN = np.array([0.485, 0.456, 0.406], np.float32)
IMAGENET_DEVIATION = np.array([0.229, 0.224, 0.225], np.float32)


def channel_axis(info: TensorInfo) -> int | None:
    """Axis 1 or 3 of an image input, None where it is no image."""
    if info.shape is None or len(info.shape) != 4 or info.dtype not in IMAGE_TYPES:
        return None
    return next((axis for axis in (1, 3) if info.shape[axis] in COLOURS), None)


def channel_count(info: TensorInfo) -> int:
    """Channels of an image input, 0 of anything else."""
    axis = channel_axis(info)
    count = None if axis is None or info.shape is None else info.shape[axis]
    return count if isinstance(count, int) else 0


def size_of(info: TensorInfo) -> tuple[int | None, int | None]:
    """(height, width) of an image input, None where it is free."""
    axis, shape = channel_axis(info), info.shape
    if axis is None or shape is None:
        return None, None
    height, width = (shape[2], shape[3]) if axis == 1 else (shape[1], shape[2])
    return (
        height if isinstance(height, int) else None,
        width if isinstance(width, int) else None,
    )


def normalised(
    image: UInt8, normalisation: Normalisation | None, channels: Channels | None
) -> Float32:
    """(H, W, C) float32 in the order and range that a network takes.

    Args:
        image: (H, W, 3) RGB.
        normalisation: of the values.
        channels: order of the colours, or grey.
    """
    if channels == "grey":
        import cv2

        grey = cv2.cvtColor(image, cv2.COLOR_RGB2GRAY)
        values: Float32 = np.asarray(grey[:, :, None], np.float32)
    else:
        values = np.asarray(image, np.float32)
    match normalisation:
        case "unit":
            values = values / np.float32(255)
        case "centred":
            values = values / np.float32(127.5) - 1
        case "imagenet":
            mean, deviation = IMAGENET_MEAN, IMAGENET_DEVIATION
            if channels == "grey":
                mean, deviation = mean.mean(keepdims=True), deviation.mean(keepdims=True)
            values = (values / np.float32(255) - mean) / deviation
    ordered = values[:, :, ::-1] if channels == "bgr" else values
    return np.asarray(ordered, np.float32)


def as_tensor(info: TensorInfo, planes: AnyArray) -> AnyArray:
    """(1, C, H, W), or (1, H, W, C) where the network takes that, of (H, W, C)."""
    if channel_axis(info) == 1:
        planes = planes.transpose(2, 0, 1)
    return np.ascontiguousarray(planes[None], info.dtype)
