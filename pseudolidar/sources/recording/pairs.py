"""The stereo pairs of a recording as frames."""

from __future__ import annotations

from dataclasses import dataclass, field, replace

import numpy as np

from pseudolidar.errors import PairMismatch, PseudolidarError, RecordingError, SourceEmpty
from pseudolidar.formats.mcap.channels import SCAN
from pseudolidar.formats.pictures.image import DecodedImage
from pseudolidar.formats.recordings.messages import (
    CloudMessage,
    EncodedPicture,
    Mark,
    Message,
    RawPicture,
)
from pseudolidar.formats.recordings.raw_picture import picture_pixels
from pseudolidar.formats.timestamps import NS_PER_S
from pseudolidar.geometry.frame_chain import chain
from pseudolidar.geometry.frames import BASE_LINK, MAP, left_in_base_link
from pseudolidar.sources.recording.clouds import ID_DIGITS, marked_ids, order_note
from pseudolidar.sources.recording.frames import RecordedFrames
from pseudolidar.sources.recording.stereo import VELODYNE, StereoTopics, with_lidar
from pseudolidar.sources.recording.topics import Topic, Topics, nearest, nearest_pairs
from pseudolidar.sources.source import SourceSummary
from pseudolidar.structures.arrays import Int64
from pseudolidar.structures.camera import StereoRig
from pseudolidar.structures.frame import LidarScan, RawPair, StereoFrame
from pseudolidar.structures.pose import Pose

# A scan belongs to a pair that is no further away than one turn of a LiDAR at 10 Hz.
SCAN_TOLERANCE_NS = NS_PER_S // 10
# Topics of scans, as against clouds that were computed, have such names.
LIDAR_NAMES = ("velo", "lidar", "ouster", "hesai", "livox", "rslidar", "scan", "laser")
NO_POSE = "no pose"
NS_PER_MS = 1e6


@dataclass(frozen=True, eq=False)
class RecordedPairs:
    """The pairs of a recording; see `FrameSequence`.

    Args:
        summary: what it is.
        ids: names of the frames that the recording marks, else numbers of the left pictures.
        timestamps_ns: stamps of the left pictures.
        refused: pictures of one eye only.
        rig: of all pairs.
        topics: the recording.
        frames: its transforms.
        pair: topics of the pictures.
        numbers: numbers of the left and right picture of each frame.
        scans: topic of the LiDAR, None without one.
        scan_numbers: number of the scan of each frame, -1 for none.
        mark_topic: topic that marks frames, None in recordings of others.
        marks: number of the mark of each frame, -1 for none.
    """

    summary: SourceSummary
    ids: tuple[str, ...]
    timestamps_ns: tuple[int, ...]
    refused: tuple[tuple[str, PseudolidarError], ...]
    rig: StereoRig = field(repr=False)
    topics: Topics = field(repr=False)
    frames: RecordedFrames = field(repr=False)
    pair: StereoTopics = field(repr=False)
    numbers: tuple[tuple[int, int], ...] = field(repr=False)
    scans: Topic | None = field(repr=False)
    scan_numbers: tuple[int, ...] = field(repr=False)
    mark_topic: Topic | None = field(default=None, repr=False)
    marks: tuple[int, ...] = field(default=(), repr=False)

    @property
    def yields(self) -> type[StereoFrame] | type[RawPair]:
        """Rectified or unrectified pairs, by the rig."""
        return StereoFrame if self.rig.is_rectified else RawPair

    def load(self, index: int) -> StereoFrame | RawPair:
        """Read and decode a pair with its scan and pose.

        Raises:
            RecordingError: damaged; says where.
            ImageUnreadable, ImageTruncated, ImageFormat, LimitError: a picture cannot be decoded.
            PairMismatch: left and right differ in size, channels or depth.
            CalibrationSizeMismatch: the pictures have another size than the calibration.
        """
        left, right = self.pair.left.topic, self.pair.right.topic
        number, right_number = self.numbers[index]
        stamp_ns, scan_number = self.timestamps_ns[index], self.scan_numbers[index]
        places = [left.place(number), right.place(right_number)]
        if self.scans is not None and scan_number >= 0:
            places.append(self.scans.place(scan_number))
        fixed = len(places)
        if self.mark_topic is not None and self.marks[index] >= 0:
            places.append(self.mark_topic.place(self.marks[index]))
        places += self.frames.places(stamp_ns, int(left.times_ns[number]))
        messages = self.topics.read(places)
        pictures = self._picture(messages[0], left), self._picture(messages[1], right)
        tree = self.frames.tree(messages[fixed:], stamp_ns)
        still = any(isinstance(m, Mark) and NO_POSE in m.text for m in messages[fixed:])
        try:
            return self.yields(
                pictures[0].pixels,
                pictures[1].pixels,
                self.rig,
                self.ids[index],
                index,
                stamp_ns,
                scan=_scan(messages[2:fixed]),
                pose=None if still else self._pose(tree),
                notes=tuple(dict.fromkeys(pictures[0].notes + pictures[1].notes)),
            )
        except PseudolidarError as error:
            raise error.located(left.name, f"frame {self.ids[index]}") from None

    def _picture(self, message: Message, topic: Topic) -> DecodedImage:
        if not isinstance(message, EncodedPicture | RawPicture):
            raise RecordingError("a message that is no picture", want="one", where=topic.name)
        return picture_pixels(message, topic.name, limits=self.topics.limits)

    def _pose(self, tree: tuple[Pose, ...]) -> Pose | None:
        """`T_map_base_link` by the transforms, None where nothing moves."""
        way = _root(tree, self.pair.left.frame)
        always = {pose.src for pose in self.frames.static}
        T_root_left = chain(tree, way[-1], way[0])
        if T_root_left is None or always.issuperset(way[:-1]):
            return None
        T_left_base = left_in_base_link(self.rig).inverse()
        return Pose(MAP, BASE_LINK, T_root_left.matrix @ T_left_base.matrix)


