"""Clouds that show their error, and both clouds together, for viewers."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from pseudolidar.evaluation.compared import ComparedFrame
from pseudolidar.structures.arrays import AnyArray, Float64, UInt8
from pseudolidar.structures.cloud import PointCloud
from pseudolidar.structures.frame import StereoFrame

# Relative errors of this size and more have the ends of the colour scale.
FULL_COLOUR_REL = 0.10
TOO_NEAR, RIGHT, TOO_FAR = (33, 102, 220), (235, 235, 235), (214, 47, 39)
# Points without a reference keep this share of their brightness.
DIMMED = 0.35
# Column of the errors.
ERROR = "error_m"
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
    relative = _at_points(cloud, at_pixels(compared, errors_m(compared) / compared.reference_m))
    known = np.isfinite(relative)[:, None]
    rgb = np.where(known, error_colours(relative), dimmed(cloud))
    judged = with_errors(cloud, at_pixels(compared, errors_m(compared)))
    return replace(judged, rgb=rgb.astype(np.uint8))


def errors_m(compared: ComparedFrame) -> Float64:
    """(N,) depth Z of stereo minus that of the reference, at each reference point."""
    return compared.depth_m - compared.reference_m


def at_pixels(compared: ComparedFrame, values: Float64) -> Float64:
    """(H, W) values (N,) of the reference points at their pixels of the left image, else NaN."""
    width, height = compared.rig.left.size_px
    column, row = np.rint(compared.u).astype(np.intp), np.rint(compared.v).astype(np.intp)
    placed: Float64 = np.full((height, width), np.nan)
    placed[row, column] = values
    return placed


def with_errors(cloud: PointCloud, error_m: Float64) -> PointCloud:
    """The stereo cloud with a column `error_m`, in its own colours.

    Args:
        cloud: of the frame, with `uv`, in any coordinate frame.
        error_m: (H, W) of the pixels of its left image.
    """
    column = _at_points(cloud, error_m).astype(np.float32)
    return replace(cloud, extra={**cloud.extra, ERROR: column})


def _at_points(cloud: PointCloud, values: Float64) -> Float64:
    assert cloud.uv is not None  # every reprojected cloud has them
    return np.asarray(values[tuple(np.rint(cloud.uv).astype(np.intp).T[::-1])])


def error_colours(relative: Float64) -> UInt8:
    """(N, 3) colours of relative errors (N,): blue too near, white right, red too far."""
    return signed_colours(relative / FULL_COLOUR_REL)


def signed_colours(shares: AnyArray) -> UInt8:
    """(..., 3) colours of errors as shares of the scale: blue -1 too near, white 0, red 1 too far.

    Shares beyond have the colours of its ends; NaN is white.
    """
    size = np.clip(np.nan_to_num(np.asarray(shares, np.float64)), -1.0, 1.0)[..., None]
    end = np.where(size > 0, TOO_FAR, TOO_NEAR)
    colours: Float64 = np.array(RIGHT, np.float64) + np.abs(size) * (end - np.array(RIGHT))
    return np.asarray(np.rint(colours), np.uint8)


def dimmed(cloud: PointCloud) -> UInt8:
    """(N, 3) colours of points without a reference: those that they have, darker."""
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
