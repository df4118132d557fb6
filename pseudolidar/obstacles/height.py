"""From where to where an object reaches upwards."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from pseudolidar.obstacles.class_sizes import size_of_class
from pseudolidar.obstacles.frustum import Frustum
from pseudolidar.obstacles.plausible import BORDER_PX, EDGE_PX, EDGE_SHARE
from pseudolidar.obstacles.sight import Sight
from pseudolidar.structures.box import Detection

# The ground under a thing is known this well, as a share of its distance.
UNEVEN = 0.005
# Edges of a box are seen about here in a thing's length.
EDGE_DEPTH = 0.2
# A box whose lower edge is so many sigmas above the ground does not show where its thing stands.
HIDDEN_SIGMAS, GROUND_M = 3.0, 0.15


@dataclass(frozen=True)
class Span:
    """Heights in level axes, above the camera, m.

    Args:
        low_m: of the underside.
        high_m: of the top.
        sigma_middle_m: one standard deviation of their middle.
        sigma_height_m: of their difference.
    """

    low_m: float
    high_m: float
    sigma_middle_m: float
    sigma_height_m: float

    @property
    def height_m(self) -> float:
        """From underside to top."""
        return self.high_m - self.low_m


def upright_span(sight: Sight, detection: Detection, pixels: Frustum, near_m: float) -> Span:
    """The underside on the ground where things stand on it, and the height that its box shows.

    The height is that of the box at the depth of the object, weighed against the usual one of its
    class. Of a thing that stands it begins at the ground where the box ends clearly above that: its
    lower part is hidden. Where the border cuts the box it is the usual one, or that of the highest
    points.

    Args:
        sight: the frame.
        detection: the box.
        pixels: of the object; may be none.
        near_m: depth of its near side.
    """
    size = size_of_class(detection.name)
    _, top, _, bottom = detection.box_px
    fy, cy = float(sight.camera.K[1, 1]), float(sight.camera.K[1, 2])
    depth_m = near_m + (EDGE_DEPTH * size.length_m[0] if size.round_m else 0.0)
    usual_m, usual_sigma_m = size.height_m
    seen_m = max((bottom - top) * depth_m / fy, 1e-3)
    underside_m = -(bottom - cy) / fy * depth_m
    stands = sight.ground is not None and size.stands
    ground_m = -sight.ground.offset_m if sight.ground is not None else underside_m
    far = float(np.median(pixels.sigma_m / pixels.depth_m)) if len(pixels) else 0.0
    sigma_m = float(np.hypot(EDGE_PX * depth_m / fy, np.hypot(EDGE_SHARE, far) * seen_m))
    above_m = underside_m - ground_m
    if stands and above_m > HIDDEN_SIGMAS * np.hypot(EDGE_PX * depth_m / fy, GROUND_M):
        seen_m += above_m
    if top <= BORDER_PX or bottom >= sight.camera.height_px - 1 - BORDER_PX:
        reach_m = float(np.quantile(pixels.height_m, 0.98)) if len(pixels) else 0.0
        reach_m -= 0.0 if stands else max(above_m, 0.0)
        height_m, sigma_height_m = max(usual_m, reach_m), usual_sigma_m
    else:
        a, b = sigma_m**-2, usual_sigma_m**-2
        height_m, sigma_height_m = (a * seen_m + b * usual_m) / (a + b), (a + b) ** -0.5
    if stands:
        low_m, sigma_low_m = ground_m, UNEVEN * depth_m + 0.03
    else:
        low_m, sigma_low_m = underside_m, sigma_m
    middle_m = float(np.hypot(sigma_low_m, 0.5 * sigma_height_m))
    return Span(low_m, low_m + height_m, middle_m, float(sigma_height_m))
