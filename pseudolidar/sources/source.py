"""What every opened source is: a sequence of frames, cheap to pickle, loaded by index."""

from __future__ import annotations

import logging
from collections.abc import Iterator
from dataclasses import dataclass
from typing import Protocol, TypeVar, cast

from pseudolidar.errors import NoClouds, NoPairs, PseudolidarError
from pseudolidar.formats.recordings.message_store import LOST
from pseudolidar.structures.body import BodyFrame
from pseudolidar.structures.camera import StereoRig
from pseudolidar.structures.disparity import DEFAULT_MIN_DEPTH_M
from pseudolidar.structures.frame import RawPair, StereoFrame
from pseudolidar.structures.recorded import DepthFrame, HeldFrame, RecordedCloud

# Notes about optional data of a frame that has no pictures say so.
UNPAIRED = " without a pair of pictures: "

_log = logging.getLogger(__name__)

AnyFrame = TypeVar("AnyFrame", bound=HeldFrame, covariant=True)

KIND_NAMES: dict[type[HeldFrame], str] = {
    StereoFrame: "pairs of pictures",
    RawPair: "unrectified pairs of pictures",
    DepthFrame: "pictures with depth",
    RecordedCloud: "point clouds",
    BodyFrame: "pairs of several rigs on one body",
}
NO_PAIRS_FIXES: dict[type[HeldFrame], str] = {
    RawPair: "Rectify them first: `pseudolidar rectify SOURCE OUT --rig rig.json`.",
    BodyFrame: "This takes one pair at a time: give its folder, which finds its rig in the body's; "
    "of wide lenses leave --rectify.views out.",
}


@dataclass(frozen=True)
class SourceSummary:
    """What a source is, for people.

    Args:
        kind: name as taken by `--source`, such as `kitti-raw`.
        path: what the user gave.
        line: what it was recognised as, one line.
        absent: what this layout can have and the source has not ("labels", "velodyne of 10 of 11").
        notes: what was assumed ("time: synthetic", the pairing rule).
        camera: calibration in words where there is no rig; the same words, the same results.
        nearest_m: depth Z of the nearest thing that the data set says it holds, where it does.
        turning_scans: whether scans and frames say when points were taken and how the rig moved.
    """

    kind: str
    path: str
    line: str
    absent: tuple[str, ...] = ()
    notes: tuple[str, ...] = ()
    camera: str = ""
    nearest_m: float | None = None
    turning_scans: bool = False

    @property
    def name(self) -> str:
        """What it is without how much of it, for the origin of what was made of it."""
        return self.line.partition(": ")[0]

    @property
    def lost(self) -> tuple[str, ...]:
        """Which of the notes tell of frames, or parts of them, that a damaged file held."""
        return tuple(note for note in self.notes if note.startswith(LOST))

    @property
    def unpaired(self) -> tuple[str, ...]:
        """Which of the notes tell of labels that belong to no pair of pictures."""
        return tuple(note for note in self.notes if note.startswith(f"labels{UNPAIRED}"))


class FrameSequence(Protocol[AnyFrame]):
    """An opened source. Opening lists and checks; pixels and points are read by `load` alone."""

    @property
    def summary(self) -> SourceSummary:
        """What it is."""

    @property
    def yields(self) -> type[AnyFrame]:
        """What its frames are."""

    @property
    def rig(self) -> StereoRig | None:
        """Rig of the first frame, where the source has cameras that are calibrated as one."""

    @property
    def ids(self) -> tuple[str, ...]:
        """Unique names of the frames in order; they name output files."""

    @property
    def timestamps_ns(self) -> tuple[int, ...]:
        """Times of the frames."""

    @property
    def refused(self) -> tuple[tuple[str, PseudolidarError], ...]:
        """Frames found unusable when the source was opened (one eye missing), with the reason."""

    def load(self, index: int) -> AnyFrame:
        """Read and decode frame `index`; pure, callable from any thread or process."""


class FrameSource(FrameSequence[StereoFrame], Protocol):
    """An opened source of rectified pairs."""

    @property
    def rig(self) -> StereoRig:
        """Rig of the first frame."""


class SourceSettings(Protocol):
    """Settings of a source; a frozen, picklable dataclass that imports nothing heavy."""

    def open(self) -> FrameSequence[HeldFrame]:
        """List the frames and read the calibration."""


def nearest_depth_m(wanted_m: float | None, source: FrameSequence[HeldFrame]) -> float:
    """Nearest depth that must be found, m: what is wanted, else what the source says, else 3.

    A source says what its data set states of its scenes, else how near its rig was calibrated.
    """
    quality = None if source.rig is None else source.rig.quality
    calibrated_m = None if quality is None else quality.searched_from_m
    for stated_m in (wanted_m, source.summary.nearest_m, calibrated_m):
        if stated_m is not None:
            return stated_m
    return DEFAULT_MIN_DEPTH_M


def tell(source: FrameSequence[HeldFrame]) -> None:
    """Log what a source is, what was assumed, and what its layout could have and it has not."""
    for line in (source.summary.line, *source.summary.notes):
        _log.info(line)
    for name in source.summary.absent:
        _log.info("absent: %s", name)


def first_middle_last(source: FrameSource) -> Iterator[StereoFrame]:
    """Up to three frames that show what all are like; those that cannot be read are left out."""
    yield from evenly_loaded(source, most=3)


def pairs_of(source: FrameSequence[HeldFrame]) -> FrameSource:
    """The source, if its frames are rectified pairs.

    Raises:
        NoPairs: they are something else.
    """
    if source.yields is not StereoFrame:
        raise NoPairs(
            f"a source of {KIND_NAMES[source.yields]}: {source.summary.line}",
            want=KIND_NAMES[StereoFrame],
            fix=NO_PAIRS_FIXES.get(source.yields, "This needs pictures of two eyes."),
            path=source.summary.path,
        )
    return cast("FrameSource", source)


def clouds_of(source: FrameSequence[HeldFrame]) -> FrameSequence[RecordedCloud]:
    """The source, if its frames are ready-made clouds.

    Raises:
        NoClouds: they are something else.
    """
    if source.yields is not RecordedCloud:
        raise NoClouds(
            f"a source of {KIND_NAMES[source.yields]}",
            want=KIND_NAMES[RecordedCloud],
            fix="Make clouds of it first, `pseudolidar convert SOURCE OUT --to mcap`, and take the "
            "recording in OUT: it has them with their poses.",
            path=source.summary.path,
        )
    return cast("FrameSequence[RecordedCloud]", source)


def evenly_placed(frames: int, *, most: int) -> tuple[int, ...]:
    """Up to `most` positions from the first of `frames` to the last."""
    steps = max(1, min(frames, most) - 1)
    return tuple(sorted({(frames - 1) * step // steps for step in range(min(frames, most))}))


def evenly_loaded(source: FrameSequence[AnyFrame], *, most: int) -> Iterator[AnyFrame]:
    """Up to `most` frames from the first to the last; those that cannot be read are left out."""
    for index in evenly_placed(len(source.ids), most=most):
        try:
            yield source.load(index)
        except PseudolidarError:
            continue  # refused in its turn
