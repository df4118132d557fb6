"""Calibrated stereo in, metric 3D out, every number checked against a real LiDAR."""

from pseudolidar.errors import PseudolidarError
from pseudolidar.structures.box import Box3D, Detection, Label, Track
from pseudolidar.structures.camera import Camera, StereoRig
from pseudolidar.structures.cloud import PointCloud
from pseudolidar.structures.correction import DisparityCorrection, RowCorrection, SigmaScale
from pseudolidar.structures.disparity import DepthMap, DisparityMap
from pseudolidar.structures.frame import LidarScan, RawPair, StereoFrame
from pseudolidar.structures.pose import Pose, Trajectory

__version__ = "0.1.0"

__all__ = [
    "Box3D",
    "Camera",
    "DepthMap",
    "Detection",
    "DisparityCorrection",
    "DisparityMap",
    "Label",
    "LidarScan",
    "PointCloud",
    "Pose",
    "PseudolidarError",
    "RawPair",
    "RowCorrection",
    "SigmaScale",
    "StereoFrame",
    "StereoRig",
    "Track",
    "Trajectory",
    "__version__",
]
