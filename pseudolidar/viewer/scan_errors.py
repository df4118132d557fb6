"""Errors against a LiDAR scan over the photo, where the data have no other reference."""

from __future__ import annotations

import numpy as np

from pseudolidar.errors import PseudolidarError
from pseudolidar.evaluation.comparison.error_cloud import DIMMED, error_colours, errors_m
from pseudolidar.geometry.grey import rgb_of
from pseudolidar.running.products.converted import Converted
from pseudolidar.running.reports.samples import photo_of
from pseudolidar.structures.arrays import Float64, UInt8
from pseudolidar.viewer.judged import compared_of


def scan_error_picture(converted: Converted) -> UInt8:
    """The dimmed photo, with a dot for the relative error of depth at each point of the scan.

    Blue is too near, white right, red too far; the scale ends at 10 %, as in clouds of errors.
    Where stereo has no depth nothing is drawn.

    Args:
        converted: a frame with a scan and disparities.

    Returns:
        (H, W, 3) uint8 RGB; the dimmed photo alone where it is not known how the scanner stands to
        the camera.
    """
    drawn = (DIMMED * rgb_of(photo_of(converted.frame))).astype(np.uint8)
    try:
        compared = compared_of(converted, "scan")
    except PseudolidarError:  # the calibration does not say where the scanner is
        return drawn
    if compared is None:
        return drawn
    relative = errors_m(compared) / compared.reference_m
    known = np.isfinite(relative)
    uv = np.stack([compared.u, compared.v], axis=1)[known]
    draw_dots(drawn, uv, error_colours(relative[known]))
    return drawn


def draw_dots(drawn: UInt8, uv: Float64, colours: UInt8) -> None:
    """Draw dots of two by two pixels into a picture, in place.

    Args:
        drawn: (H, W, 3) uint8 RGB.
        uv: (N, 2) px, inside the picture.
        colours: (N, 3) uint8 RGB.
    """
    column, row = np.rint(uv).astype(np.intp).T
    height, width = drawn.shape[:2]
    for down, right in ((0, 0), (0, 1), (1, 0), (1, 1)):
        drawn[np.minimum(row + down, height - 1), np.minimum(column + right, width - 1)] = colours
