"""Obstacles in front of the cameras: how far, how big, and how sure."""

from __future__ import annotations

import logging
import math
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Annotated, Any

from pseudolidar.clouds.ground_fit import GroundFit
from pseudolidar.errors import UsageError
from pseudolidar.formats.atomic import write_atomic
from pseudolidar.formats.mcap.content import McapContent
from pseudolidar.formats.rigs.rig_reading import RigUnit
from pseudolidar.obstacles.corridor import STOP_CHANCE, Corridor, StopRule
from pseudolidar.obstacles.detectors import AnyDetector, asked
from pseudolidar.obstacles.labels import Labels
from pseudolidar.obstacles.tracker import Tracker
from pseudolidar.running.apart import check_apart, paths_read
from pseudolidar.running.bad_frames import OnError
from pseudolidar.running.crew.attempt import Done
from pseudolidar.running.crew.crew_plan import FRAME_TIMEOUT_S, CrewPlan
from pseudolidar.running.drawn_frames import detector_for
from pseudolidar.running.field_markers import POSITIONAL, RUN_ONLY, THIS_TIME, Recognised
from pseudolidar.running.finding import NEAR_FOLDER, FindFrame, FindShown
from pseudolidar.running.folder import check_usable
from pseudolidar.running.journal.record import FrameRecord
from pseudolidar.running.matching import MatchFrame, Refining
from pseudolidar.running.nearness import Searching
from pseudolidar.running.networks import networks_of, timed
from pseudolidar.running.products.corridor_table import encode_corridor, view_of, watched_in
from pseudolidar.running.products.found import FOUND_FOLDER
from pseudolidar.running.products.found_clouds import (
    KITTI,
    TRACKING_NAME,
    FoundOutputs,
    write_tracking,
)
from pseudolidar.running.products.label_classes import class_warnings
from pseudolidar.running.products.obstacle_film import (
    FILM_FOLDER,
    FILM_NAME,
    ObstacleArtist,
    write_obstacle_film,
)
from pseudolidar.running.products.obstacle_tables import encode_csv, encode_jsonl
from pseudolidar.running.products.recording import RecordingPlan
from pseudolidar.running.products.told import Telling, ToldFrame
from pseudolidar.running.products.told_recording import told_parts
from pseudolidar.running.reports.obstacles_page import pictures_for, write_obstacles_page
from pseudolidar.running.reports.obstacles_report import TOO_NEAR, ObstaclesReport
from pseudolidar.running.reports.samples import sampled_frames
from pseudolidar.running.run import Run
from pseudolidar.running.settings_schema import described
from pseudolidar.running.sighting import SMALL_THINGS_KEPT, SightFrame
from pseudolidar.running.stream import stream
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
from pseudolidar.viewer.address import LOOPBACK, PORT, Port
from pseudolidar.viewer.objects.found_in_order import FindsInOrder, moment_of
from pseudolidar.viewer.run_page import run_page

_log = logging.getLogger(__name__)
TABLES, CORRIDOR = ("obstacles.jsonl", "obstacles.csv"), "corridor.csv"


