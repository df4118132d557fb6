"""Opened videos of two eyes: a sequence of pairs."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import TYPE_CHECKING

from pseudolidar.errors import PseudolidarError
from pseudolidar.sources.source import SourceSummary
from pseudolidar.sources.video.packing import Packing
from pseudolidar.structures.arrays import Int64
from pseudolidar.structures.camera import StereoRig
from pseudolidar.structures.frame import RawPair, StereoFrame

if TYPE_CHECKING:
    from pseudolidar.formats.video.file import VideoFile


@dataclass(frozen=True, eq=False)
class VideoSource:
    """Opened videos; cheap to pickle.

    Args:
        summary: what they are.
        ids: numbers of the moments.
        timestamps_ns: times of the frames.
        refused: moments that one eye has missed, and the like.
        left: video of the left eye, or of both.
        right: video of the right eye, None where one video has both.
        left_frames: (N,) frame of `left` of each pair.
        right_frames: (N,) frame of `right`.
        packing: where the eyes are in a picture.
        rig: of one eye's size.
    """

    summary: SourceSummary
    ids: tuple[str, ...]
    timestamps_ns: tuple[int, ...]
    refused: tuple[tuple[str, PseudolidarError], ...]
    left: VideoFile = field(repr=False)
    right: VideoFile | None = field(repr=False)
    left_frames: Int64 = field(repr=False)
    right_frames: Int64 = field(repr=False)
    packing: Packing = field(repr=False)
    rig: StereoRig = field(repr=False)

    @property
    def yields(self) -> type[StereoFrame] | type[RawPair]:
        """Rectified or unrectified pairs, by the rig."""
        return StereoFrame if self.rig.is_rectified else RawPair

    def load(self, index: int) -> StereoFrame | RawPair:
        """Decode a pair: the very pixels that decoding from the start would give.

        Raises:
            VideoDamaged: one of its pictures cannot be decoded whole.
            PairMismatch, CalibrationSizeMismatch: its size has changed within the video.
        """
        picture = self.left.picture(int(self.left_frames[index]))
        notes = picture.notes
        if self.right is None:
            left, right = self.packing.split(picture.pixels)
        else:
            other = self.right.picture(int(self.right_frames[index]))
            left, right, notes = picture.pixels, other.pixels, notes + other.notes
        try:
            return self.yields(
                left,
                right,
                self.rig,
                self.ids[index],
                index,
                self.timestamps_ns[index],
                notes=tuple(dict.fromkeys(notes)),
            )
        except PseudolidarError as error:
            raise error.located(self.left.path, f"frame {self.ids[index]}") from None
