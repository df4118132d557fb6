"""A source seen through another rig: cameras, baseline and correction of a calibration file."""

from __future__ import annotations

import datetime
import re
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import ClassVar

import numpy as np

from pseudolidar.errors import NotRectified
from pseudolidar.formats.rigs.rig_file import read_any_rig
from pseudolidar.formats.rigs.rig_json import rig_notes
from pseudolidar.formats.rigs.rig_reading import RigUnit
from pseudolidar.geometry.frames import left_in_base_link, on_moved_base
from pseudolidar.sources.aligned_rows import with_rows_aligned
from pseudolidar.sources.body import Body, with_rig_file
from pseudolidar.sources.folder import Folders
from pseudolidar.sources.other_raw_rig import with_raw_rig
from pseudolidar.sources.over import SourceOver
from pseudolidar.sources.recording.recording import Recording
from pseudolidar.sources.rectified import Rectify, with_pairs_rectified
from pseudolidar.sources.rig_size import IN_METRES, fitting_rig, with_sensors_of
from pseudolidar.sources.scans_put_right import Scans, with_scans_put_right
from pseudolidar.sources.source import (
    FrameSequence,
    FrameSource,
    SourceSettings,
    SourceSummary,
    pairs_of,
)
from pseudolidar.sources.swapped import swapped
from pseudolidar.sources.tum_depth import TumDepth
from pseudolidar.sources.video.videos import Video
from pseudolidar.sources.wrapped import unwrapped
from pseudolidar.structures.camera import StereoRig
from pseudolidar.structures.frame import RawPair, StereoFrame
from pseudolidar.structures.motion import BodyMotion
from pseudolidar.structures.pose import Pose
from pseudolidar.structures.recorded import Frame, HeldFrame

AS_USUAL = Rectify()
_DATE = re.compile(r"(?<![0-9])([0-9]{4})[-_./]([0-9]{2})[-_./]([0-9]{2})(?![0-9])")


def opened_with_rig(
    settings: SourceSettings,
    rig: Path | None,
    *,
    scale_calibration: bool = False,
    unit: RigUnit | None = None,
    swap: bool = False,
    scans: Scans | None = None,
    rectify: Rectify = AS_USUAL,
) -> FrameSequence[Frame]:
    """Open a source; where a calibration is given, with that in place of its own.

    The one place where unrectified pairs are rectified and a row correction of a rig is applied:
    pictures are resampled as they load.

    Args:
        settings: the source; folders of pictures and videos need no rig of their own then.
        rig: a calibration of any known form, or None.
        scale_calibration: scale it to the images where they have another size.
        unit: of its lengths, for files that do not say it.
        swap: exchange left and right pictures.
        scans: how LiDAR scans are put right; None to leave them as they are stored.
        rectify: how unrectified pairs are rectified.

    Raises:
        PseudolidarError: what opening the source, reading the file, or `with_rig` raises.
    """
    source = opened_as_taken(
        settings,
        rig,
        scale_calibration=scale_calibration,
        unit=unit,
        swap=swap,
        scans=scans,
        rectify=rectify,
    )
    return with_rows_aligned(source)


def opened_as_taken(
    settings: SourceSettings,
    rig: Path | None,
    *,
    scale_calibration: bool = False,
    unit: RigUnit | None = None,
    swap: bool = False,
    scans: Scans | None = None,
    rectify: Rectify = AS_USUAL,
) -> FrameSequence[Frame]:
    """As `opened_with_rig`, with rows as they are: for what fits a new row correction."""
    opened = _opened(settings, rig, scale_calibration=scale_calibration, unit=unit, rectify=rectify)
    if opened.yields is RawPair:
        taken = swapped(opened) if swap else opened
        return with_scans_put_right(with_pairs_rectified(taken, rectify), scans)
    source = with_scans_put_right(with_pairs_rectified(opened, rectify), scans)
    return swapped(pairs_of(source)) if swap else source