def open_pairs(
    topics: Topics,
    frames: RecordedFrames,
    pair: StereoTopics,
    summary: SourceSummary,
    *,
    tolerance_s: float,
    first_tree: tuple[Pose, ...],
) -> RecordedPairs:
    """Pair the pictures by the stamps in them, and find the scan of each pair.

    Args:
        topics: the recording.
        frames: its transforms.
        pair: topics of the eyes.
        summary: what the recording is; lines about the pairs are added.
        tolerance_s: largest difference of the stamps of a pair.
        first_tree: transforms at its beginning.

    Raises:
        SourceEmpty: no two pictures are near enough in time.
    """
    left_ns, right_ns = (topics.stamps_ns(eye.topic) for eye in (pair.left, pair.right))
    numbers = nearest_pairs(left_ns, right_ns, round(tolerance_s * NS_PER_S))
    if not numbers:
        raise _never_together(pair, left_ns, right_ns, tolerance_s)
    marked = marked_ids(topics, pair.left.topic)
    ids = marked.ids
    stamps = np.array([left_ns[number] for number, _ in numbers], np.int64)
    scans, lidar = _lidar(topics, pair, first_tree)
    scan_numbers = (-1,) * len(numbers)
    if scans is not None:
        scan_numbers = _nearest_scans(stamps, topics.stamps_ns(scans))
    refused = _unpaired(pair, ids, numbers, (left_ns, right_ns), tolerance_s)
    notes = (
        f"pairs: {pair.left.topic.name} and {pair.right.topic.name}, {pair.line}; stamps up to "
        f"{tolerance_s * 1000:g} ms apart",
        *((f"{len(refused)} pictures without a partner left out",) if refused else ()),
        *((f"scans: {scans.name}",) if scans is not None else ()),
        *order_note(tuple(stamps.tolist())),
    )
    return RecordedPairs(
        summary=replace(
            summary,
            line=f"{summary.line}: {len(numbers)} stereo pairs",
            notes=(*summary.notes, *notes),
        ),
        ids=tuple(ids[number] for number, _ in numbers),
        timestamps_ns=tuple(stamps.tolist()),
        refused=refused,
        rig=with_lidar(pair.rig, first_tree, pair.left.frame, lidar),
        topics=topics,
        frames=frames,
        pair=pair,
        numbers=tuple(numbers),
        scans=scans,
        scan_numbers=scan_numbers,
        mark_topic=marked.topic,
        marks=tuple(marked.marks[number] for number, _ in numbers) if marked.topic else (),
    )


