"""Frames as messages: pure functions from nouns to what a recording holds of them."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence, Set
from dataclasses import dataclass, field, replace

import numpy as np

from pseudolidar.errors import SequenceTime, StructureError
from pseudolidar.formats.mcap.columns import WIDENED, cloud_columns, scan_columns
from pseudolidar.formats.mcap.content import DEFAULT_CONTENT, McapContent
from pseudolidar.formats.mcap.items import (
    Boxes,
    CameraModel,
    Disparity,
    Item,
    Kind,
    Note,
    Obstacles,
    Picture,
    Points,
    Raster,
    Transforms,
    Way,
)
from pseudolidar.formats.mcap.obstacle_edges import edge_points
from pseudolidar.formats.mcap.profile import Profile
from pseudolidar.formats.mcap.profiles import profile_of
from pseudolidar.formats.mcap.records import Parts
from pseudolidar.formats.pictures.image import encode_jpeg, encode_png
from pseudolidar.formats.points.columns import lines_beside
from pseudolidar.geometry.frames import MAP, ODOM, camera_tree, component, frame_tree
from pseudolidar.geometry.thinning import thinned
from pseudolidar.structures.arrays import Image
from pseudolidar.structures.camera import LEFT_FRAME, Camera
from pseudolidar.structures.cloud import PointCloud
from pseudolidar.structures.disparity import DepthMap, DisparityMap
from pseudolidar.structures.frame import LidarScan, StereoFrame
from pseudolidar.structures.obstacle import Obstacle
from pseudolidar.structures.pose import Pose
from pseudolidar.structures.recorded import DepthFrame, Frame, RecordedCloud

MM_PER_M = 1000.0
# Largest depth of a 16-bit image; a depth that rounds to more is left out, not cut.
FARTHEST_MM = 65535.0

CLOUD_KINDS = {
    ("plain", True): Kind.STEREO_POINTS,
    ("plain", False): Kind.POINTS,
    ("draco", True): Kind.STEREO_POINTS_DRACO,
    ("draco", False): Kind.POINTS_DRACO,
}


@dataclass(frozen=True)
class LogMessage:
    """One message of a recording.

    Args:
        profile: whose topics there are.
        channel: identifier of its topic in the profile.
        timestamp_ns: time it is filed under: that of its frame.
        parts: serialised message of the topic's schema, in pieces.
    """

    profile: Profile
    channel: int
    timestamp_ns: int
    parts: Parts

    @property
    def nbytes(self) -> int:
        """Size of the message."""
        return sum(len(part) for part in self.parts)


@dataclass(frozen=True, eq=False)
class Results:
    """What a frame has become.

    Args:
        disparity: of the left image of a pair.
        depth: of the left image, or of the only one.
        cloud: in any frame of the tree.
        notes: lines for the log, besides those of the frame.
        obstacles: in the left camera's frame; None where none were looked for.
    """

    disparity: DisparityMap | None = None
    depth: DepthMap | None = None
    cloud: PointCloud | None = None
    notes: Sequence[str] = field(default=())
    obstacles: Sequence[Obstacle] | None = None


def frame_messages(
    frame: Frame,
    *,
    disparity: DisparityMap | None = None,
    depth: DepthMap | None = None,
    cloud: PointCloud | None = None,
    notes: Sequence[str] = (),
    obstacles: Sequence[Obstacle] | None = None,
    content: McapContent = DEFAULT_CONTENT,
) -> tuple[LogMessage, ...]:
    """Everything a recording holds of a frame; pure, for worker threads.

    Args:
        frame: a pair, a picture with depth, or a ready-made cloud; its scan, labels and pose are
            written where it has them, a scan only where it is calibrated to the rest.
        disparity: of the left image of a pair.
        depth: of the left image, or of the only one.
        cloud: stereo cloud, in any frame of the rig; or the cloud of the frame.
        notes: lines for the log, besides those of the frame.
        obstacles: of a frame with a picture, in its camera's frame; None where none were looked
            for.
        content: what to write, and how.

    Raises:
        SequenceTime: the frame's time stamp is not positive.
        StructureError: a column of the cloud is not one number a point, or the cloud is in a frame
            that the rig does not have.
        MissingDependency: clouds are to be packed by Draco, and it is not installed.
    """
    if frame.timestamp_ns <= 0:  # which viewers take for "no time"
        raise SequenceTime(f"time stamp {frame.timestamp_ns} ns", want="a positive number")
    results = Results(disparity, depth, cloud, notes, obstacles)
    match frame:
        case StereoFrame():
            items = _pair_items(frame, results, content)
        case DepthFrame():
            items = _depth_items(frame, results, content)
        case RecordedCloud():
            items = _cloud_items(frame, results, content)
    return _encoded(items, content, frame.timestamp_ns)


def obstacle_messages(
    obstacles: Sequence[Obstacle],
    *,
    timestamp_ns: int,
    frame: str = LEFT_FRAME,
    content: McapContent = DEFAULT_CONTENT,
) -> tuple[LogMessage, ...]:
    """Of a frame its obstacles alone, for those who know them later than all else of it.

    Args:
        obstacles: in `frame`; none is a message, too.
        timestamp_ns: of the frame.
        frame: the left camera's, or the only one's.
        content: how to write.
    """
    return _encoded(_obstacles(obstacles, frame), content, timestamp_ns)


def path_messages(
    way: Way,
    map_points: PointCloud | None,
    *,
    timestamp_ns: int,
    content: McapContent = DEFAULT_CONTENT,
) -> tuple[LogMessage, ...]:
    """The way until a frame, and what there is of the map by then.

    Args:
        way: until then.
        map_points: in the way's frame; None for none.
        timestamp_ns: of the frame.
        content: how to write.
    """
    items = [Item(Kind.PATH, way)]
    if map_points is not None and len(map_points):
        columns = cloud_columns(map_points, pixels=False, holes=False, exact=True)
        items.append(Item(Kind.MAP_POINTS, Points(columns, map_points.frame)))
    return _encoded(items, content, timestamp_ns)


def _encoded(
    items: Iterable[Item], content: McapContent, timestamp_ns: int
) -> tuple[LogMessage, ...]:
    profile = profile_of(content)
    encoded = (
        (channel, topic.encode(item.content, timestamp_ns))
        for item in items
        for channel, topic in profile.topics_of(item.kind)
    )
    return tuple(
        LogMessage(profile, channel, timestamp_ns, parts) for channel, parts in encoded if parts
    )


def _pair_items(frame: StereoFrame, results: Results, content: McapContent) -> Iterator[Item]:
    rig, scan = frame.rig, frame.scan
    tree = frame_tree(rig, frame.pose)
    known = _names(tree)
    left, right = rig.left.frame, rig.T_right_left.dst
    yield _mark(frame, results.cloud, pose=frame.pose)
    yield from _notes(frame, results.notes)
    yield _body_transforms(tree)
    yield from _pose(frame.pose)
    yield Item(Kind.LEFT_CAMERA, CameraModel(rig.left, rig.P_left, left, left))
    yield Item(Kind.RIGHT_CAMERA, CameraModel(rig.right, rig.P_right, right, left))
    if content.images != "none":
        yield Item(Kind.LEFT_IMAGE, _picture(frame.left, left, left, content))
        yield Item(Kind.RIGHT_IMAGE, _picture(frame.right, right, left, content))
    yield from _scan(frame.id, scan, known, content)
    if content.labels and frame.labels is not None:
        placed = (
            label for label in frame.labels if label.box is None or label.box.pose.dst in known
        )
        yield Item(Kind.LABELS, Boxes(tuple(placed), left))
    if content.disparity and results.disparity is not None:
        yield Item(Kind.DISPARITY, Disparity(results.disparity, rig))
    yield from _depth(results.depth, left, content, Kind.DEPTH, Kind.DEPTH_PNG)
    if results.cloud is not None and results.cloud.frame not in known:
        raise StructureError(
            f"a cloud in frame {results.cloud.frame!r}", want=f"one of {', '.join(sorted(known))}"
        )
    yield from _cloud(frame, results.cloud, content, stereo=True)
    yield from _obstacles(results.obstacles, left)


def _depth_items(frame: DepthFrame, results: Results, content: McapContent) -> Iterator[Item]:
    camera: Camera = frame.camera
    name = camera.frame
    yield _mark(frame, results.cloud, pose=frame.pose)
    yield from _notes(frame, results.notes)
    yield _body_transforms(camera_tree(camera, frame.pose))
    yield from _pose(frame.pose)
    P = np.hstack([camera.K, np.zeros((3, 1))])
    yield Item(Kind.CAMERA, CameraModel(camera, P, name, name))
    if content.images != "none":
        yield Item(Kind.IMAGE, _picture(frame.image, name, name, content))
    depth = frame.depth if results.depth is None else results.depth
    yield from _depth(depth, name, content, Kind.CAMERA_DEPTH, Kind.CAMERA_DEPTH_PNG)
    yield from _cloud(frame, results.cloud, content, stereo=False)
    yield from _obstacles(results.obstacles, name)


def _cloud_items(frame: RecordedCloud, results: Results, content: McapContent) -> Iterator[Item]:
    cloud = frame.cloud if results.cloud is None else results.cloud
    tree = component(frame.tree, cloud.frame)
    holes = _keeps_holes(cloud, content)
    beside = _beside(cloud, cloud.shape if holes else None)
    yield Item(Kind.MARK, Note(_mark_text(frame), frame.id, beside))
    yield from _notes(frame, results.notes)
    if tree:
        yield Item(Kind.TRANSFORMS, Transforms(tree))
    if len(tree) < len(frame.tree):
        text = f"transforms left out that are not tied to {cloud.frame}, the frame of the points"
        yield Item(Kind.NOTE, Note(text, frame.id))
    yield from _scan(frame.id, frame.scan, _names(tree) | {cloud.frame}, content)
    # Only what came from two eyes says how sure it is of each point.
    made = replace(content, pixels=True)  # what exists already keeps all its columns
    yield from _cloud(frame, cloud, made, stereo=cloud.sigma_m is not None, holes=holes)


def _keeps_holes(cloud: PointCloud, content: McapContent) -> bool:
    """Whether all points of an organised cloud are written, also those without coordinates."""
    fits = not content.max_points or len(cloud) <= content.max_points
    return cloud.shape is not None and content.cloud_format == "plain" and fits


def _names(tree: Iterable[Pose]) -> Set[str]:
    return {name for pose in tree for name in (pose.dst, pose.src)}


def _mark_text(frame: Frame) -> str:
    return f"frame {frame.id}, index {frame.index}"


def _mark(frame: StereoFrame | DepthFrame, cloud: PointCloud | None, *, pose: Pose | None) -> Item:
    text = _mark_text(frame)
    unknown = "" if pose else ", no pose: map, odom and base_link coincide"
    return Item(Kind.MARK, Note(text + unknown, frame.id, _beside(cloud)))


def _beside(cloud: PointCloud | None, shape: tuple[int, int] | None = None) -> str:
    """Lines about what messages of points lack, so that they can be read as they were."""
    columns = {} if cloud is None else cloud.extra
    dtypes = {n: c.dtype.name for n, c in columns.items() if c.dtype.name in WIDENED}
    return "\n".join(lines_beside(dtypes, shape))


def _notes(frame: Frame, notes: Sequence[str]) -> Iterator[Item]:
    for note in (*frame.notes, *notes):
        yield Item(Kind.NOTE, Note(note, frame.id))


def _body_transforms(tree: tuple[Pose, ...]) -> Item:
    """Of a body with sensors: only what hangs on the world moves."""
    moving = tuple(pose for pose in tree if pose.dst in (MAP, ODOM))
    fixed = tuple(pose for pose in tree if pose.dst not in (MAP, ODOM))
    return Item(Kind.TRANSFORMS, Transforms(moving, fixed))


def _pose(pose: Pose | None) -> Iterator[Item]:
    if pose is not None:
        yield Item(Kind.POSE, pose)


def _scan(
    frame_id: str, scan: LidarScan | None, known: Set[str], content: McapContent
) -> Iterator[Item]:
    """A scan, which viewers cannot place in a frame outside the tree."""
    if not content.scan or scan is None:
        return
    if scan.frame in known:
        yield Item(Kind.SCAN, Points(scan_columns(scan), scan.frame, scan.timestamp_ns))
    else:
        text = f"scan left out: {scan.frame} is not calibrated to the cameras"
        yield Item(Kind.NOTE, Note(text, frame_id))


def _depth(
    depth: DepthMap | None, frame: str, content: McapContent, raw: Kind, png: Kind
) -> Iterator[Item]:
    if depth is None:
        return
    if content.depth == "raw":
        yield Item(raw, Raster(depth_mm(depth), "16UC1", frame))
    elif content.depth == "png":
        data = encode_png(depth_mm(depth).astype(np.uint16))
        yield Item(png, Picture(data, "png", "16UC1", frame, frame))


def _cloud(
    frame: Frame,
    cloud: PointCloud | None,
    content: McapContent,
    *,
    stereo: bool,
    holes: bool = False,
) -> Iterator[Item]:
    if not content.cloud or cloud is None:
        return
    if content.max_points and len(cloud) > content.max_points:
        whole = cloud if cloud.shape is None else cloud[cloud.valid]
        cloud = thinned(whole, content.max_points)
        if len(cloud) < len(whole):
            text = (
                f"points of this message: {len(cloud)} of {len(whole)}, fewer where they are dense"
            )
            yield Item(Kind.NOTE, Note(text, frame.id))
    exact = content.cloud_format == "plain"
    columns = cloud_columns(cloud, pixels=content.pixels, holes=holes, exact=exact)
    kind = CLOUD_KINDS[content.cloud_format, stereo]
    shape = cloud.shape if holes else None
    yield Item(kind, Points(columns, cloud.frame, cloud.timestamp_ns, shape))


def _obstacles(found: Sequence[Obstacle] | None, frame: str) -> Iterator[Item]:
    """Of a frame in which nothing is found a message that says so: viewers forget those before."""
    if found is not None:
        obstacles = Obstacles(tuple(found), frame)
        yield Item(Kind.OBSTACLES, obstacles)
        yield Item(Kind.OBSTACLES_SEEN, obstacles)
        yield Item(Kind.OBSTACLE_EDGES, edge_points(found, frame))


def _picture(image: Image, frame: str, left: str, content: McapContent) -> Picture:
    """An image as JPEG or PNG; 16-bit images keep their values in a PNG."""
    pixels = ("rgb" if image.ndim == 3 else "mono") + str(8 * image.itemsize)
    if content.images == "jpeg" and image.dtype == np.uint8:
        return Picture(encode_jpeg(image, content.jpeg_quality), "jpeg", pixels, frame, left)
    return Picture(encode_png(image), "png", pixels, frame, left)


def depth_mm(depth: DepthMap) -> Image:
    """(H, W) uint16 mm, 0 where there is none or it is beyond 65.535 m."""
    mm = np.rint(depth.values * np.float32(MM_PER_M))
    inside = (mm > 0) & (mm <= FARTHEST_MM)  # False for NaN
    return np.where(inside, mm, 0).astype("<u2")
