"""The clouds of a recording as frames."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass, field, replace
from typing import ClassVar

from pseudolidar.errors import PseudolidarError, RecordingError, UsageError
from pseudolidar.formats.mcap.channels import FRAME, OBSTACLE_EDGES, SCAN, STEREO_POINTS
from pseudolidar.formats.mcap.columns import LOW_BITS, joined
from pseudolidar.formats.points.columns import DTYPE_LINE, SHAPE_LINE, parse_notes, restored
from pseudolidar.formats.recordings.messages import CloudMessage, Mark
from pseudolidar.sources.names import safe_id
from pseudolidar.sources.recording.frames import RecordedFrames
from pseudolidar.sources.recording.topics import HEAD_BYTES, Topic, Topics
from pseudolidar.sources.source import SourceSummary
from pseudolidar.structures.cloud import PointCloud
from pseudolidar.structures.recorded import RecordedCloud

ID_DIGITS = 6
# Behind the name of a frame that comes again; no safe name has it at that place otherwise.
AGAIN = "~again"


@dataclass(frozen=True, eq=False)
class RecordedClouds:
    """The clouds of one topic of a recording; see `FrameSequence`.

    Args:
        summary: what it is.
        ids: names of the frames that the recording marks, else numbers of the clouds.
        timestamps_ns: stamps of the clouds.
        topics: the recording.
        frames: its transforms.
        clouds: the topic.
        marks: number of the mark of each frame, -1 for none.
        mark_topic: topic of the marks, None in recordings of others.
    """

    summary: SourceSummary
    ids: tuple[str, ...]
    timestamps_ns: tuple[int, ...]
    topics: Topics = field(repr=False)
    frames: RecordedFrames = field(repr=False)
    clouds: Topic = field(repr=False)
    marks: tuple[int, ...] = field(default=(), repr=False)
    mark_topic: Topic | None = field(default=None, repr=False)
    refused: tuple[tuple[str, PseudolidarError], ...] = ()
    rig: ClassVar[None] = None
    yields: ClassVar = RecordedCloud

    def noted(self, note: str) -> RecordedClouds:
        """The same with a further note."""
        return replace(self, summary=replace(self.summary, notes=(*self.summary.notes, note)))

    def load(self, index: int) -> RecordedCloud:
        """Read and unpack a cloud, with the transforms of its moment.

        Raises:
            RecordingError: damaged; says where.
            PointFileCorrupt, PointFileTruncated, PointFileField, LimitError: the cloud contradicts
                itself, or is larger than the caps.
        """
        stamp_ns, filed_ns = self.timestamps_ns[index], int(self.clouds.times_ns[index])
        places = [self.clouds.place(index), *self.frames.places(stamp_ns, filed_ns)]
        if self.mark_topic is not None and self.marks[index] >= 0:
            places.append(self.mark_topic.place(self.marks[index]))
        message, *others = self.topics.read(places)
        if not isinstance(message, CloudMessage):
            raise RecordingError("a message that is no cloud", want="one", where=self.clouds.name)
        cloud = message.cloud
        for mark in (other for other in others if isinstance(other, Mark)):
            self._check_mark(mark, index)
            if self.clouds.name != SCAN:  # the mark tells of the cloud beside it
                cloud = as_noted(cloud, mark.detail.splitlines())
        if not cloud.timestamp_ns:
            cloud = replace(cloud, timestamp_ns=stamp_ns)
        tree = self.frames.tree(others, stamp_ns)
        return RecordedCloud(cloud, self.ids[index], index, stamp_ns, tree, notes=message.notes)

    def _check_mark(self, mark: Mark, index: int) -> None:
        """The name was taken from bytes that were not checked; these are."""
        if safe_id(mark.name) != self.ids[index].partition(AGAIN)[0]:
            raise RecordingError(
                f"a frame {mark.name[:40]!r} that was called {self.ids[index]!r} before",
                want="an undamaged recording",
                where=self.clouds.name,
            )


def as_noted(cloud: PointCloud, lines: list[str]) -> PointCloud:
    """A cloud with the dtypes and the rows and columns that the mark of its frame notes."""
    notes = parse_notes(line for line in lines if line.startswith((DTYPE_LINE, SHAPE_LINE)))
    extra = dict(cloud.extra)
    for name in notes.dtypes.keys() & extra.keys():
        low, dtype = extra.get(name + LOW_BITS), notes.dtypes[name]
        whole = None if low is None else joined(extra[name], low, dtype)
        if whole is not None:
            del extra[name + LOW_BITS]
        extra[name] = restored(extra[name], dtype) if whole is None else whole
    if notes.shape is not None and notes.shape[0] * notes.shape[1] == len(cloud):
        cloud = replace(cloud, shape=notes.shape)
    return replace(cloud, extra=extra)


def open_clouds(
    topics: Topics, frames: RecordedFrames, name: str | None, summary: SourceSummary
) -> RecordedClouds:
    """The clouds of the topic `name`, or of the one that is taken without being told.

    Args:
        topics: the recording.
        frames: its transforms.
        name: topic of the clouds, None for the stereo clouds of this package, else the topic with
            the most clouds.
        summary: what the recording is; the line about the clouds is added.

    Raises:
        UsageError: no such topic.
    """
    clouds = _chosen(topics, name)
    stamps = tuple(topics.stamps_ns(clouds).tolist())
    marked = marked_ids(topics, clouds)
    others = [topic.name for topic in topics.of_kind("cloud") if topic is not clouds]
    also = (f"not taken, other clouds: {', '.join(others)} (--topic)",) if others else ()
    line = f"{summary.line}: {len(clouds)} clouds of {clouds.name}"
    summary = replace(summary, line=line, notes=(*summary.notes, *also, *order_note(stamps)))
    return RecordedClouds(
        summary,
        marked.ids,
        stamps,
        topics,
        frames,
        clouds,
        marked.marks,
        marked.topic,
    )


@dataclass(frozen=True, eq=False)
class MarkedIds:
    """Names of frames, and the marks that they come from.

    Args:
        ids: unique and safe; where no mark is, the number of the message.
        topic: topic of the marks, None in recordings of others.
        marks: by message, the number of its mark, -1 for none.
    """

    ids: tuple[str, ...]
    topic: Topic | None = None
    marks: tuple[int, ...] = ()


def marked_ids(topics: Topics, topic: Topic) -> MarkedIds:
    """Names for the messages of a topic: of the marks filed under the same times."""
    ids = tuple(f"{number:0{ID_DIGITS}d}" for number in range(len(topic)))
    marks = topics.named(FRAME, "mark") if topics.own else None
    if marks is None:
        return MarkedIds(ids)
    by_time = {int(time): number for number, time in enumerate(marks.times_ns)}
    numbers = tuple(by_time.get(int(time), -1) for time in topic.times_ns)
    names = _marked_names(topics, marks)
    named = (
        safe_id(names[mark]) if mark >= 0 and names[mark] else own
        for mark, own in zip(numbers, ids, strict=True)
    )
    return MarkedIds(_unique(named), marks, numbers)


def _chosen(topics: Topics, name: str | None) -> Topic:
    known = topics.of_kind("cloud")
    if name is not None:
        found = topics.named(name, "cloud")
        if found is None:
            raise UsageError(
                f"no topic of clouds {name!r}",
                want=f"one of {', '.join(topic.name for topic in known)}",
                where="topic",
            )
        return found
    if topics.own:
        stereo = topics.named(STEREO_POINTS, "cloud")
        own = [topic for topic in known if topic.name not in (SCAN, OBSTACLE_EDGES)]
        measured = [topic for topic in known if topic.name != OBSTACLE_EDGES]
        return stereo or (own or measured or known)[0]
    return max(known, key=lambda topic: (len(topic), topic.name))


def _marked_names(topics: Topics, marks: Topic) -> list[str]:
    """Names of the frames by the number of their mark, "" where it cannot be read."""
    names: dict[tuple[int, int], str] = {}
    for channel in sorted(set(marks.channels.tolist())):
        for number, head in enumerate(topics.store.heads(channel, HEAD_BYTES)):
            names[channel, number] = topics.name_in(channel, head)
    return [names.get(marks.place(number), "") for number in range(len(marks))]


def _unique(ids: Iterable[str]) -> tuple[str, ...]:
    """The names, those that come again with a number behind them."""
    seen: dict[str, int] = {}
    found: list[str] = []
    for name in ids:
        seen[name] = seen.get(name, 0) + 1
        found.append(name if seen[name] == 1 else f"{name}{AGAIN}{seen[name]}")
    return tuple(found)


def order_note(stamps: tuple[int, ...]) -> tuple[str, ...]:
    """A note where times do not increase."""
    for index in range(1, len(stamps)):
        if stamps[index] <= stamps[index - 1]:
            return (f"time: stamps do not increase at index {index}",)
    return ()