def _never_together(
    pair: StereoTopics, left_ns: Int64, right_ns: Int64, tolerance_s: float
) -> SourceEmpty:
    apart_ms = float(np.median(np.abs(right_ns[nearest(left_ns, right_ns)] - left_ns))) / NS_PER_MS
    return SourceEmpty(
        f"no pair in {pair.left.topic.name} and {pair.right.topic.name}: their stamps are "
        f"{apart_ms:.3g} ms apart",
        want=f"stamps up to {tolerance_s * 1000:g} ms apart",
        fix="If the scene stands still in that time, widen the tolerance: --source.tolerance-s.",
    )


def _nearest_scans(stamps_ns: Int64, scan_ns: Int64) -> tuple[int, ...]:
    """Number of the scan nearest to each stamp, -1 where none is near enough."""
    near = nearest(stamps_ns, scan_ns)
    far = np.abs(scan_ns[near] - stamps_ns) > SCAN_TOLERANCE_NS
    return tuple(np.where(far, -1, near).tolist())


def _lidar(
    topics: Topics, pair: StereoTopics, tree: tuple[Pose, ...]
) -> tuple[Topic | None, str | None]:
    """The topic of scans that transforms tie to the left camera, and their frame."""
    if topics.own:
        clouds = [topic for topic in topics.of_kind("cloud") if topic.name == SCAN]
    else:
        clouds = sorted(topics.of_kind("cloud"), key=_unlikely_scan)
    for topic in clouds:
        first = topics.one(topic, 0, CloudMessage)
        frame = None if first is None else first.cloud.frame
        if frame not in (None, pair.left.frame) and chain(tree, pair.left.frame, frame or ""):
            return topic, frame
    return None, None


def _unlikely_scan(topic: Topic) -> tuple[bool, int, str]:
    named = any(word in topic.name.lower() for word in LIDAR_NAMES)
    return not named, -len(topic), topic.name


def _scan(messages: list[Message]) -> LidarScan | None:
    """The cloud of a LiDAR as a scan: finite points, reflectances as they are."""
    clouds = [message.cloud for message in messages if isinstance(message, CloudMessage)]
    if not clouds:
        return None
    cloud = clouds[0]
    reflectance = cloud.intensity
    if reflectance is None and "intensity" in cloud.extra:
        reflectance = cloud.extra["intensity"].astype(np.float32)
    valid = np.flatnonzero(cloud.valid)
    xyz = cloud.xyz.astype(np.float32, copy=False)
    if len(valid) < len(cloud):
        xyz = xyz.take(valid, axis=0)
        reflectance = None if reflectance is None else reflectance.take(valid)
    return LidarScan(
        xyz,
        reflectance,
        cloud.timestamp_ns,
        VELODYNE,
        dropped=len(cloud) - len(valid),
    )


def _root(tree: tuple[Pose, ...], frame: str) -> tuple[str, ...]:
    """The frame and all above it, up to the root."""
    parents = {pose.src: pose.dst for pose in tree}
    way = [frame]
    while way[-1] in parents and parents[way[-1]] not in way:
        way.append(parents[way[-1]])
    return tuple(way)


def _unpaired(
    pair: StereoTopics,
    ids: tuple[str, ...],
    numbers: list[tuple[int, int]],
    stamps: tuple[Int64, Int64],
    tolerance_s: float,
) -> tuple[tuple[str, PseudolidarError], ...]:
    """Pictures without a partner, by eye and number, with how far the nearest is."""
    refused: list[tuple[str, PseudolidarError]] = []
    taken = {number for number, _ in numbers}, {number for _, number in numbers}
    for side, eye, other in ((0, pair.left, pair.right), (1, pair.right, pair.left)):
        own, others = stamps[side], stamps[1 - side]
        near = nearest(own, others) if len(others) else np.full(len(own), -1)
        for number in sorted(set(range(len(own))) - taken[side]):
            gap = "there is none"
            if len(others):
                away_ms = abs(int(others[near[number]]) - int(own[number])) / NS_PER_MS
                gap = f"the nearest is {away_ms:.3g} ms away, or belongs to another"
            name = f"{number:0{ID_DIGITS}d}-right" if side else ids[number]
            error = PairMismatch(
                f"no picture of {other.topic.name} for message {number} of {eye.topic.name}",
                want=f"one within {tolerance_s * 1000:g} ms; {gap}",
                fix="If the eyes are not triggered together, widen --source.tolerance-s.",
                where=f"frame {name}",
            )
            refused.append((name, error))
    return tuple(refused)
