"""What a recording holds of a frame, before any schema: profiles make messages of these."""

from __future__ import annotations

import enum
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from typing import TypeAlias

from pseudolidar.structures.arrays import AnyArray, Float64
from pseudolidar.structures.box import Box3D, Label
from pseudolidar.structures.camera import Camera, StereoRig
from pseudolidar.structures.disparity import DisparityMap
from pseudolidar.structures.obstacle import Obstacle
from pseudolidar.structures.pose import Pose


class Kind(enum.Enum):
    """Which thing of a frame it is; a profile has a topic, several or none for each."""

    MARK = "mark of the frame"
    NOTE = "line of the log"
    TRANSFORMS = "tree of coordinate frames"
    POSE = "pose of the body"
    LEFT_IMAGE = "left image"
    LEFT_CAMERA = "left camera"
    RIGHT_IMAGE = "right image"
    RIGHT_CAMERA = "right camera"
    IMAGE = "image of the only camera"
    CAMERA = "the only camera"
    DISPARITY = "disparity"
    DEPTH = "depth of the left image"
    DEPTH_PNG = "depth of the left image as a picture"
    CAMERA_DEPTH = "depth of the only image"
    CAMERA_DEPTH_PNG = "depth of the only image as a picture"
    STEREO_POINTS = "stereo cloud"
    STEREO_POINTS_DRACO = "stereo cloud, packed"
    POINTS = "cloud of another origin"
    POINTS_DRACO = "cloud of another origin, packed"
    SCAN = "LiDAR scan"
    LABELS = "labelled boxes"
    OBSTACLES = "obstacles in space"
    OBSTACLES_SEEN = "obstacles in the left image"
    OBSTACLE_EDGES = "edges of the boxes of obstacles"
    PATH = "way of the body"
    MAP_POINTS = "points of the map"


@dataclass(frozen=True)
class Note:
    """A line of the log.

    Args:
        text: what it says.
        name: of what.
        detail: for programs; where the schema of logs has the name of a source file.
    """

    text: str
    name: str = ""
    detail: str = ""


@dataclass(frozen=True, eq=False)
class Transforms:
    """The tree of coordinate frames.

    Args:
        moving: `T_parent_child` that change with time.
        fixed: those that do not, such as between sensors.
    """

    moving: tuple[Pose, ...]
    fixed: tuple[Pose, ...] = ()


@dataclass(frozen=True, eq=False)
class CameraModel:
    """A rectified camera.

    Args:
        camera: intrinsics and size.
        P: (3, 4) projection of points in the left camera's frame; `P[0, 3] = -f B` for the right.
        frame: name of the camera's own optical frame.
        left: name of the frame that `P` projects points of.
    """

    camera: Camera
    P: Float64
    frame: str
    left: str


@dataclass(frozen=True)
class Picture:
    """An encoded picture.

    Args:
        data: the file.
        kind: `jpeg` or `png`.
        pixels: its pixels as ROS names them: `mono8`, `rgb8`, `mono16`, `rgb16`, `16UC1`.
        frame: name of the camera's optical frame.
        left: name of the left camera's, of a pair; of a single camera its own.
    """

    data: bytes
    kind: str
    pixels: str
    frame: str
    left: str


@dataclass(frozen=True, eq=False)
class Raster:
    """A raw picture.

    Args:
        values: (H, W), little-endian.
        encoding: as ROS and Foxglove name it: `32FC1`, `16UC1`.
        frame: name of the camera's optical frame.
    """

    values: AnyArray
    encoding: str
    frame: str


@dataclass(frozen=True, eq=False)
class Disparity:
    """A disparity map.

    Args:
        disparity: of the left image.
        rig: that it was matched with.
    """

    disparity: DisparityMap
    rig: StereoRig


@dataclass(frozen=True, eq=False)
class Points:
    """A cloud or scan as columns.

    Args:
        columns: x, y, z, then red, green, blue, alpha (uint8), intensity and others, each (N,).
        frame: coordinate frame.
        stamp_ns: its own time stamp, 0 for that of the frame.
        shape: (rows, columns) of an organised cloud, all of whose points are there.
    """

    columns: Mapping[str, AnyArray]
    frame: str
    stamp_ns: int = 0
    shape: tuple[int, int] | None = None


@dataclass(frozen=True)
class Boxes:
    """Labelled boxes.

    Args:
        labels: in any frames of the tree.
        frame: what a message without boxes is said to be in.
    """

    labels: tuple[Label, ...]
    frame: str

    def placed(self) -> Iterator[tuple[int, Label, Box3D]]:
        """The boxes with their labels and a number each; regions to ignore are left out."""
        for number, label in enumerate(self.labels):
            if label.box is not None and not label.ignore:
                yield number if label.track_id is None else label.track_id, label, label.box


@dataclass(frozen=True)
class Obstacles:
    """What is in the way.

    Args:
        obstacles: their boxes in `frame`.
        frame: the left camera's.
    """

    obstacles: tuple[Obstacle, ...]
    frame: str


@dataclass(frozen=True, eq=False)
class Way:
    """Where a body was, from the beginning of its path on.

    Args:
        poses: `T_map_base_link`, in order of time.
        stamps_ns: when, one for each.
    """

    poses: tuple[Pose, ...]
    stamps_ns: tuple[int, ...]


Content: TypeAlias = (
    Note
    | Transforms
    | Pose
    | CameraModel
    | Picture
    | Raster
    | Disparity
    | Points
    | Boxes
    | Obstacles
    | Way
)


@dataclass(frozen=True, eq=False)
class Item:
    """One thing that a recording holds of a frame.

    Args:
        kind: which.
        content: the thing.
    """

    kind: Kind
    content: Content
