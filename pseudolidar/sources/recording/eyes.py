"""The topics of pictures in a recording, each with the camera that took them."""

from __future__ import annotations

import re
from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from pseudolidar.formats.recordings.messages import CameraInfo, EncodedPicture, RawPicture
from pseudolidar.formats.recordings.raw_picture import is_depth
from pseudolidar.sources.recording.topics import Topic, Topics

# Transports of ROS append these to the topic of the raw picture.
_TRANSPORT = re.compile(r"/(compressed|compressedDepth|raw|ffmpeg|theora)$")
_RECTIFIED = re.compile(r"rect(?:ified)?(?![a-z])")
# Focal lengths and rows of projections that belong to one rectified pair agree to this, px.
SAME_PX = 1e-3
# Rotations that are none, up to this.
SAME_DIRECTION = 1e-3


@dataclass(frozen=True, eq=False)
class Eye:
    """A topic of pictures with the camera that took them.

    Args:
        topic: its pictures.
        camera: calibration, None where none belongs to it.
        frame: optical frame.
        encoding: of its first picture.
    """

    topic: Topic
    camera: CameraInfo | None
    frame: str
    encoding: str

    @property
    def name(self) -> str:
        """Its topic without the transport."""
        return _TRANSPORT.sub("", self.topic.name)

    @property
    def is_rectified(self) -> bool:
        """Whether rows are aligned: by the name, or because there was nothing to rectify."""
        camera = self.camera
        named = _RECTIFIED.search(self.name.rpartition("/")[2]) is not None
        return named or (camera is not None and not camera.D.any() and _unrotated(camera))

    @property
    def shift_m(self) -> float:
        """`P[0, 3] / f`: minus the distance of the camera right of the pair's own frame."""
        assert self.camera is not None
        return float(self.camera.P[0, 3] / self.camera.P[0, 0])


def eyes_of(topics: Topics) -> tuple[tuple[Eye, ...], tuple[Eye, ...]]:
    """The topics of pictures, and those of depths."""
    cameras = {topic.name: found for topic, found in _cameras(topics)}
    pictures: list[Eye] = []
    depths: list[Eye] = []
    for topic in topics.of_kind("picture"):
        first = topics.one(topic, 0, EncodedPicture) or topics.one(topic, 0, RawPicture)
        if first is None:
            continue
        raw = isinstance(first, RawPicture)
        encoding = first.encoding if raw else first.format  # type: ignore[union-attr]
        eye = Eye(topic, _camera_of(topic, first.frame, cameras), first.frame, encoding)
        (depths if is_depth(first) or "depth" in eye.name else pictures).append(eye)
    return tuple(pictures), tuple(depths)


def _cameras(topics: Topics) -> Iterator[tuple[Topic, CameraInfo]]:
    for topic in topics.of_kind("camera"):
        info = topics.one(topic, 0, CameraInfo)
        if info is not None and info.is_calibrated:
            yield topic, info


def _camera_of(topic: Topic, frame: str, cameras: dict[str, CameraInfo]) -> CameraInfo | None:
    """The calibration beside a topic of pictures, else the only one of the same frame."""
    place = _TRANSPORT.sub("", topic.name).rpartition("/")[0]
    beside = [info for name, info in cameras.items() if name.rpartition("/")[0] == place]
    if len(beside) > 1:
        beside = [info for info in beside if info.frame == frame]
    same = beside or [info for info in cameras.values() if info.frame == frame and frame]
    return same[0] if len(same) == 1 else None


def _unrotated(camera: CameraInfo) -> bool:
    """Whether rectification left the picture as it is."""
    same = np.abs(camera.P[:, :3] - camera.K).max() <= SAME_PX or not camera.K.any()
    return bool(
        same and (np.abs(camera.R - np.eye(3)).max() < SAME_DIRECTION or not camera.R.any())
    )
