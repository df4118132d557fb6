"""Unrectified pairs seen through another rig: the cameras as they are mounted, of a file."""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any, ClassVar, cast

from pseudolidar.errors import NotRectified
from pseudolidar.formats.rigs.rig_file import read_any_rig
from pseudolidar.formats.rigs.rig_json import rig_notes
from pseudolidar.formats.rigs.rig_reading import RigUnit
from pseudolidar.sources.over import SourceOver
from pseudolidar.sources.rig_size import IN_METRES, fitting_rig, with_sensors_of
from pseudolidar.sources.source import FrameSequence, SourceSummary
from pseudolidar.structures.camera import StereoRig
from pseudolidar.structures.frame import RawPair


def with_raw_rig(
    source: FrameSequence[Any],
    file: Path,
    *,
    scale_calibration: bool = False,
    unit: RigUnit | None = None,
) -> RawRiggedSource:
    """The source with the cameras of a file, as they are mounted, with their corrections.

    Velodyne and IMU stay those of the source; where it has none, those of the file count.

    Args:
        source: of unrectified pairs.
        file: a calibration of any known form.
        scale_calibration: scale it to the images where they have another size.
        unit: of its lengths, for files that do not say it.

    Raises:
        NotRectified: the file knows rectified pictures alone, which these are not.
        CalibrationSizeMismatch: it is for another image size.
    """
    assert source.rig is not None
    size_px = source.rig.left.size_px
    reading = read_any_rig(file, size_px=size_px, unit=unit)
    if reading.raw is None or reading.raw.is_rectified:
        raise NotRectified(
            f"the rig of rectified pictures ({reading.form})",
            want="the cameras of unrectified ones: K, distortion, R and T",
            fix="`pseudolidar check SOURCE --out rig.json` and `refine` write such a rig for this "
            "source; or rectify the pictures first.",
            path=file,
        )
    rig = fitting_rig(reading.raw, size_px, scale_calibration=scale_calibration, path=file)
    own = source.rig
    said = f"rig: {rig.origin or 'given'}, instead of {own.origin or 'that of the source'}"
    aside = () if rig.metric else (IN_METRES,)
    notes = (said, *aside, *reading.notes, *rig_notes(rig))
    return RawRiggedSource(source, with_sensors_of(own, rig), tuple(dict.fromkeys(notes)))


@dataclass(frozen=True, eq=False)
class RawRiggedSource(SourceOver):
    """A source of unrectified pairs with another rig.

    Args:
        source: where the pairs come from.
        rig: the rig that replaces theirs.
        notes: what is odd about it.
    """

    source: FrameSequence[Any]
    rig: StereoRig = field(repr=False)
    notes: tuple[str, ...]
    yields: ClassVar = RawPair

    @property
    def summary(self) -> SourceSummary:
        """What it is."""
        summary = self.source.summary
        return replace(summary, notes=(*summary.notes, *self.notes))

    def load(self, index: int) -> RawPair:
        """Frame `index` with the given rig."""
        pair = cast("RawPair", self.source.load(index))
        if not self.rig.metric:
            return replace(pair, rig=self.rig, pose=None, motion=None, scan=None)
        return replace(pair, rig=self.rig)
