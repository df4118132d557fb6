"""Clouds that show their error, and both clouds together, for viewers."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from pseudolidar.evaluation.compared import ComparedFrame
from pseudolidar.structures.arrays import Float64, UInt8
from pseudolidar.structures.cloud import PointCloud
from pseudolidar.structures.frame import StereoFrame

# Relative errors of this size and more have the ends of the colour scale.
FULL_COLOUR_REL = 0.10
TOO_NEAR, RIGHT, TOO_FAR = (33, 102, 220), (235, 235, 235), (214, 47, 39)
# Points without a reference keep this share of their brightness.
DIMMED = 0.35
# Values of the column `source`, and the colour of the reference's points.
STEREO, REFERENCE = 0, 1
REFERENCE_COLOUR = (0, 200, 255)


def error_cloud(cloud: PointCloud, compared: ComparedFrame) -> PointCloud:
    """The stereo cloud with a column `error_m`, coloured by its relative error.

    Error is depth Z of stereo minus that of the reference: > 0, red, is too far; blue too near;
    white is right; the scale ends at 10 %. Points at whose pixel there is no reference point have
    NaN, and the picture's colours, dimmed.

    Args:
        cloud: of the frame, with `uv`, in any coordinate frame.
        compared: the frame with all its reference points.
    """
    assert cloud.uv is not None  # every reprojected cloud has them
    width, height = compared.rig.left.size_px
    column, row = np.rint(compared.u).astype(np.intp), np.rint(compared.v).astype(np.intp)
    error_at, relative_at = np.full((2, height, width), np.nan)
    error_m = compared.depth_m - compared.reference_m
    error_at[row, column], relative_at[row, column] = error_m, error_m / compared.reference_m
    at = tuple(np.rint(cloud.uv).astype(np.intp).T[::-1])
    relative = relative_at[at]
    rgb = np.where(np.isfinite(relative)[:, None], error_colours(relative), _dimmed(cloud))
    extra = {**cloud.extra, "error_m": error_at[at].astype(np.float32)}
    return replace(cloud, rgb=rgb.astype(np.uint8), extra=extra)


def error_colours(relative: Float64) -> UInt8:
    """(N, 3) colours of relative errors (N,): blue too near, white right, red too far."""
    size = np.clip(np.nan_to_num(relative) / FULL_COLOUR_REL, -1.0, 1.0)[:, None]
    end = np.where(size > 0, TOO_FAR, TOO_NEAR)
    colours: Float64 = np.array(RIGHT, np.float64) + np.abs(size) * (end - np.array(RIGHT))
    return np.rint(colours).astype(np.uint8)


def _dimmed(cloud: PointCloud) -> UInt8:
    colours: Float64 = np.full((len(cloud), 3), 255.0)
    if cloud.rgb is not None:
        colours = cloud.rgb.astype(np.float64)
    elif cloud.intensity is not None:
        colours *= np.clip(np.nan_to_num(cloud.intensity.astype(np.float64)), 0, 1)[:, None]
    return (DIMMED * colours).astype(np.uint8)


def reference_points(frame: StereoFrame, compared: ComparedFrame, *, scanned: bool) -> Float64:
    """(M, 3) m in the left camera's frame: the whole scan, or the reference points in view.

    Args:
        frame: with its scan, if it was compared with that.
        compared: the frame with its reference points.
        scanned: whether the scan is the reference.
    """
    scan, rig = frame.scan, compared.rig
    if scanned and scan is not None:
        xyz, T_left_scan = scan.xyz.astype(np.float64), rig.T_left_velodyne
        placed = scan.frame == rig.left.frame or T_left_scan is None
        return xyz if placed or T_left_scan is None else T_left_scan.apply(xyz)
    K, depth_m = rig.left.K, compared.reference_m
    x, y = (compared.u - K[0, 2]) / K[0, 0], (compared.v - K[1, 2]) / K[1, 1]
    return np.stack([x * depth_m, y * depth_m, depth_m], axis=1)


def clouds_together(stereo: PointCloud, reference: Float64) -> PointCloud:
    """The stereo cloud and its reference in one, with a column `source`: 0 stereo, 1 reference.

    Stereo keeps the picture's colours, the reference is cyan.

    Args:
        stereo: of the frame.
        reference: (M, 3) points in the same coordinate frame.
    """
    n, m = len(stereo), len(reference)
    colours = (
        np.full((n, 3), 255, np.uint8) if stereo.rgb is None else stereo.rgb,
        np.tile(np.array(REFERENCE_COLOUR, np.uint8), (m, 1)),
    )
    source = np.repeat(np.array([STEREO, REFERENCE], np.uint8), (n, m))
    return PointCloud(
        xyz=np.concatenate([stereo.xyz, reference.astype(stereo.xyz.dtype)]),
        frame=stereo.frame,
        timestamp_ns=stereo.timestamp_ns,
        rgb=np.concatenate(colours),
        extra={"source": source},
    )
