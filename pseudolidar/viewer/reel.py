"""Frames to look at, one after the other, made when they are wanted."""

from __future__ import annotations

import contextlib
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from typing import Protocol

import numpy as np

from pseudolidar.errors import PseudolidarError
from pseudolidar.formats.timestamps import NS_PER_S
from pseudolidar.running.products.converted import Converted
from pseudolidar.running.sighting import Seen
from pseudolidar.sources.known_poses import pose_of
from pseudolidar.sources.recognise import Source
from pseudolidar.sources.source import FrameSequence
from pseudolidar.structures.arrays import Float64
from pseudolidar.structures.recorded import Frame
from pseudolidar.viewer.moment import Moment


class Reel(Protocol):
    """A sequence that can be looked at."""

    @property
    def name(self) -> str:
        """What it is, in one line."""

    @property
    def ids(self) -> Sequence[str]:
        """Names of the frames in order."""

    @property
    def times_s(self) -> Sequence[float]:
        """When each was taken, since the first."""

    def load(self, index: int) -> Moment:
        """Make a frame ready to be drawn; callable from any thread. Faults are told in it."""


@dataclass(frozen=True)
class NoFrames:
    """Nothing that changes: one empty frame.

    Args:
        name: what is said of it.
    """

    name: str = ""
    ids: Sequence[str] = ("",)
    times_s: Sequence[float] = (0.0,)

    def load(self, index: int) -> Moment:
        """The empty frame."""
        return Moment("", index)


@dataclass(frozen=True)
class SourceReel:
    """The frames of a source, made into clouds as `convert` does.

    Args:
        source: opened.
        convert: a frame to what is made of it.
        sighted: a frame to what things in it are measured by; None where they cannot be.
        origin: what the source was opened of, to open it again otherwise; None where it is only
            looked at.
    """

    source: FrameSequence[Frame]
    convert: Callable[[Frame], Converted]
    sighted: Callable[[Frame], Seen] | None = None
    origin: Source | None = None

    @property
    def name(self) -> str:
        """What the source is."""
        return self.source.summary.line

    @property
    def ids(self) -> Sequence[str]:
        """Names of the frames."""
        return self.source.ids

    @property
    def times_s(self) -> Sequence[float]:
        """When each was taken, since the first."""
        times_ns = self.source.timestamps_ns
        return [(time_ns - times_ns[0]) / NS_PER_S for time_ns in times_ns]

    def poses(self) -> Float64 | None:
        """(N, 4, 4) `T_map_base_link` of the frames, NaN where it is not known.

        None where frames must be loaded to know.
        """
        pose_at = pose_of(self.source)
        if pose_at is None:
            return None
        poses = np.full((len(self.ids), 4, 4), np.nan)
        for index in range(len(poses)):
            with contextlib.suppress(PseudolidarError):  # told when that frame is shown
                pose = pose_at(index)
                poses[index] = np.nan if pose is None else pose.matrix
        return poses

    def load(self, index: int) -> Moment:
        """Match and reproject a pair; a frame that cannot be used says why."""
        try:
            moment = Moment.of(self.convert(self.source.load(index)))
        except PseudolidarError as error:
            return Moment(self.ids[index], index, fault=str(error))
        return replace(moment, index=index)
