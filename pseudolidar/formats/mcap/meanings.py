"""What the values of topics mean: said with each channel, in every profile alike."""

from __future__ import annotations

from pseudolidar.structures.disparity import RADIUS_95_PER_SIGMA

MARK_MEANING = {
    "name": "frame id of the source",
    "sequence": "index in the source",
    "file": "dtypes of columns that points hold widened; rows and columns of organised points",
}
DEPTH_MEANING = {
    "unit": "mm",
    "invalid": "0",
    "range": "up to 65.535 m; what is farther is 0 here, and whole in /stereo/disparity",
}
CAMERA_DEPTH_MEANING = DEPTH_MEANING | {"range": "up to 65.535 m; what is farther is 0"}
POINTS_MEANING = {
    "unit": "m",
    "sigma_m": "one standard deviation (68 %) along the ray, m",
    "radius_95": f"{RADIUS_95_PER_SIGMA} sigma_m",
    "u, v": "pixel of the left image, centre of the first pixel at (0, 0)",
    "*.low32": "last 32 bits of integers that are rounded in the column named so",
}
SCAN_MEANING = {"unit": "m", "intensity": "reflectance 0-1"}
DISPARITY_MEANING = {
    "unit": "px",
    "invalid": "NaN",
    "sign": "x_left - x_right",
    "correction": "as matched: a rig's disparity correction is in depth and points only",
}
