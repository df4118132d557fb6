"""An opened folder of pairs: its frames, read one by one."""

from __future__ import annotations

from dataclasses import dataclass, field
from functools import lru_cache
from pathlib import Path

from pseudolidar.errors import PseudolidarError
from pseudolidar.formats.limits import DEFAULT_LIMITS, Limits
from pseudolidar.formats.pictures.image import read_image, read_size
from pseudolidar.sources.source import SourceSummary
from pseudolidar.structures.camera import StereoRig
from pseudolidar.structures.frame import PairMask, RawPair, StereoFrame


@dataclass(frozen=True, eq=False)
class FolderSource:
    """An opened folder of pairs.

    Args:
        summary: what it is.
        ids: names of the frames.
        timestamps_ns: times of the frames.
        refused: frames with one eye only, and the like.
        lefts: left pictures.
        rights: right pictures.
        rigs: one for all frames, or one for each.
        scale_calibration: scale the rig to the pictures.
        limits: caps on the pictures.
        mask: which of their pixels show something, where pictures were rectified before.
    """

    summary: SourceSummary
    ids: tuple[str, ...]
    timestamps_ns: tuple[int, ...]
    refused: tuple[tuple[str, PseudolidarError], ...]
    lefts: tuple[Path, ...]
    rights: tuple[Path, ...]
    rigs: tuple[StereoRig, ...] = field(repr=False)
    scale_calibration: bool = False
    limits: Limits = DEFAULT_LIMITS
    mask: PairMask | None = field(default=None, repr=False)

    @property
    def yields(self) -> type[StereoFrame] | type[RawPair]:
        """Unrectified pairs, if only one of the rigs is unrectified."""
        return StereoFrame if all(rig.is_rectified for rig in self.rigs) else RawPair

    @property
    def rig(self) -> StereoRig:
        """Rig of the first frame."""
        return self.rigs[0]

    def load(self, index: int) -> StereoFrame | RawPair:
        """Read and decode a pair.

        Raises:
            ImageMissing, ImageUnreadable, ImageTruncated, ImageFormat, LimitError: as `read_image`.
            PairMismatch: left and right differ in size, channels or depth.
            CalibrationSizeMismatch: the rig is for another size.
        """
        left = read_image(self.lefts[index], limits=self.limits)
        right = read_image(self.rights[index], limits=self.limits)
        height, width = left.pixels.shape[:2]
        rig = self._rig_of(index)
        if self.scale_calibration and rig.left.size_px != (width, height):
            rig = _scaled(rig, width, height)
        pair = left.pixels, right.pixels, rig, self.ids[index], index, self.timestamps_ns[index]
        notes = tuple(dict.fromkeys(left.notes + right.notes))
        try:
            if rig.is_rectified:
                return StereoFrame(*pair, notes=notes, mask=self.mask)
            return RawPair(*pair, notes=notes)
        except PseudolidarError as error:
            raise error.located(self.lefts[index]) from None

    def check_sizes(self) -> None:
        """Raise `CalibrationSizeMismatch` if no picture has the size of the rig."""
        mismatch: PseudolidarError | None = None
        for index, path in enumerate(self.lefts):
            try:
                width, height = read_size(path, limits=self.limits)
            except PseudolidarError:
                continue  # its frame is refused when it is loaded
            try:
                self._rig_of(index).check_size(width, height)
            except PseudolidarError as error:
                mismatch = mismatch or error.located(path)
            else:
                return
        if mismatch is not None:
            raise mismatch

    def _rig_of(self, index: int) -> StereoRig:
        return self.rigs[index if len(self.rigs) > 1 else 0]


@lru_cache(4)  # by identity: what is planned for a rig is looked up by the rig
def _scaled(rig: StereoRig, width_px: int, height_px: int) -> StereoRig:
    return rig.scaled_to(width_px, height_px)
