"""Put a rig right: what its calibration left, fitted to what its pictures show."""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Annotated, Any

from pseudolidar.calibration.check_rows import ROWS
from pseudolidar.calibration.motion import Motion
from pseudolidar.calibration.reference import Reference
from pseudolidar.calibration.rows import Rows
from pseudolidar.errors import UsageError
from pseudolidar.formats.rigs.rig_reading import RigUnit
from pseudolidar.running.bad_frames import OnError
from pseudolidar.running.crew.crew_plan import CrewPlan
from pseudolidar.running.field_markers import RUN_ONLY, THIS_TIME, Recognised
from pseudolidar.running.motion_refining import PictureRefinement, refined_by_pictures
from pseudolidar.running.nearness import Searching
from pseudolidar.running.preflight import preflight
from pseudolidar.running.reference_refining import refined_by_reference
from pseudolidar.running.reports.reference_refinement import ReferenceRefinement
from pseudolidar.running.rig_output import check_rig_place, store_rig
from pseudolidar.sources.aligned_rows import with_rows_aligned
from pseudolidar.sources.other_rig import opened_as_taken
from pseudolidar.sources.recognise import Source, recognise
from pseudolidar.sources.rectified import Rectify, raw_rig
from pseudolidar.sources.scans_put_right import Scans
from pseudolidar.sources.selection import FrameSelection, select
from pseudolidar.sources.source import FrameSource, nearest_depth_m, pairs_of
from pseudolidar.stereo.balance import BalanceWhen
from pseudolidar.stereo.census import Census
from pseudolidar.stereo.eyes import Eyes
from pseudolidar.stereo.row_alignment import RowsWhen
from pseudolidar.stereo.sgbm import Bm, Sgbm
from pseudolidar.structures.camera import StereoRig


@dataclass(frozen=True)
class Refine:
    """Fit what the calibration of SOURCE left, and store it in a rig file.

    Every later command applies it when it is given `--rig rig.json`, and says so. Fitted is the
    smooth error of the disparities, to LiDAR scans or ground truth; the table says what that is
    worth on frames outside the fit. Without a LiDAR the motion of a sequence tells the offset of
    its disparities, and points that both eyes see tell how rows differ. The scale of the depths
    cannot be seen that way: it follows surveyed poses (GPS, IMU) of the source, and without those
    near depths stay as they were calibrated (`--by.scale`).

        pseudolidar refine training --frames 0::2 --out rig.json
        pseudolidar refine 2011_09_26_drive_0002_sync --by motion --out rig.json
        pseudolidar convert 2011_09_26_drive_0002_sync out --rig rig.json

    Args:
        source: pairs of pictures of one rig; for `motion` frames that follow one another.
        out: the rig file.
        by: what the fit is based on: `reference` (scans, or ground truth), `motion`, `rows`.
        matcher: how disparities are found; the correction belongs to the rig, not to it.
        rows: bring the rows of the right picture to those of the left one before matching: `auto`
            where points that both eyes see show that they differ, `never`.
        balance: give the right picture the brightness, colours, gamma and vignetting of the left
            one before matching: `auto` for matchers that compare brightness (all but census) where
            the eyes differ, `always`, `never`.
        frames: only these: slices 100:400:2, ids 13,35, or @FILE with such items.
        exclude: not these.
        rig: calibration that replaces the source's cameras: a rig.json, OpenCV YAML, XML or JSON,
            ROS camera_info, K.txt, calib.txt; a file, a folder, or LEFT,RIGHT. Corrections in it
            are replaced by those that are fitted.
        rig_unit: unit of lengths in a calibration that does not say it: m, cm, mm.
        rectify: how unrectified pairs are rectified, as they load.
        scale_calibration: scale the calibration where images have another size.
        min_depth: nearest depth that must be found, m; decides how many disparities are searched.
            By default what the data set says of its scenes, or the rig of its board, else 3.
        swap: exchange left and right pictures.
        scans: how LiDAR scans are put right first: moved to one moment, where the data say when
            points were taken; beams raised.
        check: look at the first, the middle and the last pair before: swapped eyes and a
            calibration for another size stop it, other oddities are warned of.
        workers: frames worked on at the same time; by default one per core.
        on_error: skip a bad frame (and stop when they become many), or stop at the first.
        overwrite: replace OUT, if that is a rig file; it is kept as OUT's name with .previous.
    """

    source: Annotated[Source, Recognised(recognise)]
    out: Annotated[Path, RUN_ONLY] = Path("rig.json")
    by: Reference | Motion | Rows = field(default_factory=Reference)
    matcher: Census | Sgbm | Bm = field(default_factory=lambda: Census(quality="fine"))
    rows: RowsWhen = "auto"
    balance: BalanceWhen = "auto"
    frames: FrameSelection | None = None
    exclude: FrameSelection | None = None
    rig: Path | None = None
    rig_unit: RigUnit | None = None
    rectify: Rectify = field(default_factory=Rectify)
    scale_calibration: bool = False
    min_depth: float | None = None
    swap: bool = False
    scans: Scans = field(default_factory=Scans)
    check: Annotated[bool, RUN_ONLY] = True
    workers: Annotated[int | None, RUN_ONLY] = None
    on_error: Annotated[OnError, RUN_ONLY] = "skip"
    overwrite: Annotated[bool, RUN_ONLY, THIS_TIME] = False


