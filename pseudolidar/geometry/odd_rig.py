"""What is odd about the numbers of a rig: possible, but rarely meant."""

from __future__ import annotations

import numpy as np

from pseudolidar.geometry.lens import Lens
from pseudolidar.geometry.unrectified import rotation_deg, side_word
from pseudolidar.structures.arrays import Float64
from pseudolidar.structures.camera import Camera, StereoRig

# Fields of view that flat pictures have, degrees; outside, K is mostly of another picture size.
FIELD_DEG = (5.0, 150.0)
# Pixels of cameras are square to a few percent.
UNEQUAL_PIXELS = 0.03
# The principal point is near the middle, as a share of width or height; of pictures that were cut
# or rectified it is further off, so that this is no error.
OFF_CENTRE = 0.2
# Baselines of rigs that people build, m.
BASELINE_M = (0.005, 2.0)
# Cameras of a pair look the same way to some degrees.
ROTATION_DEG = 20.0
# The right camera above, below, in front of or behind the left one, as a share of the baseline.
OFF_ROWS = 0.3
# Points along each side of a picture at which its lens model is tried.
OUTLINE = 16


def oddities(rig: StereoRig) -> tuple[str, ...]:
    """What is odd about a rig, each in a sentence; empty of most.

    Nothing here is an error: what cannot be at all is refused where a rig is made.

    Args:
        rig: any, rectified or not.
    """
    found = [
        f"{name}: {text}"
        for name, camera in (("left", rig.left), ("right", rig.right))
        for text in _of_camera(camera)
    ]
    return (*found, *_of_pose(rig))


def field_deg(camera: Camera) -> tuple[float, float]:
    """Horizontal and vertical field of view, degrees, along the row and column of the centre.

    NaN where the picture shows more than its lens model holds for.
    """
    (cx, cy), (width, height) = camera.K[:2, 2], camera.size_px
    ends = np.array([[0, cy], [width - 1.0, cy], [cx, 0], [cx, height - 1.0]])
    left, right, top, bottom = Lens.of(camera).directions(ends)
    return _angle_deg(left, right, 0), _angle_deg(top, bottom, 1)


def _angle_deg(first: Float64, last: Float64, axis: int) -> float:
    angles = [np.arctan2(each[axis], each[2]) for each in (first, last)]
    return float(np.degrees(angles[1] - angles[0]))


def _of_camera(camera: Camera) -> list[str]:
    K, (width, height) = camera.K, camera.size_px
    found: list[str] = []
    across_deg = 2 * np.degrees(np.arctan(width / 2 / K[0, 0]))
    if camera.model == "pinhole" and not FIELD_DEG[0] <= across_deg <= FIELD_DEG[1]:
        found.append(
            f"a field of {across_deg:.0f} degrees (fx {K[0, 0]:.5g} px of a width of {width} px): "
            "K of another picture size?"
        )
    if abs(K[0, 0] / K[1, 1] - 1) > UNEQUAL_PIXELS:
        found.append(f"fx {K[0, 0]:.5g} px and fy {K[1, 1]:.5g} px: pixels that are not square")
    off = np.abs(K[:2, 2] / np.array([width - 1, height - 1]) - 0.5)
    if off.max() > OFF_CENTRE:
        found.append(
            f"principal point ({K[0, 2]:.5g}, {K[1, 2]:.5g}) px far from the middle of "
            f"{width}x{height}: K of another picture size, or a part of a picture?"
        )
    if K[0, 1] != 0:
        found.append(f"skew of {K[0, 1]:.3g} px, which cameras do not have")
    turned_back = _turned_back(camera)
    if turned_back:
        found.append(turned_back)
    return found


def _turned_back(camera: Camera) -> str:
    """Whether the lens model of a flat picture ends within the picture."""
    if camera.model != "pinhole" or not camera.distortion.any():
        return ""
    lens = Lens.of(camera)
    width, height = camera.size_px
    x, y = np.linspace(0, width - 1, OUTLINE), np.linspace(0, height - 1, OUTLINE)
    grid = np.stack(np.meshgrid(x, y), axis=-1).reshape(-1, 2)
    lost = np.isnan(lens.directions(grid)).any(axis=-1)
    if not lost.any():
        return ""
    off_px = np.linalg.norm(grid - camera.K[:2, 2], axis=-1)
    return (
        f"the lens model turns back {np.degrees(lens.limit_rad):.0f} degrees off the axis, about "
        f"{off_px[lost].min():.0f} px from the centre: {lost.mean():.0%} of the picture has no "
        "direction; fewer distortion numbers, or views that reach its corners, mend it"
    )


def _of_pose(rig: StereoRig) -> list[str]:
    found: list[str] = []
    R = rig.T_right_left.matrix[:3, :3]
    place_m = rig.T_right_left.inverse().translation_m
    length_m = float(np.linalg.norm(place_m))
    if not BASELINE_M[0] <= length_m <= BASELINE_M[1]:
        found.append(f"cameras {length_m:.4g} m apart: is the unit right?")
    angle_deg = rotation_deg(R)
    if angle_deg > ROTATION_DEG:
        found.append(f"cameras that look {angle_deg:.0f} degrees apart")
    for axis in (1, 2):
        off_m = float(place_m[axis])
        if abs(off_m) > OFF_ROWS * length_m:
            found.append(
                f"the right camera {abs(off_m):.3g} m {side_word(axis, off_m)} the left one, of "
                f"{length_m:.3g} m between them"
            )
    return found
