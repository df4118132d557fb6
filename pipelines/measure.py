"""How far away and how big is what a box in the picture holds."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Annotated, Any

import numpy as np

from pseudolidar.clouds.ground_fit import GroundFit
from pseudolidar.errors import ALL_DONE, UsageError, printable
from pseudolidar.formats.obstacle_json import obstacle_fields
from pseudolidar.formats.regions import NO_CLASS
from pseudolidar.formats.rigs.rig_reading import RigUnit
from pseudolidar.formats.timestamps import NS_PER_S
from pseudolidar.geometry.box_in_view import across_m
from pseudolidar.obstacles.class_sizes import UNKNOWN, size_of_class
from pseudolidar.obstacles.measure import DRAWN_PX, measured
from pseudolidar.obstacles.regions import Boxes, Regions
from pseudolidar.running.crew.crew_plan import CrewPlan
from pseudolidar.running.field_markers import Recognised
from pseudolidar.running.matching import MatchFrame, Refining
from pseudolidar.running.nearness import Searching
from pseudolidar.running.preflight import preflight
from pseudolidar.running.sighting import SMALL_THINGS_KEPT, SightFrame
from pseudolidar.running.table import table_text
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
from pseudolidar.structures.obstacle import Obstacle
from pseudolidar.structures.recorded import Frame

FIRST = FrameSelection(("0:1",))
FEW_POINTS = 20


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
    """Match the frames that are asked for, and measure what the boxes hold.

    Raises:
        LabelError: the boxes cannot be read, or lie outside of the picture.
        UsageError: the frames that are asked for have no box.
    """
    detect = Regions(job.box, job.name).load()
    source = opened(job)
    preflight(
        source,
        wanted=job.check,
        crew=CrewPlan(1),
        searching=Searching(job.matcher, job.min_depth),
    )
    match = MatchFrame.load(
        source,
        job.matcher,
        Refining(),
        job.clean,
        eyes=Eyes(job.rows, job.balance),
        min_depth_m=job.min_depth,
    )
    sighted = SightFrame.of(match, job.ground)
    found = list[Measured]()
    for index in range(len(source.ids)):
        frame = source.load(index)
        sight = sighted(frame).sight
        focal_px = sight.camera.focal_px
        found += [Measured(frame, one, focal_px) for one in measured(sight, detect(sight))]
    if not found:
        raise UsageError(
            f"no box for frame {', '.join(source.ids)}",
            want="one",
            fix="Look at `frame` there.",
            path=job.box.path,
        )
    return MeasureReport(tuple(found))


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


@dataclass(frozen=True, eq=False)
class Measured:
    """One thing in one frame.

    Args:
        frame: which.
        obstacle: what was measured.
        focal_px: of the left camera.
    """

    frame: Frame
    obstacle: Obstacle
    focal_px: float


@dataclass(frozen=True, eq=False)
class MeasureReport:
    """What was measured.

    Args:
        found: each box of each frame.
    """

    found: Sequence[Measured]

    @property
    def exit_code(self) -> int:
        """0: each box has an answer, however unsure."""
        return ALL_DONE

    def as_dict(self) -> dict[str, Any]:
        """All that is known of each, as in obstacles.jsonl."""
        return {
            "measured": [
                {
                    **obstacle_fields(
                        one.obstacle,
                        frame=one.frame.id,
                        time_s=one.frame.timestamp_ns / NS_PER_S,
                        number=number,
                    ),
                    "across_m": across_m(one.obstacle.box),
                    "sigma_across_m": _sigma_across_m(one),
                }
                for number, one in enumerate(self.found, start=1)
            ]
        }

    def text(self) -> str:
        """A table, and what to be careful about."""
        rows = [_row(one) for one in self.found]
        header = ("frame", "what", "distance", "across", "height", "right, down, ahead", "points")
        lines = [table_text(rows, header=header)]
        for one in self.found:
            name = printable(one.obstacle.detection.name)
            lines += [f"{name}: {note}" for note in _notes(one.obstacle)]
        return "\n".join(lines)


def _row(one: Measured) -> tuple[str, ...]:
    obstacle, box = one.obstacle, one.obstacle.box
    assert box.sigma_m is not None  # an Obstacle has it
    x, y, z = box.pose.translation_m
    return (
        one.frame.id,
        obstacle.detection.name,
        f"{obstacle.distance_m:.2f} +- {obstacle.sigma_distance_m:.2f} m",
        f"{across_m(box):.2f} +- {_sigma_across_m(one):.2f} m",
        f"{box.height_m:.2f} +- {box.sigma_m[5]:.2f} m",
        f"{x:.2f}, {y:.2f}, {z:.2f} m",
        f"{obstacle.points}",
    )


def _sigma_across_m(one: Measured) -> float:
    """Both edges of the box in the picture, and the distance that they are seen at."""
    obstacle = one.obstacle
    edges_m = np.sqrt(2.0) * DRAWN_PX * obstacle.distance_m / one.focal_px
    share = obstacle.sigma_distance_m / obstacle.distance_m
    return float(np.hypot(edges_m, share * across_m(obstacle.box)))


def _notes(obstacle: Obstacle) -> list[str]:
    usual = size_of_class(obstacle.detection.name) is not UNKNOWN
    if obstacle.measured_by == "size":
        said = "nothing in it was matched (sky, no texture, or too small), so it is not measured: "
        if usual:
            return [f"{said}this is where its usual size and its footing put it"]
        return [f"{said}this is where a thing of any size might be, see +-; --name helps"]
    notes = []
    if obstacle.measured_by == "points" and obstacle.points < FEW_POINTS:
        notes.append(f"only {obstacle.points} points")
    if obstacle.truncated:
        size = "that of its class" if usual else "a guess"
        notes.append(f"cut by the border of the picture: its size is {size}")
    if obstacle.occluded:
        notes.append("something nearer hides part of it")
    return notes