@dataclass(frozen=True)
class Obstacles:
    """Find what is in front of the cameras in SOURCE: how far, how big, and how sure.

    A detector says where objects are in the pictures; the points behind each are separated from
    ground, background and neighbours, and become an oriented box with error bars. OUT gets
    obstacles.jsonl and obstacles.csv, a line for each obstacle (docs/obstacles.md). A run that was
    stopped or killed is continued by the same command.

        pseudolidar obstacles training out --detector labels --rig rig.json
        pseudolidar obstacles 2011_09_26_drive_0002_sync out --detector regions:boxes.csv
        pseudolidar obstacles left.mp4 out --right right.mp4 --detector regions:480,180,512,202
        pseudolidar obstacles drive_0002_sync out --detector cloud --track tracker --video
        pseudolidar obstacles drive.mcap out --corridor 2x2x30 --stop-at 3
        pseudolidar obstacles drive_0002_sync out --detector cloud --track tracker --view

    Args:
        source: pairs: KITTI data, folders, videos, a recording, synthetic:NAME; or pictures with
            their depth.
        out: output folder.
        to: what is written beside the tables, a comma list: clouds with a column `object`, as pcd,
            pcd:compressed, pcd:ascii, ply, ply:ascii or npz; mcap (one recording of everything, for
            Foxglove, or ROS 2 with --mcap.profile ros2); kitti (label_2 result files, and with
            tracks tracking.txt); none.
        mcap: what the recording holds beside obstacles.
        video: make obstacles.mp4 too (H.264): the photo with boxes, distance, identity and speed,
            beside disparity, depth and the view from above.
        detector: what says where objects are; `none` to watch the corridor alone.
        also: a second one, such as `cloud` for what the first one does not know; what both see is
            one obstacle.
        matcher: how disparities are found.
        rows: bring the rows of the right picture to those of the left one before matching: `auto`
            where points that both eyes see show that they differ, `never`.
        balance: give the right picture the brightness, colours, gamma and vignetting of the left
            one before matching: `auto` for matchers that compare brightness (all but census) where
            the eyes differ, `always`, `never`.
        clean: what is removed of the disparities because it is no surface; `none` keeps all.
            Surfaces of 7 x 7 cm stay, where clouds lose those below 22 x 22 cm.
        ground: how the ground is looked for; `none` where there is none, as in flight.
        track: follow obstacles from frame to frame: identity, velocity and time to contact of each,
            over ground where the source has poses, else relative to the cameras. For frames that
            follow one another.
        corridor: watch a corridor ahead, WIDTHxHEIGHTxLENGTH in m, and tell the nearest thing in
            it, whatever it is, how fast it comes nearer, and when it is reached, or whether the
            corridor is free or cannot be seen: corridor.csv.
        stop_at: end the run, with exit code 10, at the first frame in which something in the
            corridor may be nearer than this, m; the same command again stays stopped there.
        stop_chance: it may be nearer than that where the probability of it, by its distance and the
            error of that, is at least this, 0-1. At 0.5 the distance alone decides.
        near: write near/ID.png for each frame: white where something that is no ground is nearer
            than this, m.
        objects: where there are labels, print each beside what was measured of it, however many
            they are; a few are printed anyhow, and report.html has them.
        frames: only these: slices 100:400:2, ids 13,35, or @FILE with such items.
        exclude: not these.
        rig: calibration that replaces the source's cameras: a rig.json, OpenCV YAML, XML or JSON,
            ROS camera_info, K.txt, calib.txt; a file, a folder, or LEFT,RIGHT. One that `refine`
            corrected makes distances right.
        rig_unit: unit of lengths in a calibration that does not say it: m, cm, mm.
        rectify: how unrectified pairs are rectified, as they load.
        scale_calibration: scale the calibration where images have another size.
        min_depth: nearest depth that must be found, m; decides how many disparities are searched.
            By default what the data set says of its scenes, or the rig of its board, else 3.
        swap: exchange left and right pictures.
        check: look at the first, the middle and the last pair before the run: swapped eyes, rows
            that are off and a calibration for another size stop it, other oddities are warned of.
        workers: frames worked on at the same time; by default one per core.
        timeout: a frame that takes longer is skipped, s.
        on_error: skip a bad frame (and stop when they become many), or stop at the first.
        overwrite: start anew, even where OUT holds a run with other settings.
        view: show on a page what is found while it is found: the printed address, in a browser. At
            a terminal it stays open after the end, until Ctrl-C.
        port: of that page; 0 or `auto` for any that is free.
        host: of that page; others than 127.0.0.1 let other machines in, with the printed token.
    """

    source: Annotated[Source, Recognised(recognise)]
    out: Annotated[Path, POSITIONAL, RUN_ONLY] = Path("out")
    to: FoundOutputs = field(default_factory=FoundOutputs)
    mcap: McapContent = field(default_factory=McapContent)
    video: bool = False
    detector: AnyDetector | None = field(default_factory=Labels)
    also: AnyDetector | None = None
    matcher: Census | Sgbm | Bm | Onnx = field(default_factory=Census)
    rows: RowsWhen = "auto"
    balance: BalanceWhen = "auto"
    clean: Clean | None = SMALL_THINGS_KEPT
    ground: GroundFit | None = field(default_factory=GroundFit)
    track: Tracker | None = None
    corridor: Corridor | None = None
    stop_at: Annotated[float | None, RUN_ONLY] = None
    stop_chance: Annotated[float, RUN_ONLY] = STOP_CHANCE
    near: float | None = None
    objects: Annotated[bool, RUN_ONLY] = False
    frames: FrameSelection | None = None
    exclude: FrameSelection | None = None
    rig: Path | None = None
    rig_unit: RigUnit | None = None
    rectify: Rectify = field(default_factory=Rectify)
    scale_calibration: bool = False
    min_depth: float | None = None
    swap: bool = False
    check: Annotated[bool, RUN_ONLY] = True
    workers: Annotated[int | None, RUN_ONLY] = None
    timeout: Annotated[float, RUN_ONLY] = FRAME_TIMEOUT_S
    on_error: Annotated[OnError, RUN_ONLY] = "skip"
    overwrite: Annotated[bool, RUN_ONLY, THIS_TIME] = False
    view: Annotated[bool, RUN_ONLY, THIS_TIME] = False
    port: Annotated[Port, RUN_ONLY] = PORT
    host: Annotated[str, RUN_ONLY] = LOOPBACK

    def __post_init__(self) -> None:
        for name in ("stop_at", "near"):
            value = getattr(self, name)
            if value is not None and not 0 < value < math.inf:
                raise UsageError(f"{value:g} m", want="above 0", where=f"--{name}")
        if not 0 < self.stop_chance < 1:
            raise UsageError(f"{self.stop_chance:g}", want="between 0 and 1", where="--stop-chance")
        if self.stop_at is not None and self.corridor is None:
            raise UsageError(
                "--stop-at without a corridor", want="one", fix="Add --corridor 2x2x30."
            )

    @property
    def stop(self) -> StopRule | None:
        """When the run ends because something is too near."""
        return None if self.stop_at is None else StopRule(self.stop_at, self.stop_chance)

    @property
    def tracking(self) -> bool:
        """Whether a KITTI tracking file is written."""
        return self.track is not None and KITTI in self.to.kinds

    @property
    def products(self) -> tuple[str, ...]:
        """Files that belong to no single frame."""
        chosen = {CORRIDOR: self.corridor, FILM_NAME: self.video, TRACKING_NAME: self.tracking}
        return (*TABLES, *(name for name, wanted in chosen.items() if wanted))

    @property
    def folders(self) -> tuple[str, ...]:
        """Folders of files of frames."""
        near = () if self.near is None else (NEAR_FOLDER,)
        return (FOUND_FOLDER, FILM_FOLDER, *near, *self.to.folders)

    @property
    def crew(self) -> CrewPlan:
        """How the frames are done."""
        return CrewPlan(self.workers, self.timeout)

    @property
    def searching(self) -> Searching:
        """What disparities are looked for."""
        return Searching(self.matcher, self.min_depth)


