"""Unrectified pairs to rectified ones with their rig, for every other tool."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Any

import numpy as np

from pseudolidar.calibration.known_distance import KnownDistance
from pseudolidar.errors import UsageError
from pseudolidar.formats.rigs.rig_json import write_rig
from pseudolidar.formats.rigs.rig_reading import Pictures, RigUnit
from pseudolidar.geometry.rectification import FISHEYE_FIELD_DEG
from pseudolidar.running.apart import check_apart, check_elsewhere, paths_read
from pseudolidar.running.bad_frames import OnError
from pseudolidar.running.crew.crew_plan import FRAME_TIMEOUT_S, CrewPlan
from pseudolidar.running.field_markers import POSITIONAL, RUN_ONLY, THIS_TIME, Recognised
from pseudolidar.running.folder import check_usable
from pseudolidar.running.preflight import SourceCheck, check_source
from pseudolidar.running.products.rectified_pairs import (
    EncodePairs,
    folder_of_view,
    pairs_in,
    shared_names,
    write_shared,
    write_times,
)
from pseudolidar.running.results import RunResult
from pseudolidar.running.rows_drawn import draw_rows, row_text
from pseudolidar.running.run import Run
from pseudolidar.running.stream import stream
from pseudolidar.running.uncalibrated import CAMERAS, FoundCameras, as_file, found_cameras
from pseudolidar.running.unclaimed import check_unclaimed
from pseudolidar.sources.other_rig import opened_with_rig
from pseudolidar.sources.recognise import Source, recognise
from pseudolidar.sources.rectified import Rectify, in_one_view, raw_rig
from pseudolidar.sources.selection import FrameSelection, select
from pseudolidar.sources.source import FrameSequence, evenly_loaded, pairs_of, tell
from pseudolidar.structures.arrays import Float64
from pseudolidar.structures.body import BodyFrame
from pseudolidar.structures.frame import StereoFrame
from pseudolidar.structures.image_size import ImageSize
from pseudolidar.structures.recorded import Frame

PICTURE = "rows.png"
# Rows that cameras without distortion leave this far apart, px, are those of lenses with some.
BENT_PX = 1.0
BENT = (
    "WARNING: rows do not meet: no cameras without lens distortion make these pictures "
    "(fisheyes?). Calibrate them with a board, `pseudolidar calibrate`"
)


@dataclass(frozen=True)
class RectifyPairs:
    """Rectify the pairs of SOURCE and write them to OUT: left/, right/, rig.json, valid/, times.

    Other verbs need no such step: they rectify as they load, by --rectify. OUT is for other tools,
    and gives the same clouds. rows.png shows lines that must meet the same things in both eyes.

        pseudolidar rectify pictures out --rig rig.json
        pseudolidar rectify pictures out --rig rig.json --alpha 1 --zoom 1.2
        pseudolidar rectify fisheye out --rig rig.json --views 3
        pseudolidar rectify pictures out --uncalibrated
        pseudolidar rectify pictures out --uncalibrated --focal 720 --known-distance baseline:0.12

    --uncalibrated finds the cameras from matches of the pictures alone, and writes them to
    cameras.json, too. Rows meet then, and the shape of the scene is known as far as the focal
    length is; its scale is not: pictures alone do not tell it. --known-distance sets it.

    Args:
        source: pictures or videos of two eyes as they were taken, or recordings of them.
        out: output folder.
        rig: calibration of the cameras as they are: a rig.json, OpenCV YAML, XML or JSON, ROS
            camera_info; a file, a folder, or LEFT,RIGHT; by default the one beside the pictures.
        rig_unit: unit of lengths in a calibration that does not say it: m, cm, mm.
        scale_calibration: scale the calibration where images have another size.
        alpha: 0 zooms in until every pixel shows something, 1 out until nothing is lost.
        zoom: focal length times this, after that.
        size: of the rectified pictures, by default that of the left ones.
        field_deg: how much of what a fisheye sees counts for that; of a view its width.
        views: more than 1 for slices around the baseline that together show all a fisheye sees;
            each is written to a folder of its own, view_0 and so on, and is a pair like any other.
        pictures: raw or rectified, where a calibration knows both.
        uncalibrated: find the cameras from the pictures, whatever calibration there is.
        focal: focal length of both cameras, where it is known, px; for --uncalibrated.
        known_distance: what sets the scale of --uncalibrated, in metres: baseline:0.12, the eyes'
            distance; points:310,200,420,205=1.8, that of what two pixels of a left picture show;
            box:300,180,360,260=4.5, how far what a box shows is away; @ID behind it names the
            picture, by default the first.
        swap: exchange left and right pictures.
        frames: only these: slices 100:400:2, ids 13,35, or @FILE with such items.
        exclude: not these.
        check: look at the first, the middle and the last pair: swapped eyes and rows that are off
            stop the run.
        workers: frames worked on at the same time; by default one per core.
        on_error: skip a bad frame (and stop when they become many), or stop at the first.
        overwrite: start anew, even where OUT holds a run with other settings.
    """

    source: Annotated[Source, Recognised(recognise)]
    out: Annotated[Path, POSITIONAL, RUN_ONLY]
    rig: Path | None = None
    rig_unit: RigUnit | None = None
    scale_calibration: bool = False
    alpha: float = 0.0
    zoom: float = 1.0
    size: ImageSize | None = None
    field_deg: float = FISHEYE_FIELD_DEG
    views: int = 1
    pictures: Pictures = "auto"
    uncalibrated: bool = False
    focal: float | None = None
    known_distance: KnownDistance | None = None
    swap: bool = False
    frames: FrameSelection | None = None
    exclude: FrameSelection | None = None
    check: Annotated[bool, RUN_ONLY] = True
    workers: Annotated[int | None, RUN_ONLY] = None
    on_error: Annotated[OnError, RUN_ONLY] = "skip"
    overwrite: Annotated[bool, RUN_ONLY, THIS_TIME] = False

    @property
    def rectify(self) -> Rectify:
        """How the pairs are rectified."""
        return Rectify(self.alpha, self.zoom, self.size, self.field_deg, self.views, self.pictures)

    @property
    def crew(self) -> CrewPlan:
        """How the frames are done."""
        return CrewPlan(self.workers, FRAME_TIMEOUT_S)


def run(job: RectifyPairs) -> RectifyReport:
    """Rectify every pair, encode it, commit it in order; then look at what came out."""
    check_elsewhere(job.out, job.source)
    check_settings(job)
    if job.uncalibrated:
        return run_uncalibrated(job)
    return run_with_rig(job, job.rig)


def run_uncalibrated(job: RectifyPairs) -> RectifyReport:
    """Find the cameras first."""
    found = found_cameras(
        job.source,
        focal_px=job.focal,
        known=job.known_distance,
        swap=job.swap,
        rectify=job.rectify,
    )
    with as_file(found.rig) as path:
        return run_with_rig(job, path, found)


def run_with_rig(
    job: RectifyPairs, rig: Path | None, found: FoundCameras | None = None
) -> RectifyReport:
    """Rectify every pair by a rig, given or found, and look at what came out."""
    source = opened(job, rig)
    check_usable(job.out)
    first = pairs_in(first_frame(source))
    encode = EncodePairs(tuple(pair.rig for pair in first))
    products = (*shared_names(job.views), PICTURE, *((CAMERAS,) if found else ()))
    folders = ("left", "right") if job.views == 1 else ()
    written = {name.partition("/")[0] for name in (*products, *folders)}
    check_apart(job.out, paths_read(job.source, job.rig), sorted(written), overwrite=job.overwrite)
    check_unclaimed(job.out, written, overwrite=job.overwrite)
    with Run.open(job.out, job, source, products=products) as run:
        settled = run.settled(source.ids)
        run.check(wanted=job.check and len(settled) < len(source.ids), crew=job.crew)
        write_shared(job.out, first)
        if found is not None:
            write_rig(job.out / CAMERAS, found.rig)
        for frame in run.good(stream(source, encode, crew=job.crew, skip=settled)):
            run.commit(frame)
        times = dict(zip(source.ids, source.timestamps_ns, strict=True))
        write_times(job.out, run.records(), times, job.views)
    looked = check_source(in_one_view(source), crew=job.crew)
    draw_rows(job.out / PICTURE, source, looked)
    return RectifyReport(run.result(), job.out, first, looked, source.summary.notes, found)


def check_settings(job: RectifyPairs) -> None:
    """Raise `UsageError` for flags that belong to --uncalibrated alone, or contradict it."""
    alone = {"--focal": job.focal, "--known-distance": job.known_distance}
    given = [name for name, value in alone.items() if value is not None]
    if given and not job.uncalibrated:
        raise UsageError(
            f"{' and '.join(given)} without --uncalibrated",
            want="--uncalibrated, or a rig, which has a focal length and a scale",
        )
    if job.uncalibrated and job.rig is not None:
        raise UsageError("--uncalibrated and --rig", want="one of them")
    if job.focal is not None and not job.focal > 0:
        raise UsageError(f"a focal length of {job.focal:g} px", want="above 0", where="focal")


def opened(job: RectifyPairs, rig: Path | None) -> FrameSequence[Frame]:
    """The pairs that are asked for, rectified as they load.

    Raises:
        UsageError: they are rectified already.
        NoPairs: they are of several rigs on one body.
    """
    every = opened_with_rig(
        job.source,
        rig,
        scale_calibration=job.scale_calibration,
        unit=job.rig_unit,
        swap=job.swap,
        rectify=job.rectify,
    )
    if raw_rig(every) is None:
        if every.yields is BodyFrame:
            pairs_of(every)  # says that one pair is taken at a time
        raise UsageError(
            "pairs that are rectified already, or no pairs",
            want="pictures as cameras take them, and the calibration of these cameras",
            fix="Every verb takes rectified pairs as they are. If these are not, give the rig of "
            "the cameras: --rig rig.json, and --pictures raw where it knows P1 and P2 too.",
            path=every.summary.path,
        )
    source = select(every, job.frames, job.exclude)
    tell(source)
    return source


def first_frame(source: FrameSequence[Frame]) -> Frame:
    """The first frame that can be read; raises what the first one raises where none can."""
    return next(evenly_loaded(source, most=len(source.ids)), None) or source.load(0)


@dataclass(frozen=True, eq=False)
class RectifyReport:
    """What was written, and how well rows meet.

    Args:
        result: frames and times.
        out: output folder.
        pairs: the first pair, or its views.
        looked: what some pairs show.
        notes: what was assumed and done.
        found: cameras that were found from the pictures, where nobody calibrated them.
    """

    result: RunResult
    out: Path
    pairs: tuple[StereoFrame, ...]
    looked: SourceCheck
    notes: tuple[str, ...]
    found: FoundCameras | None = None

    @property
    def exit_code(self) -> int:
        """0 all done, 4 some frames skipped, 130 or 143 stopped."""
        return self.result.exit_code

    @property
    def rows_px(self) -> Float64:
        """(N,) row differences of matches that agree, in the pairs that were looked at."""
        found = [pair.matches.row_difference_px[pair.inliers] for pair in self.looked.pairs]
        return np.concatenate(found) if found else np.zeros(0)

    @property
    def bent(self) -> bool:
        """Whether cameras were found that most matches of the rectified pictures contradict."""
        rows = np.abs(self.rows_px)
        return self.found is not None and len(rows) > 0 and float(np.median(rows)) > BENT_PX

    def as_dict(self) -> dict[str, Any]:
        """Rigs, shares of pixels that show something, row differences, counts and times."""
        rows = np.abs(self.rows_px)
        return {
            **self.result.as_dict(),
            "out": str(self.out),
            "views": [_view_facts(pair) for pair in self.pairs],
            "matches": len(rows),
            "row_difference_px": float(np.median(rows)) if len(rows) else None,
            "row_difference_95_px": float(np.quantile(rows, 0.95)) if len(rows) else None,
            "notes": list(self.notes),
            "bent": self.bent,
            "uncalibrated": None if self.found is None else self.found.as_dict(),
        }

    def text(self) -> str:
        """For people, and what to open."""
        lines = [self.result.text()]
        for number, pair in enumerate(self.pairs):
            facts = _view_facts(pair)
            place = self.out / folder_of_view(number, len(self.pairs))
            lines.append(
                f"  {place}: {facts['width_px']}x{facts['height_px']} px, f {facts['f_px']:.1f} px,"
                f" {pair.rig.baseline_text}, {facts['seen_left']:.1%} of the left "
                f"pictures can be matched"
            )
        lines.append(f"  {row_text(self.rows_px)}")
        if self.found is not None:
            lines += [f"  {line}" for line in self.found.lines]
            lines += [f"  {BENT}"] if self.bent else []
            lines.append(f"  {self.out / CAMERAS}")
        lines.append(f"  {self.out / PICTURE}")
        return "\n".join(lines)


def _view_facts(pair: StereoFrame) -> dict[str, Any]:
    seen = (1.0, 1.0) if pair.mask is None else (pair.mask.left.mean(), pair.mask.right.mean())
    return {
        "width_px": pair.rig.left.width_px,
        "height_px": pair.rig.left.height_px,
        "f_px": pair.rig.left.focal_px,
        "baseline_m": pair.rig.baseline_m,
        "metric": pair.rig.metric,
        "seen_left": float(seen[0]),
        "seen_right": float(seen[1]),
    }
