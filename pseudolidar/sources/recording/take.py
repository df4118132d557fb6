"""What is taken of a recording: its stereo pairs, its clouds, or its pictures with depth."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

from pseudolidar.errors import (
    CalibrationMissing,
    NotRectified,
    PseudolidarError,
    SourceEmpty,
    UsageError,
)
from pseudolidar.formats.recordings.kinds import recording_kind
from pseudolidar.formats.recordings.messages import EncodedPicture, RawPicture
from pseudolidar.formats.recordings.raw_picture import picture_pixels
from pseudolidar.formats.recordings.recording_store import open_store
from pseudolidar.formats.rigs.rig_file import read_any_rig
from pseudolidar.formats.rigs.rig_json import parse_rig
from pseudolidar.sources.recording.clouds import open_clouds
from pseudolidar.sources.recording.depth import open_depth
from pseudolidar.sources.recording.eyes import Eye, eyes_of
from pseudolidar.sources.recording.frames import RecordedFrames
from pseudolidar.sources.recording.pairs import open_pairs
from pseudolidar.sources.recording.recording import Recording
from pseudolidar.sources.recording.stereo import StereoTopics, find_pair, given_eyes
from pseudolidar.sources.recording.topics import Topic, Topics
from pseudolidar.sources.source import FrameSequence, SourceSummary
from pseudolidar.structures.pose import Pose
from pseudolidar.structures.recorded import HeldFrame

# What recordings of this package carry their rig in.
CALIBRATION = "calibration.json"
# Topics that are listed in an error.
MOST_LISTED = 12


def open_recording(settings: Recording) -> FrameSequence[HeldFrame]:
    """What the settings ask for, of the recording that they name; see `Recording`.

    Raises:
        RecordingError, SourceEmpty, NotRectified, CalibrationMissing, UsageError: see
            `Recording.open`.
    """
    topics = Topics.of(open_store(Path(settings.path), limits=settings.limits), settings.limits)
    try:
        return _taken(settings, topics, RecordedFrames.of(topics))
    except PseudolidarError as error:
        raise error.located(settings.path) from error.__cause__


def _taken(settings: Recording, topics: Topics, frames: RecordedFrames) -> FrameSequence[HeldFrame]:
    """The pairs, the clouds or the depths, by what was asked for and what there is."""
    wanted = settings.take == "pairs" or settings.topics is not None or settings.rig is not None
    # A recording of ours is taken for its clouds; pictures that were split off have none.
    made = topics.own and bool(topics.of_kind("cloud"))
    tried = settings.take == "auto" and settings.topic is None and not made
    summary, refused = _summary(settings.path, topics), None
    if wanted or tried:
        try:
            pair, tree = _pair(settings, topics, frames)
        except (NotRectified, CalibrationMissing) as error:
            if wanted or not (topics.of_kind("cloud") or eyes_of(topics)[1]):
                raise
            pair, refused = None, f"pairs not taken: {error.got}"
        if pair is not None:
            return open_pairs(
                topics, frames, pair, summary, tolerance_s=settings.tolerance_s, first_tree=tree
            )
    if settings.take == "depth" or (tried and not topics.of_kind("cloud")):
        pictures, depths = eyes_of(topics)
        found = open_depth(topics, depths, pictures, summary)
        if found is not None:
            return found
    if wanted or settings.take == "depth" or not topics.of_kind("cloud"):
        raise _nothing(topics, wanted=wanted)
    clouds = open_clouds(topics, frames, settings.topic, summary)
    return clouds if refused is None else clouds.noted(refused)


def _pair(
    settings: Recording, topics: Topics, frames: RecordedFrames
) -> tuple[StereoTopics | None, tuple[Pose, ...]]:
    """The topics of the eyes, and the transforms at the beginning."""
    pictures, _ = eyes_of(topics)
    names = None if settings.topics is None else _two_names(settings.topics)
    tree = _tree(topics, frames, pictures[0].topic) if pictures else ()
    if settings.rig is not None:
        return _with_given_rig(settings, topics, given_eyes(pictures, names)), tree
    pair = find_pair(topics, pictures, tree, names, settings.pictures)
    text = topics.store.attachment(CALIBRATION) if topics.own and pair is not None else b""
    if pair is not None and text:
        # All of the rig: the projections lack a disparity correction and the last digits.
        rig = parse_rig(text.decode("utf-8", "replace"), Path(settings.path) / CALIBRATION)
        pair = replace(pair, rig=rig)
    return pair, tree


def _with_given_rig(
    settings: Recording, topics: Topics, eyes: tuple[Eye, Eye] | None
) -> StereoTopics | None:
    """The eyes with the rig that the user gives."""
    if eyes is None:
        return None
    (first,) = topics.read([eyes[0].topic.place(0)])
    if not isinstance(first, EncodedPicture | RawPicture):
        return None
    height, width = picture_pixels(first, eyes[0].name, limits=settings.limits).pixels.shape[:2]
    reading = read_any_rig(
        str(settings.rig), size_px=(width, height), unit=settings.rig_unit, limits=settings.limits
    )
    rig = reading.taken_for(settings.pictures).of_pictures
    if settings.scale_calibration and rig.left.size_px != (width, height):
        rig = rig.scaled_to(width, height)
    rig.check_size(width, height)
    return StereoTopics(*eyes, rig, "rig by --rig")


def _tree(topics: Topics, frames: RecordedFrames, topic: Topic) -> tuple[Pose, ...]:
    """The transforms at the first message of a topic; those that always hold if it is damaged."""
    filed_ns = int(topic.times_ns[0])
    try:
        (first,) = topics.read([topic.place(0)])
        stamp_ns = first.stamp_ns or filed_ns
        return frames.tree(topics.read(frames.places(stamp_ns, filed_ns)), stamp_ns)
    except PseudolidarError:
        return frames.static


def _two_names(text: str) -> tuple[str, str]:
    names = [name.strip() for name in text.split(",")]
    if len(names) != 2 or not all(names):
        raise UsageError(f"topics {text!r}", want="two: LEFT,RIGHT", where="topics")
    return names[0], names[1]


def _summary(path: str, topics: Topics) -> SourceSummary:
    kind = recording_kind(Path(path))
    writer = topics.store.written_by
    skipped = [f"{name}, {why}" for name, why in topics.skipped]
    left_out = (f"topics left out: {'; '.join(skipped)}",) if skipped else ()
    return SourceSummary(
        kind="recording",
        path=path,
        line=kind + (f" written by {writer}" if writer else ""),
        notes=(*topics.store.notes, *left_out),
    )


def _nothing(topics: Topics, *, wanted: bool) -> SourceEmpty:
    """The error of a recording that has not what is wanted: says what it has."""
    present = [f"{topic.name} ({topic.kind}, {len(topic)})" for topic in topics.topics]
    present += [name for name, _ in topics.skipped]
    more = len(present) - MOST_LISTED
    listed = ", ".join(present[:MOST_LISTED]) + (f" and {more} more" if more > 0 else "")
    return SourceEmpty(
        f"a recording with {listed or 'no messages'}",
        want="two topics of rectified pictures with their calibration"
        + ("" if wanted else ", a topic of clouds, or one of depths with their pictures"),
        fix="Name the pictures by --topics LEFT,RIGHT and their rig by --rig." if wanted else "",
    )
