"""Names of topics that both profiles have."""

from __future__ import annotations

FRAME = "/frame"
LOG = "/log"
TRANSFORMS = "/tf"
DISPARITY = "/stereo/disparity"
DEPTH = "/stereo/depth"
CAMERA_DEPTH = "/camera/depth"
STEREO_POINTS = "/stereo/points"
POINTS = "/points"
SCAN = "/velodyne/points"
LABELS = "/labels"
POSE = "/pose"
PATH = "/path"
MAP_POINTS = "/map/points"
OBSTACLES = "/obstacles"
OBSTACLE_EDGES = "/obstacles/edges"
