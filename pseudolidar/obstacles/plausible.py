"""How well an object of a class would fit its picture at a depth: by its size and its footing."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from pseudolidar.obstacles.class_sizes import size_of_class
from pseudolidar.obstacles.sight import Sight
from pseudolidar.structures.box import Detection

# How well the edges of boxes lie, px, and how uneven the ground is, as a share of the distance.
EDGE_PX, UNEVEN = 3.0, 0.05
# Detectors differ in what they call the edge of a thing: share of its height.
EDGE_SHARE = 0.05
# An edge this close to the border of the picture is cut by it, px.
BORDER_PX = 1.5
# Beside a thing found by its points, from so many px on, this share of the pixels has a depth; else
# it goes on where nothing is matched.
RIM_PX, RIM_SEEN = 8, 0.02
# Degrees of freedom of the long-tailed distribution that errors of such priors have.
FREEDOM = 3.0


@dataclass(frozen=True)
class Guess:
    """A depth that the picture alone tells.

    Args:
        depth_m: of the nearest face.
        sigma_m: one standard deviation.
    """

    depth_m: float
    sigma_m: float


def log_plausible(sight: Sight, detection: Detection, depth_m: float) -> float:
    """Logarithm of how plausible it is that the nearest face is at this depth; 0 is the best."""
    size = size_of_class(detection.name)
    seen_m = _seen_height_m(sight, detection, depth_m + 0.2 * size.length_m[0])
    mean_m, sigma_m = size.height_m
    edges_m = EDGE_PX * depth_m / sight.camera.K[1, 1]
    off = (seen_m - mean_m) / np.hypot(np.hypot(sigma_m, EDGE_SHARE * mean_m), edges_m)
    if is_cut(sight, detection) and off < 0:
        off = 0.0  # as much may be missing as the border cut off
    total = _log_long_tailed(float(off))
    footing = by_footing(sight, detection)
    if size.stands and footing is not None:
        total += _log_long_tailed((depth_m - footing.depth_m) / footing.sigma_m)
    return total


def by_size(sight: Sight, detection: Detection) -> Guess:
    """Depth at which the usual size of its class fills its box: by height, or by width.

    Of a thing that the border cuts, it is the farthest that it can be.
    """
    size = size_of_class(detection.name)
    left, top, right, bottom = detection.box_px
    fx, fy = sight.camera.K[0, 0], sight.camera.K[1, 1]
    tall, wide = max(bottom - top, 1.0), max(right - left, 1.0)
    by_height = fy * size.height_m[0] / tall
    by_width = fx * size.width_m[0] / wide
    cut_rows = top <= BORDER_PX or bottom >= sight.camera.height_px - 1 - BORDER_PX
    depth_m = max(by_height, by_width) if cut_rows else by_height
    if is_cut(sight, detection):
        return Guess(0.5 * depth_m, depth_m / np.sqrt(12))
    share = np.hypot(size.height_m[1] / size.height_m[0], EDGE_PX / tall)
    return Guess(float(depth_m), float(depth_m * max(share, EDGE_SHARE)))


def by_footing(sight: Sight, detection: Detection) -> Guess | None:
    """Depth at which the ground is seen at the lower edge of the box; None where it is not."""
    left, _, right, bottom = detection.box_px
    if sight.ground is None or bottom >= sight.camera.height_px - 1 - BORDER_PX:
        return None
    K = sight.camera.K
    ray = np.array([(0.5 * (left + right) - K[0, 2]) / K[0, 0], (bottom - K[1, 2]) / K[1, 1], 1.0])
    down = -float(sight.ground.normal @ ray)
    height_m = sight.ground.offset_m
    if down <= 0 or height_m <= 0:
        return None
    depth_m = height_m / down
    per_px = depth_m**2 / (K[1, 1] * height_m)
    return Guess(depth_m, float(np.hypot(EDGE_PX * per_px, 0.3) + UNEVEN * depth_m))


def is_cut(sight: Sight, detection: Detection) -> bool:
    """Whether the border of the picture cuts the box."""
    left, top, right, bottom = detection.box_px
    width, height = sight.camera.size_px
    return (
        min(left, top) <= BORDER_PX
        or right >= width - 1 - BORDER_PX
        or bottom >= height - 1 - BORDER_PX
    )


def runs_out_of_sight(sight: Sight, detection: Detection) -> bool:
    """Whether what was found by its points ends where points do: nothing is seen beside it.

    The left eye's picture has a rim that the right eye does not see, as wide as the disparity.
    """
    if detection.mask is None:
        return False
    left, top, right, bottom = (round(edge) for edge in detection.box_px)
    valid = sight.depth.valid[max(0, top) : bottom + 1]
    beside = valid[:, : max(0, left - RIM_PX)], valid[:, right + RIM_PX + 1 :]
    return any(one.size == 0 or float(one.mean()) < RIM_SEEN for one in beside)


def _seen_height_m(sight: Sight, detection: Detection, depth_m: float) -> float:
    return (detection.box_px[3] - detection.box_px[1]) * depth_m / float(sight.camera.K[1, 1])


def _log_long_tailed(off: float) -> float:
    """Of Student's t, up to a constant: a single far-off measure does not decide alone."""
    return -0.5 * (FREEDOM + 1) * float(np.log1p(off * off / FREEDOM))
