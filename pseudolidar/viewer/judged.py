"""Clouds of a frame with their errors: depths against its scan or its truth, as `compare` does."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from pseudolidar.errors import PseudolidarError
from pseudolidar.evaluation.compared import ComparedFrame, against_scan, against_truth
from pseudolidar.evaluation.comparison.error_cloud import at_pixels, errors_m, with_errors
from pseudolidar.evaluation.scan_surface import ScanSurface
from pseudolidar.running.comparing.references import SCAN, OwnKind, OwnReference, kind_of
from pseudolidar.running.products.converted import Converted
from pseudolidar.structures.arrays import Float64
from pseudolidar.structures.cloud import PointCloud
from pseudolidar.structures.frame import StereoFrame
from pseudolidar.viewer.moment import Moment


def reference_of(converted: Converted | None, kind: OwnKind = "auto") -> StereoFrame | None:
    """The frame with the one thing that its depths are judged by; None where there is none.

    Args:
        converted: what was made of the frame.
        kind: scan or truth; `auto` is what `compare` takes: the scan, else the truth.
    """
    if converted is None or converted.disparity is None:
        return None
    frame = converted.frame
    return OwnReference(kind)(frame) if isinstance(frame, StereoFrame) else None


def compared_of(converted: Converted | None, kind: OwnKind = "auto") -> ComparedFrame | None:
    """Every reference point of a frame, and what stereo says there; None without a reference.

    Raises:
        CalibrationField: nobody knows where the scan was taken.
    """
    found = reference_of(converted, kind)
    if found is None or converted is None:
        return None
    return _compared(converted, found)


def _compared(converted: Converted, found: StereoFrame) -> ComparedFrame:
    assert converted.disparity is not None  # of what has a reference
    against = against_scan if kind_of(found) == SCAN else against_truth
    return against(converted.disparity, found)


def judged(moment: Moment) -> Moment:
    """The frame with a column `error_m` in each stereo cloud that has a reference."""
    clouds = {
        name: _judged(cloud, moment.makings.get(name)) for name, cloud in moment.clouds.items()
    }
    return replace(moment, clouds=clouds)


def _judged(cloud: PointCloud, converted: Converted | None) -> PointCloud:
    if converted is None or cloud.uv is None:
        return cloud
    try:
        error_m = error_of_pixels(converted)
    except PseudolidarError:
        return cloud  # a scan of nobody knows where: its cloud is not drawn either
    return cloud if error_m is None else with_errors(cloud, error_m)


def error_of_pixels(converted: Converted) -> Float64 | None:
    """(H, W) depth of stereo minus that of the reference, m; NaN where nobody knows it.

    At pixels of reference points it is what `compare` says. Between the beams of a scan it is the
    distance, along the axis of the camera, to the surface that they saw (`ScanSurface`).

    Raises:
        CalibrationField: nobody knows where the scan was taken.
    """
    found = reference_of(converted)
    if found is None:
        return None
    compared = _compared(converted, found)
    error_m = at_pixels(compared, errors_m(compared))
    if found.scan is None or converted.depth is None:
        return error_m
    between_m = converted.depth.values - ScanSurface.of(found).depth_m()
    known = np.isfinite(error_m) | ~np.isfinite(between_m)
    return np.where(known, error_m, between_m)
