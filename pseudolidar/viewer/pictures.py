"""The pictures of a frame, and what their pixels tell."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from pseudolidar.errors import PseudolidarError
from pseudolidar.evaluation.pictures import disparity_picture, error_picture, turbo
from pseudolidar.geometry.grey import rgb_of
from pseudolidar.geometry.projection import project_scan
from pseudolidar.running.products.converted import Converted
from pseudolidar.running.reports.samples import photo_of
from pseudolidar.structures.arrays import Float32, Float64, UInt8
from pseudolidar.structures.camera import Camera
from pseudolidar.structures.frame import StereoFrame
from pseudolidar.structures.recorded import DepthFrame, Frame, RecordedCloud
from pseudolidar.viewer.moment import Moment
from pseudolidar.viewer.scan_errors import draw_dots, scan_error_picture

# Depths that are red and blue.
DEPTH_M = (3.0, 60.0)
# Sigmas of depth that are blue and red, as powers of ten: 1 cm and 10 m.
SIGMA_DECADES = (-2.0, 1.0)
# Disparity that is red: this share of the picture's pixels have less.
RED_SHARE = 0.98


@dataclass(frozen=True)
class Layer:
    """A picture that a panel adds to those of a frame.

    Args:
        there: whether a moment has it; asked often.
        draw: (H, W, 3) RGB, of the left picture's size.
    """

    there: Callable[[Moment], bool]
    draw: Callable[[Moment], UInt8]


@dataclass(frozen=True, eq=False)
class Pixel:
    """What is known of a pixel of the left picture.

    Args:
        x: column.
        y: row.
        disparity_px: NaN where there is none.
        sigma_px: of that.
        depth_m: NaN where there is none.
        sigma_m: of that.
        xyz_m: (3,) where it is in the camera's frame: x right, y down, z forward.
    """

    x: int
    y: int
    disparity_px: float
    sigma_px: float
    depth_m: float
    sigma_m: float
    xyz_m: Float64

    @property
    def text(self) -> str:
        """In words, one line a fact."""
        place = f"pixel {self.x}, {self.y}"
        if not np.isfinite(self.depth_m):
            return f"{place}\nno depth"
        lines = [place]
        if np.isfinite(self.disparity_px):
            lines.append(f"disparity {self.disparity_px:.2f} ± {self.sigma_px:.2f} px")
        lines.append(f"depth {self.depth_m:.2f} ± {self.sigma_m:.2f} m")
        x, y, z = self.xyz_m
        range_m = float(np.linalg.norm(self.xyz_m))
        return "\n".join(
            (*lines, f"{x:.2f} right, {y:.2f} down, {z:.2f} ahead; range {range_m:.2f} m")
        )


def kinds(converted: Converted) -> dict[str, Callable[[Converted], UInt8]]:
    """The pictures that there are, by name."""
    frame = converted.frame
    if isinstance(frame, RecordedCloud):
        return {}
    found: dict[str, Callable[[Converted], UInt8]] = {"left": _left}
    if not isinstance(frame, StereoFrame):
        return found | ({"depth": _depth} if converted.depth is not None else {})
    found["right"] = _right
    if converted.disparity is not None:
        found |= {"disparity": disparity_of, "depth": _depth, "sigma": _sigma}
    scanned = frame.scan is not None and frame.rig.T_left_velodyne is not None
    if converted.disparity is not None and (frame.truth is not None or scanned):
        found["error"] = scan_error_picture if frame.truth is None else _error
    if scanned:
        found["velodyne"] = _velodyne
    return found


def pixel_of(converted: Converted, x: float, y: float) -> Pixel:
    """What is known of the pixel nearest to a place in the left picture."""
    camera = camera_of(converted.frame)
    column = int(np.clip(round(x), 0, camera.width_px - 1))
    row = int(np.clip(round(y), 0, camera.height_px - 1))
    disparity, depth = converted.disparity, converted.depth
    sigmas = _sigma_m(converted)
    depth_m = np.nan if depth is None else float(depth.values[row, column])
    sigma_m = np.nan if sigmas is None else float(sigmas[row, column])
    K = camera.K
    ray = np.array([(column - K[0, 2]) / K[0, 0], (row - K[1, 2]) / K[1, 1], 1.0])
    disparity_px = sigma_px = np.nan
    if disparity is not None:
        disparity_px = float(disparity.values[row, column])
        sigma_px = np.nan if disparity.sigma is None else float(disparity.sigma[row, column])
    return Pixel(column, row, disparity_px, sigma_px, depth_m, sigma_m, ray * depth_m)


def camera_of(frame: Frame) -> Camera:
    """The left camera, or the only one."""
    assert isinstance(frame, StereoFrame | DepthFrame)
    return frame.rig.left if isinstance(frame, StereoFrame) else frame.camera


def _sigma_m(converted: Converted) -> Float32 | None:
    """(H, W) one standard deviation of the depth, what the calibration leaves included."""
    depth, disparity, frame = converted.depth, converted.disparity, converted.frame
    if depth is None or depth.sigma is not None:
        return None if depth is None else depth.sigma
    if disparity is None or disparity.sigma is None or not isinstance(frame, StereoFrame):
        return None
    sigma_px = np.hypot(disparity.sigma, np.float32(frame.rig.systematic_sigma_px))
    return np.asarray(depth.values**2 / np.float32(frame.rig.fB_px_m) * sigma_px, np.float32)


def _left(converted: Converted) -> UInt8:
    return photo_of(converted.frame)


def _right(converted: Converted) -> UInt8:
    frame = converted.frame
    assert isinstance(frame, StereoFrame)
    right = frame.right
    return np.asarray(right if right.dtype == np.uint8 else right >> 8, np.uint8)


def disparity_of(converted: Converted) -> UInt8:
    """(H, W, 3) RGB of the disparities of a pair."""
    assert converted.disparity is not None
    values = converted.disparity.values
    known = values[np.isfinite(values)]
    return disparity_picture(values, float(np.quantile(known, RED_SHARE)) if len(known) else 1.0)


def _depth(converted: Converted) -> UInt8:
    depth = converted.depth
    assert depth is not None
    near, far = DEPTH_M
    # By its logarithm: near and far are both told apart, red is near.
    return turbo(-np.log(_positive(depth.values)), -np.log(far), -np.log(near))


def _sigma(converted: Converted) -> UInt8:
    depth = converted.depth
    assert depth is not None
    sigma_m = _sigma_m(converted)
    if sigma_m is None:
        return turbo(np.full_like(depth.values, np.nan), 0, 1)
    return turbo(np.log10(_positive(sigma_m)), *SIGMA_DECADES)


def _error(converted: Converted) -> UInt8:
    frame = converted.frame
    assert isinstance(frame, StereoFrame)
    assert frame.truth is not None
    assert converted.disparity is not None
    return error_picture(converted.disparity.values, frame.truth.values)


def _velodyne(converted: Converted) -> UInt8:
    """The photo with the points of the LiDAR, coloured by depth."""
    frame = converted.frame
    assert isinstance(frame, StereoFrame)
    assert frame.scan is not None
    drawn = rgb_of(photo_of(frame)).copy()
    try:
        seen = project_scan(frame.scan, frame.rig)
    except PseudolidarError:
        return drawn
    near, far = DEPTH_M
    colours = turbo(-np.log(_positive(seen.depth_m)), -np.log(far), -np.log(near))
    draw_dots(drawn, seen.uv, colours)
    return drawn


def _positive(values: Float32 | Float64) -> Float32:
    """Without what has no logarithm."""
    positive = np.asarray(values, np.float32)
    return np.where(positive > 0, positive, np.float32(np.nan))
