"""Checks of the messages in a recording: stamps, transforms, clouds, images."""

from __future__ import annotations

from collections.abc import Callable, Iterable
from dataclasses import dataclass

from pseudolidar.errors import RecordingError
from pseudolidar.formats.mcap.facts import (
    CameraNumbers,
    CloudLayout,
    Edge,
    EncodedImage,
    Fact,
    ImageLayout,
    Rotation,
    Stamp,
    Used,
)
from pseudolidar.formats.mcap.records import RawMessage

# A quaternion stored as float64 is a unit to rounding; viewers normalise, but refuse zero.
UNIT_TOLERANCE = 1e-6

# Bytes of a pixel by encoding of a raw picture.
BYTES_OF_ENCODING = {
    "mono8": 1,
    "8UC1": 1,
    "mono16": 2,
    "16UC1": 2,
    "32FC1": 4,
    "rgb8": 3,
    "bgr8": 3,
    "8UC3": 3,
    "rgba8": 4,
    "bgra8": 4,
}
# First and last bytes of encoded images.
IMAGE_ENDS = {
    "jpeg": (b"\xff\xd8\xff", b"\xff\xd9"),
    "png": (b"\x89PNG\r\n\x1a\n", b"IEND\xaeB`\x82"),
}


@dataclass
class ChannelCheck:
    """A channel while its messages are checked.

    Args:
        topic: its topic.
        schema: name of its schema.
        facts: what is to be checked of a serialised message, or None where it cannot be read here.
        log_time_ns: time of its last message.
        stamp_ns: stamp within its last message.
    """

    topic: str
    schema: str
    facts: Callable[[bytes], Iterable[Fact]] | None
    log_time_ns: int = 0
    stamp_ns: int = 0


class MessageChecks:
    """Checks messages in the order of the file, and the frames that they name at its end."""

    def __init__(self) -> None:
        self.start_ns = self.end_ns = 0
        # Parent of each child, and where each frame is used outside of transforms.
        self._parents: dict[str, str] = {}
        self._used: dict[str, str] = {}

    def check(self, channel: ChannelCheck, message: RawMessage) -> None:
        """Check one message.

        Raises:
            RecordingError: names the topic.
        """
        time_ns = message.log_time_ns
        if time_ns <= 0 or time_ns < channel.log_time_ns:
            raise _wrong(channel, f"time {time_ns} ns after {channel.log_time_ns} ns")
        channel.log_time_ns = time_ns
        self.start_ns = min(self.start_ns, time_ns) if self.end_ns else time_ns
        self.end_ns = max(self.end_ns, time_ns)
        if channel.facts is None:
            return
        try:
            facts = tuple(channel.facts(bytes(message.data)))
        except (AttributeError, TypeError) as error:
            # The class comes from the file: it may have other fields than its name promises.
            raise _wrong(channel, f"a schema that is not that of its name ({error})") from error
        except Exception as error:  # whatever a decoder says of bytes that are no message
            raise _wrong(channel, f"a message that is no {channel.schema} ({error})") from error
        for fact in facts:
            self._check_fact(channel, fact)

    def finish(self) -> None:
        """Check that transforms form one tree that has every frame in use.

        Raises:
            RecordingError: names the frames.
        """
        if not self._parents:
            return
        roots = sorted({self._root(frame) for frame in self._parents})
        if len(roots) != 1:
            raise RecordingError(f"transforms with roots {', '.join(roots)}", want="one root")
        for frame, topic in self._used.items():
            if frame not in self._parents and frame not in roots:
                known = ", ".join(sorted({*self._parents, *roots}))
                raise RecordingError(
                    f"frame {frame!r} that no transform names",
                    want=f"one of {known}",
                    where=topic,
                )

    def _root(self, frame: str) -> str:
        seen = [frame]
        while seen[-1] in self._parents:
            seen.append(self._parents[seen[-1]])
            if seen[-1] in seen[:-1]:
                raise RecordingError(f"transforms in a circle: {' > '.join(seen)}", want="a tree")
        return seen[-1]

    def _check_fact(self, channel: ChannelCheck, fact: Fact) -> None:
        match fact:
            case Stamp(stamp_ns):
                if stamp_ns <= 0 or stamp_ns < channel.stamp_ns:
                    raise _wrong(channel, f"stamp {stamp_ns} ns after {channel.stamp_ns} ns")
                channel.stamp_ns = stamp_ns
            case Used(frame):
                self._used.setdefault(frame, channel.topic)
            case Edge(parent, child):
                if self._parents.setdefault(child, parent) != parent:
                    both = f"{parent!r} and {self._parents[child]!r}"
                    raise _wrong(channel, f"frame {child!r} with the parents {both}")
            case Rotation(norm):
                if not abs(norm - 1) <= UNIT_TOLERANCE:
                    raise _wrong(channel, f"a quaternion of norm {norm:g}")
            case CloudLayout():
                _check_cloud(channel, fact)
            case ImageLayout():
                _check_raw_image(channel, fact)
            case EncodedImage():
                _check_encoded_image(channel, fact)
            case CameraNumbers():
                _check_camera(channel, fact)


def _check_cloud(channel: ChannelCheck, cloud: CloudLayout) -> None:
    end = 0
    for name, offset, size in cloud.fields:
        if size is None:
            raise _wrong(channel, f"field {name!r} without a type")
        if offset < end or offset + size > cloud.stride:
            raise _wrong(channel, f"field {name!r} at byte {offset} of the point")
        end = offset + size
    names = [name for name, _, _ in cloud.fields]
    if len(set(names)) != len(names) or not {"x", "y", "z"} <= set(names):
        raise _wrong(channel, f"fields {', '.join(names)}")
    if cloud.nbytes % cloud.stride:
        raise _wrong(channel, f"{cloud.nbytes} bytes of points of {cloud.stride} bytes")


def _check_raw_image(channel: ChannelCheck, image: ImageLayout) -> None:
    pixel = BYTES_OF_ENCODING.get(image.encoding)
    if pixel is None:
        raise _wrong(channel, f"encoding {image.encoding!r}")
    if image.step < image.width * pixel or image.nbytes != image.step * image.height:
        size = f"{image.width}x{image.height} pixels, {image.step} bytes a row"
        raise _wrong(channel, f"{image.nbytes} bytes for {size}")


def _check_encoded_image(channel: ChannelCheck, image: EncodedImage) -> None:
    if image.kind not in IMAGE_ENDS:
        return
    first, last = IMAGE_ENDS[image.kind]
    if not (image.data.startswith(first) and image.data.endswith(last)):
        raise _wrong(channel, f"{len(image.data)} bytes that are no whole {image.kind}")


def _check_camera(channel: ChannelCheck, camera: CameraNumbers) -> None:
    sizes = len(camera.K), len(camera.R), len(camera.P)
    if sizes != (9, 9, 12) or not camera.K[0] > 0:
        raise _wrong(channel, f"K, R, P of {sizes} numbers, focal length {camera.K[:1]}")


def _wrong(channel: ChannelCheck, got: str) -> RecordingError:
    return RecordingError(
        got,
        want=f"a sound {channel.schema}",
        where=f"{channel.topic} at {channel.log_time_ns} ns",
    )