def _opened(
    settings: SourceSettings,
    rig: Path | None,
    *,
    scale_calibration: bool,
    unit: RigUnit | None,
    rectify: Rectify,
) -> FrameSequence[HeldFrame]:
    if isinstance(settings, Folders | Video | Recording):
        own = settings if rig is None else replace(settings, rig=str(rig))
        own = own if unit is None else replace(own, rig_unit=unit)
        own = replace(own, scale_calibration=True) if scale_calibration else own
        told = rectify.pictures != "auto"
        return (replace(own, pictures=rectify.pictures) if told else own).open()
    if isinstance(settings, Body):
        return (settings if rig is None else with_rig_file(settings, rig)).opened(rectify)
    if rig is None:
        return settings.open()
    if isinstance(settings, TumDepth):
        return replace(settings, rig=str(rig)).open()
    held = settings.open()
    if held.yields is RawPair:
        return with_raw_rig(held, rig, scale_calibration=scale_calibration, unit=unit)
    source = pairs_of(held)
    reading = read_any_rig(rig, size_px=source.rig.left.size_px, unit=unit)
    reading = reading.taken_for("rectified")
    given = with_rig(source, reading.of_rectified, scale_calibration=scale_calibration)
    return replace(given, notes=tuple(dict.fromkeys((*given.notes, *reading.notes))))


def with_rig(
    source: FrameSource, rig: StereoRig, *, scale_calibration: bool = False
) -> RiggedSource:
    """The source with the cameras, baseline and correction of `rig`.

    Velodyne, IMU and poses stay those of the source, but for the pitch of the Velodyne that `rig`
    knows of; where the source has none, those of `rig` count.

    Args:
        source: the source.
        rig: rectified rig.
        scale_calibration: scale `rig` to the images where they have another size.

    Raises:
        NotRectified: `rig` is not rectified.
        CalibrationSizeMismatch: `rig` is for another image size.
    """
    if not rig.is_rectified:
        raise NotRectified(
            "a rig of unrectified cameras",
            want="the rig of the rectified images that the source has",
            fix="Give the rectified rig.",
        )
    fitting_rig(rig, source.rig.left.size_px, scale_calibration=scale_calibration)
    return RiggedSource(source, rig, scale_calibration, _notes(source.rig, rig))


@dataclass(frozen=True, eq=False)
class RiggedSource(SourceOver):
    """A source with another rig.

    Args:
        source: where the frames come from.
        given: the rig that replaces theirs.
        scale_calibration: scale it to the images.
        notes: what is odd about it.
    """

    source: FrameSource
    given: StereoRig = field(repr=False)
    scale_calibration: bool
    notes: tuple[str, ...]
    yields: ClassVar = StereoFrame

    @property
    def summary(self) -> SourceSummary:
        """What it is."""
        summary = self.source.summary
        return replace(summary, notes=(*summary.notes, *self.notes))

    @property
    def rig(self) -> StereoRig:
        """The given rig on the source."""
        return self._on(self.source.rig)

    def load(self, index: int) -> StereoFrame:
        """Frame `index` with the given rig.

        Raises:
            CalibrationSizeMismatch: this frame has another size.
        """
        frame = self.source.load(index)
        rig = self._on(frame.rig)
        if not rig.metric:
            return replace(frame, rig=rig, pose=None, motion=None, scan=None, labels=None)
        pose, motion = _on_body(frame, rig)
        return replace(frame, rig=rig, pose=pose, motion=motion)

    def _on(self, own: StereoRig) -> StereoRig:
        rig = fitting_rig(self.given, own.left.size_px, scale_calibration=self.scale_calibration)
        return with_sensors_of(own, rig)


def replaced_rig(source: FrameSequence[Frame]) -> StereoRig | None:
    """The source's own rig, where another one replaces it."""
    inner = unwrapped(source)
    return inner.source.rig if isinstance(inner, RiggedSource) else None


def _on_body(frame: StereoFrame, rig: StereoRig) -> tuple[Pose | None, BodyMotion | None]:
    """The frame's pose and motion for the `base_link` of `rig`, which may be another sensor."""
    old, new = left_in_base_link(frame.rig), left_in_base_link(rig)
    if np.array_equal(old.matrix, new.matrix):
        return frame.pose, frame.motion
    return on_moved_base(frame.pose, frame.motion, new.matrix @ old.inverse().matrix)


def calibration_date(origin: str) -> datetime.date | None:
    """The first date (2011-09-26, 2011_09_26) in the words about where a calibration is from."""
    for match in _DATE.finditer(origin):
        try:
            return datetime.date(*(int(part) for part in match.groups()))
        except ValueError:
            continue
    return None


def _notes(own: StereoRig, given: StereoRig) -> tuple[str, ...]:
    notes = [f"rig: {given.origin or 'given'}, instead of {own.origin or 'that of the source'}"]
    dates = calibration_date(own.origin), calibration_date(given.origin)
    if None not in dates and dates[0] != dates[1]:
        notes.append(f"warning: the rig is of {dates[1]}, the source's calibration of {dates[0]}")
    notes += [] if given.metric else [IN_METRES]
    return (*notes, *rig_notes(given))
