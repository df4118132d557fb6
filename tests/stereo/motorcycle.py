"""Middlebury's motorcycle in the form that the real data has it: two pictures and an array."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from pseudolidar import Camera, Pose, StereoFrame, StereoRig
from pseudolidar.formats.pictures.image import read_image
from pseudolidar.structures.disparity import DisparityMap

# Of the folder's description.
FOCAL_PX, CX_PX, CY_PX, DOFFS_PX, BASELINE_M = 994.978, 311.193, 254.877, 31.086, 0.193001
DISPARITIES = 96


def motorcycle(data: Path) -> StereoFrame:
    """The pair with its exact disparity."""
    folder = data / "middlebury" / "motorcycle"
    left, right = (read_image(folder / f"motorcycle_{eye}.png").pixels for eye in ("left", "right"))
    with np.load(folder / "motorcycle_disp.npz") as arrays:
        truth = next(iter(arrays.values())).astype(np.float32)
    truth[~np.isfinite(truth)] = np.nan
    height, width = truth.shape
    eyes = [
        Camera(
            np.array([[FOCAL_PX, 0, cx], [0, FOCAL_PX, CY_PX], [0, 0, 1.0]]),
            width,
            height,
            frame=f"camera_{name}",
        )
        for name, cx in (("left", CX_PX), ("right", CX_PX + DOFFS_PX))
    ]
    t_m = np.array([-BASELINE_M, 0, 0])
    rig = StereoRig(*eyes, Pose.from_rotation("camera_right", "camera_left", np.eye(3), t_m))
    return StereoFrame(
        left, right, rig, id="motorcycle", index=0, timestamp_ns=1, truth=DisparityMap(truth)
    )