def run(job: Obstacles) -> ObstaclesReport:
    """Every frame of the source: match, find, measure; commit in order; tables at the end."""
    source = opened(job)
    check_usable(job.out)
    per_frame = finder(job, source)
    recording = RecordingPlan.of(job, source, wanted=job.to.recording)
    products = (*recording.names, *job.products)
    check_apart(job.out, paths_read(job.source), (*job.folders, *products), overwrite=job.overwrite)
    told: dict[str, ToldFrame] = {}
    corridor, networks = None, networks_of(per_frame)
    with (
        run_page(job, source, moment_of, finds=True) as onlooker,
        Run.open(
            job.out,
            job,
            source,
            products=products,
            networks=networks,
            tell=lambda: timed(networks, per_frame),
        ) as run,
        recording.open(job.out, run.expected(per_frame, crew=job.crew)) as log,
    ):
        settled = run.settled(log.held)
        run.check(
            wanted=job.check and len(settled) < len(source.ids),
            crew=job.crew,
            searching=job.searching,
        )
        telling = Telling(job.out, source.ids, run.committed & settled, job.track)
        told = telling.told  # so far, should the run be stopped
        earlier = (record for record in run.records() if record.id in settled)
        in_order = FindsInOrder(job.corridor, source.ids, watched_in(source, earlier))
        if stopped_at(job, run.records()):  # before: it stays where it stopped
            settled = frozenset(source.ids)
            run.halt(TOO_NEAR)
        shown = FindShown(per_frame, shown=onlooker is not None)
        outcomes = stream(source, shown, crew=job.crew, skip=settled, in_flight=run.in_flight)
        for frame in run.good(outcomes):
            product, found = frame.value.product, frame.value.found
            told_frame = telling(frame.id, product)  # in order: who is who
            parts = told_parts(product.parts, told_frame, index=frame.index, content=job.mcap)
            log.append(frame.id, parts)
            run.commit(Done(frame.id, frame.index, product, frame.cpu_s))
            if onlooker is not None and found is not None:
                onlooker.show(frame.index, in_order(found, told_frame.obstacles))
            if is_too_near(job, product.figures):
                run.halt(TOO_NEAR)
                break
        telling.finish(run.committed)
        run.warn(class_warnings((job.detector, job.also), run.records()))
        write_tables(job, told)
        if job.video:
            seen = {name: frame.obstacles for name, frame in told.items()}
            write_obstacle_film(run, source, seen)
        if job.corridor is not None:
            corridor = watched_in(source, run.records())
            write_atomic(job.out / CORRIDOR, encode_corridor(corridor))
    result = run.result()
    page = write_obstacles_page(
        job.out,
        result,
        told,
        rig=source.rig,
        settings=chosen(job),
        corridor=corridor,
        stop=job.stop,
    )
    files = (*(job.out / name for name in recording.files.values()), *written(job), page)
    judged = tuple(one for frame in told.values() for one in frame.judged)
    return ObstaclesReport(result, job.out, files, corridor, job.stop, judged, job.objects)


