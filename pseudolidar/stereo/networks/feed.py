"""A pair as the tensors that a network takes."""

from __future__ import annotations

import numpy as np

from pseudolidar.formats.onnx.model import OnnxModel, TensorInfo
from pseudolidar.formats.onnx.pixels import as_tensor, normalised
from pseudolidar.stereo.networks.layout import NetworkLayout
from pseudolidar.structures.arrays import AnyArray, Float32, UInt8

# An initial flow comes from OpenCV's matcher, at half size, over this share of its width.
_FLOW_RANGE_SHARE, _FLOW_STEP = 0.25, 16


def tensors(
    model: OnnxModel, layout: NetworkLayout, left: UInt8, right: UInt8, *, iterations: int
) -> dict[str, AnyArray]:
    """Inputs by name.

    Args:
        model: the network.
        layout: with roles, normalisation and channels known.
        left: (H, W, 3) RGB of the size that the network takes.
        right: like left.
        iterations: for networks that ask for a number of them.
    """
    found: dict[str, AnyArray] = {}
    for info, role in zip(model.inputs, layout.roles, strict=True):
        match role:
            case "left" | "right":
                found[info.name] = _image(info, layout, left if role == "left" else right)
            case "left+right" | "right+left":
                pair = (left, right) if role == "left+right" else (right, left)
                found[info.name] = _image(info, layout, *pair)
            case "half-left" | "half-right":
                found[info.name] = _image(
                    info, layout, _half(left if role == "half-left" else right)
                )
            case "flow" | "negative-flow":
                flow = _initial_flow(info, left, right)
                found[info.name] = flow if role == "flow" else -flow
            case "iterations":
                kind = np.dtype(info.dtype if info.dtype in ("int32", "float32") else "int64")
                found[info.name] = np.full((1,) * len(info.shape or ()), iterations, kind)
            case _:
                found[info.name] = np.full((1,) * len(info.shape or ()), role == "true")
    return found


def _image(info: TensorInfo, layout: NetworkLayout, *images: UInt8) -> AnyArray:
    """(1, C, H, W), or (1, H, W, C) where the network takes that, of one image or both."""
    parts = [normalised(image, layout.normalisation, layout.channels) for image in images]
    return as_tensor(info, np.concatenate(parts, axis=2))


def _half(image: UInt8) -> UInt8:
    import cv2

    size = image.shape[1] // 2, image.shape[0] // 2
    return np.asarray(cv2.resize(image, size, interpolation=cv2.INTER_AREA), np.uint8)


def _initial_flow(info: TensorInfo, left: UInt8, right: UInt8) -> AnyArray:
    """(1, 2, H / 2, W / 2): disparity px of the half-size pair, holes filled along rows; and 0."""
    import cv2

    from pseudolidar.stereo.sgbm import Sgbm

    grey = [cv2.cvtColor(_half(image), cv2.COLOR_RGB2GRAY) for image in (left, right)]
    width = grey[0].shape[1]
    steps = max(1, int(width * _FLOW_RANGE_SHARE) // _FLOW_STEP)
    matcher = Sgbm().build(steps * _FLOW_STEP)
    disparity = np.asarray(matcher.compute(grey[0], grey[1]) / 16, np.float32)
    flow = np.zeros((1, 2, *disparity.shape), np.float32)
    flow[0, 0] = _filled(disparity)
    channels = info.shape[1] if info.shape else 2
    return np.ascontiguousarray(flow[:, :1] if channels == 1 else flow, info.dtype)


def _filled(disparity: Float32) -> Float32:
    """Unknown pixels take the smaller of their two horizontal neighbours, the farther surface."""
    known = disparity > 0
    columns = np.arange(disparity.shape[1])
    before = np.maximum.accumulate(np.where(known, columns, -1), axis=1)
    after = np.minimum.accumulate(np.where(known, columns, 1 << 30)[:, ::-1], axis=1)[:, ::-1]
    rows = np.arange(disparity.shape[0])[:, None]
    sides = [
        np.where(inside, disparity[rows, np.clip(at, 0, len(columns) - 1)], np.inf)
        for at, inside in ((before, before >= 0), (after, after < 1 << 30))
    ]
    nearest = np.minimum(*sides)
    return np.asarray(
        np.where(known, disparity, np.where(np.isfinite(nearest), nearest, 0)), np.float32
    )
