"""Pictures with depth of a recording as frames: depth cameras."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from typing import ClassVar

import numpy as np

from pseudolidar.errors import NotRectified, PseudolidarError, RecordingError
from pseudolidar.formats.recordings.messages import EncodedPicture, RawPicture
from pseudolidar.formats.recordings.raw_picture import depth_values_m, picture_pixels
from pseudolidar.formats.timestamps import NS_PER_S
from pseudolidar.sources.recording.clouds import ID_DIGITS, order_note
from pseudolidar.sources.recording.eyes import Eye
from pseudolidar.sources.recording.stereo import LEFT
from pseudolidar.sources.recording.topics import Topics, nearest_pairs
from pseudolidar.sources.source import SourceSummary
from pseudolidar.structures.camera import Camera
from pseudolidar.structures.disparity import DepthMap
from pseudolidar.structures.recorded import DepthFrame

# Depth and picture of one camera, not triggered together, are this far apart at 30 Hz.
TOLERANCE_NS = NS_PER_S // 30


@dataclass(frozen=True, eq=False)
class RecordedDepth:
    """The depths of a recording with the pictures that show the same pixels.

    Args:
        summary: what it is.
        ids: numbers of the depths in their topic.
        timestamps_ns: stamps of the depths.
        refused: none; depths without a picture are counted in the summary.
        topics: the recording.
        depth: topic of the depths.
        picture: topic of the pictures.
        camera: of both.
        numbers: numbers of the depth and the picture of each frame.
    """

    summary: SourceSummary
    ids: tuple[str, ...]
    timestamps_ns: tuple[int, ...]
    topics: Topics = field(repr=False)
    depth: Eye = field(repr=False)
    picture: Eye = field(repr=False)
    camera: Camera = field(repr=False)
    numbers: tuple[tuple[int, int], ...] = field(repr=False)
    refused: tuple[tuple[str, PseudolidarError], ...] = ()
    rig: ClassVar[None] = None
    yields: ClassVar = DepthFrame

    def load(self, index: int) -> DepthFrame:
        """Read and decode a depth and its picture.

        Raises:
            RecordingError: damaged; says where.
            ImageUnreadable, ImageTruncated, ImageFormat, LimitError: one of them cannot be decoded.
            StructureError: they differ in size.
        """
        number, picture_number = self.numbers[index]
        places = [self.depth.topic.place(number), self.picture.topic.place(picture_number)]
        depth, picture = self.topics.read(places)
        if not isinstance(depth, EncodedPicture | RawPicture) or not isinstance(
            picture, EncodedPicture | RawPicture
        ):
            raise RecordingError("messages that are no pictures", want="depth and picture")
        limits = self.topics.limits
        image = picture_pixels(picture, self.picture.topic.name, limits=limits)
        values = depth_values_m(depth, self.depth.topic.name, limits=limits)
        try:
            return DepthFrame(
                image.pixels,
                DepthMap(values),
                self.camera,
                self.ids[index],
                index,
                self.timestamps_ns[index],
                notes=image.notes,
            )
        except PseudolidarError as error:
            raise error.located(self.depth.topic.name) from None


def open_depth(
    topics: Topics, depths: Sequence[Eye], pictures: Sequence[Eye], summary: SourceSummary
) -> RecordedDepth | None:
    """The depths that have a calibration and pictures of the same pixels, None without such.

    Raises:
        NotRectified: the only ones are of pictures with lens distortion.
    """
    refused: NotRectified | None = None
    for depth in sorted(depths, key=lambda eye: -len(eye.topic)):
        for picture in pictures:
            info = depth.camera
            same = (
                info is not None
                and picture.camera is not None
                and (
                    (info.width_px, info.height_px)
                    == (picture.camera.width_px, picture.camera.height_px)
                    and depth.frame == picture.frame
                )
            )
            if info is None or not same:
                continue
            if info.D.any() and not depth.is_rectified:
                refused = NotRectified(
                    f"{depth.topic.name} has the lens distortion of its camera",
                    want="depths of rectified pictures (image_rect)",
                )
                continue
            return _opened(topics, depth, picture, summary)
    if refused is not None:
        raise refused
    return None


def _opened(topics: Topics, depth: Eye, picture: Eye, summary: SourceSummary) -> RecordedDepth:
    assert depth.camera is not None
    info = depth.camera
    stamps_ns = topics.stamps_ns(depth.topic)
    numbers = nearest_pairs(stamps_ns, topics.stamps_ns(picture.topic), TOLERANCE_NS)
    K = np.ascontiguousarray(info.P[:, :3])
    alone = len(depth.topic) - len(numbers)
    stamps = tuple(int(stamps_ns[number]) for number, _ in numbers)
    notes = (
        f"depth: {depth.topic.name}, pictures: {picture.topic.name}",
        *((f"{alone} depths without a picture left out",) if alone else ()),
        *order_note(stamps),
    )
    return RecordedDepth(
        summary=replace(
            summary,
            line=f"{summary.line}: {len(numbers)} pictures with depth",
            notes=(*summary.notes, *notes),
        ),
        ids=tuple(f"{number:0{ID_DIGITS}d}" for number, _ in numbers),
        timestamps_ns=stamps,
        topics=topics,
        depth=depth,
        picture=picture,
        camera=Camera(K, info.width_px, info.height_px, frame=LEFT),
        numbers=tuple(numbers),
    )