def run(job: Refine) -> RefineReport:
    """Look at the sequence, fit, and write the rig.

    Raises:
        UsageError: OUT is there already.
        ReferenceMissing, CalibrationValue: no reference, or too little of it.
        MotionInsufficient: the sequence does not carry what is asked of its motion.
    """
    check_rig_place(job.out, overwrite=job.overwrite)
    source, crew = opened(job), CrewPlan(job.workers)
    searching = Searching(job.matcher, job.min_depth)
    warnings = preflight(source, wanted=job.check, crew=crew, mends=(ROWS,), searching=searching)
    found = fitted(job, source, crew)
    line, notes = source.summary.line, source.summary.notes
    if not found.changed:
        return RefineReport(line, None, found, warnings, notes)
    own = raw_rig(source) or source.rig
    origin = f"{own.origin or 'the rig of the source'}, refined on {source.summary.name}"
    previous = store_rig(job.out, replace(mounted(found.rig, source), origin=origin))
    return RefineReport(line, job.out, found, warnings, notes, previous)


def fitted(
    job: Refine, source: FrameSource, crew: CrewPlan
) -> ReferenceRefinement | PictureRefinement:
    """What is left by the calibration of pairs as they were taken.

    Raises:
        ReferenceMissing, CalibrationValue, MotionInsufficient: as `run`.
    """
    nearest_m = nearest_depth_m(job.min_depth, source)
    matcher = Eyes(job.rows, job.balance).load(job.matcher, min_depth_m=nearest_m)
    if not isinstance(job.by, Reference):
        return refined_by_pictures(source, job.by, matcher, crew=crew, on_error=job.on_error)
    aligned = pairs_of(with_rows_aligned(source))
    found = refined_by_reference(aligned, job.by, matcher, crew=crew, on_error=job.on_error)
    return found.with_rows(source.rig.rows)


def opened(job: Refine) -> FrameSource:
    """The frames that are asked for, as they were taken, with the rig that is asked for."""
    whole = opened_as_taken(
        job.source,
        job.rig,
        scale_calibration=job.scale_calibration,
        unit=job.rig_unit,
        swap=job.swap,
        scans=job.scans,
        rectify=job.rectify,
    )
    if raw_rig(whole) is not None and not job.rectify.usual:
        raise UsageError(
            "unrectified pairs, rectified in a way of their own",
            want="the usual way: what is fitted belongs to the pixels of these pictures",
            fix="Leave --rectify out; or refine the pairs that `pseudolidar rectify` writes.",
            path=whole.summary.path,
        )
    return pairs_of(select(whole, job.frames, job.exclude))


def mounted(rig: StereoRig, source: FrameSource) -> StereoRig:
    """A refined rig as the source takes it: where it rectifies, its cameras as they are mounted."""
    raw = raw_rig(source)
    if raw is None:
        return rig
    pitch_rad = rig.lidar_pitch_rad - raw.lidar_pitch_rad
    return replace(raw.with_lidar_raised(pitch_rad), rows=rig.rows, correction=rig.correction)


@dataclass(frozen=True, eq=False)
class RefineReport:
    """What was fitted, and where it is.

    Args:
        subject: what it was fitted to, one line.
        out: the rig file; None where there is nothing to be put right.
        found: corrections with their figures.
        warnings: what is odd about the pairs.
        notes: what people should know about the source.
        previous: where the rig file is that `out` replaced; None where there was none.
    """

    subject: str
    out: Path | None
    found: ReferenceRefinement | PictureRefinement
    warnings: tuple[str, ...] = ()
    notes: tuple[str, ...] = ()
    previous: Path | None = None

    @property
    def exit_code(self) -> int:
        """4 if frames were skipped, else 0."""
        return self.found.exit_code

    def as_dict(self) -> dict[str, Any]:
        """For `--json`."""
        out = None if self.out is None else str(self.out)
        fitted = self.found.as_dict()
        said = {"warnings": list(self.warnings), "notes": list(self.notes)}
        previous = None if self.previous is None else str(self.previous)
        return {"subject": self.subject, "out": out, "previous": previous, **said, **fitted}

    def text(self) -> str:
        """For people."""
        end = "nothing to be put right, no file written"
        if self.out is not None:
            end = f"{self.out}: pass it to other commands with --rig"
        if self.previous is not None:
            end += f"\n{self.previous}: the rig that was there"
        notes = (f"  {note}" for note in self.notes)
        return "\n".join([self.subject, *notes, *self.found.lines, end])
