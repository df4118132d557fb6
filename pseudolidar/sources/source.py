"""What every opened source is: a sequence of rectified pairs, cheap to pickle, loaded by index."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Protocol

from pseudolidar.errors import PseudolidarError
from pseudolidar.structures.camera import StereoRig
from pseudolidar.structures.frame import StereoFrame


@dataclass(frozen=True)
class SourceSummary:
    """What a source is, for people.

    Args:
        kind: name as taken by `--source`, such as `kitti-raw`.
        path: what the user gave.
        line: what it was recognised as, one line.
        absent: what this layout can have and the source has not ("labels", "velodyne of 10 of 11").
        notes: what was assumed ("time: synthetic", the pairing rule).
    """

    kind: str
    path: str
    line: str
    absent: tuple[str, ...] = ()
    notes: tuple[str, ...] = ()


class FrameSource(Protocol):
    """An opened source. Opening lists and checks; pixels are read by `load` alone."""

    @property
    def summary(self) -> SourceSummary:
        """What it is."""

    @property
    def rig(self) -> StereoRig:
        """Rig of the first frame."""

    @property
    def ids(self) -> tuple[str, ...]:
        """Unique names of the frames in order; they name output files."""

    @property
    def timestamps_ns(self) -> tuple[int, ...]:
        """Times of the frames."""

    @property
    def refused(self) -> tuple[tuple[str, PseudolidarError], ...]:
        """Frames found unusable when the source was opened (one eye missing), with the reason."""

    def load(self, index: int) -> StereoFrame:
        """Read and decode frame `index`; pure, callable from any thread or process."""


class SourceSettings(Protocol):
    """Settings of a source; a frozen, picklable dataclass that imports nothing heavy."""

    def open(self) -> FrameSource:
        """List the frames and read the calibration."""