def finder(job: Obstacles, source: FrameSequence[Frame]) -> FindFrame:
    """What each frame passes, with everything heavy loaded."""
    match = MatchFrame.load(
        source,
        job.matcher,
        Refining(),
        job.clean,
        eyes=Eyes(job.rows, job.balance),
        min_depth_m=job.min_depth,
    )
    detector = asked(job.detector, job.also)
    detect = None if detector is None else detector_for(detector.load(), source)
    sight = SightFrame.of(match, job.ground, searched_px=job.searching.searched_px(source))
    plain = FindFrame(sight, detect, job.corridor, job.near, job.to, job.mcap)
    if not job.video:
        return replace(plain, pictured=sampled_frames(source.ids, pictures_for(len(source.ids))))
    return replace(plain, artist=ObstacleArtist.of(source, sight, crew=job.crew))


def is_too_near(job: Obstacles, figures: Mapping[str, Any]) -> bool:
    """Whether something in the corridor of a frame may be nearer than `stop_at`."""
    view = view_of(figures)
    return job.stop is not None and view is not None and job.stop.broken_by(view.ahead)


def stopped_at(job: Obstacles, records: Iterable[FrameRecord]) -> bool:
    """Whether one of the frames that are done ended the run."""
    return any(is_too_near(job, record.figures) for record in records)


def write_tables(job: Obstacles, told: Mapping[str, ToldFrame]) -> None:
    """All obstacles of all frames, in the order of the source."""
    obstacles = [one for frame in told.values() for one in frame.fields]
    for name, encode in zip(TABLES, (encode_jsonl, encode_csv), strict=True):
        write_atomic(job.out / name, encode(obstacles))
    if job.tracking:
        write_tracking(job.out, told)


def chosen(job: Obstacles) -> dict[str, str]:
    """What was chosen, for the reader of the report."""
    parts = {"detector": job.detector, "also": job.also, "matcher": job.matcher, "track": job.track}
    return {name: described(part) for name, part in parts.items() if part is not None}


def written(job: Obstacles) -> tuple[Path, ...]:
    """What there is to open."""
    shown = [name for name in job.folders if not name.startswith(".")]
    return tuple(job.out / name for name in (*job.products, *shown))


def opened(job: Obstacles) -> FrameSequence[Frame]:
    """The source with the selection and the rig that the job asks for."""
    every = opened_with_rig(
        job.source,
        job.rig,
        scale_calibration=job.scale_calibration,
        unit=job.rig_unit,
        swap=job.swap,
        rectify=job.rectify,
    )
    source = select(every, job.frames, job.exclude)
    tell(source)
    return source
