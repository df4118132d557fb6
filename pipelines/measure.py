"""How far away and how big is what a box in the picture holds."""

from __future__ import annotations

from dataclasses import dataclass, field
from pathlib import Path
from typing import Annotated

from pseudolidar.clouds.ground_fit import GroundFit
from pseudolidar.errors import UsageError
from pseudolidar.formats.regions import NO_CLASS
from pseudolidar.formats.rigs.rig_reading import RigUnit
from pseudolidar.obstacles.measure import measured
from pseudolidar.obstacles.regions import Boxes, DrawnRegions, Regions
from pseudolidar.running.bad_frames import good_frames
from pseudolidar.running.crew.attempt import Skipped, attempt
from pseudolidar.running.crew.crew_plan import CrewPlan
from pseudolidar.running.drawn_frames import drawn_for
from pseudolidar.running.field_markers import Recognised
from pseudolidar.running.matching import MatchFrame, Refining
from pseudolidar.running.nearness import Searching
from pseudolidar.running.preflight import preflight
from pseudolidar.running.reports.measure_report import Measured, MeasureReport
from pseudolidar.running.sighting import SMALL_THINGS_KEPT, SightFrame
from pseudolidar.sources.other_rig import opened_with_rig
from pseudolidar.sources.recognise import Source, recognise
from pseudolidar.sources.rectified import Rectify
from pseudolidar.sources.selection import FrameSelection, select
from pseudolidar.sources.source import FrameSequence, tell
from pseudolidar.stereo.balance import BalanceWhen
from pseudolidar.stereo.census import Census
from pseudolidar.stereo.eyes import Eyes
from pseudolidar.stereo.filters.clean import Clean
from pseudolidar.stereo.neural import Onnx
from pseudolidar.stereo.row_alignment import RowsWhen
from pseudolidar.stereo.sgbm import Bm, Sgbm
from pseudolidar.structures.recorded import Frame

FIRST = FrameSelection(("0:1",))


@dataclass(frozen=True)
class Measure:
    """Measure what a box in the left picture holds: distance, width, height, each with its error.

    The points in the box are separated from ground and background; the nearest surface that fills
    it counts. Edges of the box are taken for edges of the thing: draw it close. `across` is its
    width as seen; width and length of the box that is fitted are in --json.

        pseudolidar measure training --frame 12 --box 480,180,512,202
        pseudolidar measure left.mp4 --right right.mp4 --rig rig.json --frame 30 --box boxes.csv
        pseudolidar measure synthetic:street --box 560,160,625,215 --name car --json

    Args:
        source: pairs: KITTI data, folders, videos, a recording, synthetic:NAME; or pictures with
            their depth.
        box: LEFT,TOP,RIGHT,BOTTOM in px, or a .csv or .json file of such boxes.
        frame: which frame: its id, or a slice; the first by default.
        name: class of the thing, where it has one with a usual size (car, person): what cannot be
            seen of it, as its length from behind, is taken from there.
        matcher: how disparities are found.
        rows: bring the rows of the right picture to those of the left one before matching: `auto`
            where points that both eyes see show that they differ, `never`.
        balance: give the right picture the brightness, colours, gamma and vignetting of the left
            one before matching: `auto`, `always`, `never`.
        clean: what is removed of the disparities because it is no surface; `none` keeps all.
            Surfaces of 7 x 7 cm stay, where clouds lose those below 22 x 22 cm.
        ground: how the ground is looked for; `none` where there is none, as in flight.
        rig: calibration that replaces the source's cameras: a rig.json, OpenCV YAML, XML or JSON,
            ROS camera_info, K.txt, calib.txt; a file, a folder, or LEFT,RIGHT.
        rig_unit: unit of lengths in a calibration that does not say it: m, cm, mm.
        rectify: how unrectified pairs are rectified, as they load.
        scale_calibration: scale the calibration where images have another size.
        min_depth: nearest depth that must be found, m. By default what the data set says of its
            scenes, or the rig of its board, else 3.
        swap: exchange left and right pictures.
        check: look first whether eyes are swapped, rows are off, or the calibration is for another
            size.
    """

    source: Annotated[Source, Recognised(recognise)]
    box: Boxes
    frame: FrameSelection = FIRST
    name: str = NO_CLASS
    matcher: Census | Sgbm | Bm | Onnx = field(default_factory=Census)
    rows: RowsWhen = "auto"
    balance: BalanceWhen = "auto"
    clean: Clean | None = SMALL_THINGS_KEPT
    ground: GroundFit | None = field(default_factory=GroundFit)
    rig: Path | None = None
    rig_unit: RigUnit | None = None
    rectify: Rectify = field(default_factory=Rectify)
    scale_calibration: bool = False
    min_depth: float | None = None
    swap: bool = False
    check: bool = True


def run(job: Measure) -> MeasureReport:
    """Match the frames that are asked for and have a box, and measure what the boxes hold.

    Raises:
        LabelError: the boxes cannot be read, or all lie outside of the picture.
        TooManyBadFrames: and what else `good_frames` raises.
        UsageError: the frames that are asked for have no box.
    """
    drawn = Regions(job.box, job.name).load()
    source = opened(job)
    detect = drawn_for(drawn, source)
    preflight(
        source,
        wanted=job.check,
        crew=CrewPlan(1),
        searching=searching(job),
    )
    boxed = [index for index, name in enumerate(source.ids) if detect.boxes_of(name)]
    if not boxed:
        raise UsageError(
            f"no box for frame {', '.join(source.ids)}",
            want="one",
            fix="Look at `frame` there.",
            path=job.box.path,
        )
    measure = MeasureFrame(sighted(job, source), detect)
    skipped = list[Skipped]()
    outcomes = (attempt(source, measure, index) for index in boxed)
    found = [
        one
        for frame in good_frames(
            outcomes, frames=len(boxed), on_error="skip", skipped=skipped.append
        )
        for one in frame.value
    ]
    return MeasureReport(found, skipped)


def sighted(job: Measure, source: FrameSequence[Frame]) -> SightFrame:
    """What a frame is measured in, with everything heavy loaded."""
    match = MatchFrame.load(
        source,
        job.matcher,
        Refining(),
        job.clean,
        eyes=Eyes(job.rows, job.balance),
        min_depth_m=job.min_depth,
    )
    return SightFrame.of(match, job.ground, searched_px=searching(job).searched_px(source))


def searching(job: Measure) -> Searching:
    """What disparities are looked for."""
    return Searching(job.matcher, job.min_depth)


def opened(job: Measure) -> FrameSequence[Frame]:
    """The frames that are asked for, with the rig that is asked for."""
    every = opened_with_rig(
        job.source,
        job.rig,
        scale_calibration=job.scale_calibration,
        unit=job.rig_unit,
        swap=job.swap,
        rectify=job.rectify,
    )
    source = select(every, job.frame)
    tell(source)
    return source


@dataclass(frozen=True)
class MeasureFrame:
    """Measures what the boxes of a frame hold.

    Args:
        sight: frame to depth and ground.
        detect: the boxes.
    """

    sight: SightFrame
    detect: DrawnRegions

    def __call__(self, frame: Frame) -> list[Measured]:
        """Each box of the frame.

        Raises:
            PairIdentical, LowTexture, MapEmpty: there is nothing to be seen.
            LabelError: a box lies outside of the picture.
        """
        sight = self.sight(frame).sight
        focal_px = sight.camera.focal_px
        return [Measured(frame, one, focal_px) for one in measured(sight, self.detect(sight))]
