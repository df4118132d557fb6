"""Where the cameras were, and what the world looks like."""

from __future__ import annotations

import contextlib
import shutil
import time
from collections.abc import Callable, Sequence
from contextlib import AbstractContextManager
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Annotated

from pseudolidar.clouds.ground_fit import GroundFit
from pseudolidar.errors import ALL_DONE, SOME_SKIPPED, UsageError
from pseudolidar.formats.mcap.content import McapContent
from pseudolidar.formats.rigs.rig_json import write_rig
from pseudolidar.formats.rigs.rig_reading import RigUnit
from pseudolidar.mapping.loops import LoopFinder
from pseudolidar.mapping.odometry import Fused, Kiss, Vision
from pseudolidar.mapping.place_store import PlaceFile
from pseudolidar.obstacles.detectors import AnyDetector
from pseudolidar.running.apart import check_apart, paths_read
from pseudolidar.running.bad_frames import OnError
from pseudolidar.running.crew.attempt import Done
from pseudolidar.running.crew.crew_plan import FRAME_TIMEOUT_S, CrewPlan
from pseudolidar.running.drawn_frames import detector_for
from pseudolidar.running.field_markers import (
    AFTERWARDS,
    POSITIONAL,
    RUN_ONLY,
    THIS_TIME,
    Recognised,
)
from pseudolidar.running.folder import check_usable
from pseudolidar.running.mapped.build import FRAME_FOLDER, MapSettings, built
from pseudolidar.running.mapped.checkpoints import Checkpoints
from pseudolidar.running.mapped.finished import FINISHED_FILE, Finished, FinishedReport
from pseudolidar.running.mapped.frame_table import FRAME_TABLE, write_frame_table
from pseudolidar.running.mapped.glimpse import Glimpse
from pseudolidar.running.mapped.map_files import TILE_FOLDER, WHOLE_NAME, Made, write_map
from pseudolidar.running.mapped.map_outputs import MapOutputs
from pseudolidar.running.mapped.map_recording import plan_recording, write_recording
from pseudolidar.running.mapped.mesh_outputs import MeshOutputs, mesh_figures
from pseudolidar.running.mapped.occupancy_outputs import OCCUPANCY_FILES, write_occupancy
from pseudolidar.running.mapped.odometry_film import ODOMETRY_FILM, OdometryFilm
from pseudolidar.running.mapped.rehearsed import MapRehearsal, rehearse_map
from pseudolidar.running.mapped.stored import PLACES_FILE, WORK_FOLDER, MatchOnce
from pseudolidar.running.mapped.trajectory_files import KITTI_NAME, TUM_NAME, write_trajectories
from pseudolidar.running.mapped.walk import Walk
from pseudolidar.running.mapped.walked import Piece, Walked
from pseudolidar.running.matching import MatchFrame, Refining
from pseudolidar.running.nearness import Searching
from pseudolidar.running.networks import networks_of
from pseudolidar.running.preflight import preflight
from pseudolidar.running.products.recording import RecordingPlan
from pseudolidar.running.reports.conversion_page import REPORT_NAME
from pseudolidar.running.reports.map_page import write_map_page
from pseudolidar.running.reports.map_report import MapReport, errors_of
from pseudolidar.running.run import Run
from pseudolidar.running.settings_json import to_json
from pseudolidar.running.settings_schema import described
from pseudolidar.running.sighting import SightFrame
from pseudolidar.running.stream import stream
from pseudolidar.sources.other_rig import opened_with_rig
from pseudolidar.sources.recognise import Source, recognise
from pseudolidar.sources.rectified import Rectify
from pseudolidar.sources.selection import FrameSelection, select
from pseudolidar.sources.source import FrameSource, pairs_of, tell
from pseudolidar.stereo.balance import BalanceWhen
from pseudolidar.stereo.census import Census
from pseudolidar.stereo.eyes import Eyes
from pseudolidar.stereo.filters.clean import Clean
from pseudolidar.stereo.neural import Onnx
from pseudolidar.stereo.reproject import Reproject, Reprojector
from pseudolidar.stereo.row_alignment import RowsWhen
from pseudolidar.stereo.sgbm import Bm, Sgbm
from pseudolidar.structures.camera import StereoRig
from pseudolidar.viewer.address import LOOPBACK, PORT, Port
from pseudolidar.viewer.moment import Moment
from pseudolidar.viewer.run_page import run_page

RIG_NAME = "rig.json"


@dataclass(frozen=True)
class Map:
    """Chain the pairs of SOURCE into a path and a map, and write both to OUT.

    Stereo visual odometry finds how the cameras moved; KISS-ICP's map and the pictures check every
    step. Frames of which nothing is seen are put between those beside them, marked, and in no map;
    where they are more than five in a row the path ends, and another one begins. Where the source
    knows its poses (KITTI, synthetic:street), the path is compared with them. Killed and started
    again, a run does not match again what it has matched, and goes on along the path from at most
    50 frames ago, or a 20th of them; one that is done says so and tells its figures again.

        pseudolidar map synthetic:street:40 out/street
        pseudolidar map synthetic:street:40 out/street --view
        pseudolidar map KITTI/2011_09_26/2011_09_26_drive_0002_sync out/drive
        pseudolidar map KITTI_odometry out/06 --sequence 06 --json
        pseudolidar map drive.mcap out/drive --odometry vision --detector onnx:yolox_nano.onnx

    The map holds what several frames agree on: disparities of neighbouring frames are fused, points
    averaged over 5 cm, with colour, normal, sigma and how many frames saw them; what later frames
    see through, as trails of cars, is left out. OUT/map.ply is all of it, OUT/tiles are squares.
    OUT/trajectory.tum holds poses of `base_link` in `map`, which is `base_link` of the first frame;
    OUT/trajectory_kitti.txt those of the left camera in its first; OUT/report.html shows them.

    Args:
        source: pairs: KITTI data, folders, videos, a recording, synthetic:NAME, in order of time.
        out: folder for the results.
        to: formats of the map, a comma list of pcd, ply, npz, bin; mcap for a recording of frames
            where they were taken, the way, and the map as it came into view; or `none` for the path
            alone.
        mcap: what the recording holds.
        frame_clouds: formats of the points of each frame, in `map`: OUT/frames; `none` by default.
        mesh: make a mesh too, in which depths count by their sigma: --map.mesh.voxel-m 0.05 for a
            finer one. It is not closed; its holes are counted.
        mesh_to: formats of the mesh, a comma list of ply, glb, obj.
        occupancy: write what robots need too: occupancy.ply (voxels), grid.yaml and grid.pgm (flat
            map for map_server and nav2), distances.npz (to the nearest obstacle), the last two with
            wider cells by --map.occupancy.cell-m 0.3.
        debug_video: make odometry.mp4 (H.264): the points that were followed with their ways, blue
            those that agree and orange the others, who was asked about the step, disparities.
        odometry: vision alone; `kiss`, KISS-ICP on the scans of a LiDAR alone; or `fused`, vision
            whose every step is checked by the pictures and laid on KISS-ICP's map.
        loops: how returns to known places are found, by which the path is closed; `none` for not.
        map: how the map is made: --map.tiles.voxel 0.1 for a coarser one.
        detector: masks what may move by itself, such as the cars that a network finds; without it
            what moves is found by its motion, which takes less than half of the picture to move.
        matcher: how disparities are found.
        rows: bring the rows of the right picture to those of the left one before matching: `auto`
            where points that both eyes see show that they differ, `never`.
        balance: give the right picture the brightness, colours, gamma and vignetting of the left
            one before matching: `auto`, `always`, `never`.
        clean: what is removed of the disparities because it is no surface; `none` keeps all.
        frames: only these: slices 100:400:2, ids 13,35, or @FILE with such items.
        exclude: not these.
        rig: calibration that replaces the source's cameras: a rig.json, OpenCV YAML, XML or JSON,
            ROS camera_info, K.txt, calib.txt; a file, a folder, or LEFT,RIGHT.
        rig_unit: unit of lengths in a calibration that does not say it: m, cm, mm.
        rectify: how unrectified pairs are rectified, as they load.
        scale_calibration: scale the calibration where images have another size.
        min_depth: nearest depth that must be found, m. By default what the data set says of its
            scenes, or the rig of its board, else 3.
        swap: exchange left and right pictures.
        check: look at the first, the middle and the last pair before the run.
        keep_work: keep the disparities in OUT/.work, so that the command given again with other
            outputs (--to, --mesh, --occupancy, --frame-clouds) need not match again.
        workers: frames matched at the same time; by default one per core.
        timeout: a frame that takes longer is skipped, s.
        on_error: skip a bad frame (and stop when they become many), or stop at the first.
        overwrite: start anew, even where OUT holds a run with other settings.
        view: show on a page what is made while it is made: the printed address, in a browser. At a
            terminal it stays open after the end, until Ctrl-C.
        port: of that page; 0 or `auto` for any that is free.
        host: of that page; others than 127.0.0.1 let other machines in, with the printed token.
        dry_run: map a few frames from the midst in a temporary folder, and tell what all would
            take: time of matching, odometry and map, bytes, free disk; nothing is left.
    """

    source: Annotated[Source, Recognised(recognise)]
    out: Annotated[Path, POSITIONAL, RUN_ONLY] = Path("out")
    to: Annotated[MapOutputs, AFTERWARDS] = field(default_factory=MapOutputs)
    mcap: McapContent = field(default_factory=McapContent)
    frame_clouds: Annotated[MapOutputs, AFTERWARDS] = field(default_factory=lambda: MapOutputs(()))
    mesh: Annotated[bool, AFTERWARDS] = False
    mesh_to: Annotated[MeshOutputs, AFTERWARDS] = field(default_factory=MeshOutputs)
    occupancy: Annotated[bool, AFTERWARDS] = False
    debug_video: bool = False
    odometry: Fused | Vision | Kiss = field(default_factory=Fused)
    loops: LoopFinder | None = field(default_factory=LoopFinder)
    map: MapSettings = field(default_factory=MapSettings)
    detector: AnyDetector | None = None
    matcher: Census | Sgbm | Bm | Onnx = field(default_factory=Census)
    rows: RowsWhen = "auto"
    balance: BalanceWhen = "auto"
    clean: Clean | None = field(default_factory=Clean)
    frames: FrameSelection | None = None
    exclude: FrameSelection | None = None
    rig: Path | None = None
    rig_unit: RigUnit | None = None
    rectify: Rectify = field(default_factory=Rectify)
    scale_calibration: bool = False
    min_depth: float | None = None
    swap: bool = False
    check: Annotated[bool, RUN_ONLY] = True
    keep_work: Annotated[bool, RUN_ONLY] = False
    workers: Annotated[int | None, RUN_ONLY] = None
    timeout: Annotated[float, RUN_ONLY] = FRAME_TIMEOUT_S
    on_error: Annotated[OnError, RUN_ONLY] = "skip"
    overwrite: Annotated[bool, RUN_ONLY, THIS_TIME] = False
    view: Annotated[bool, RUN_ONLY, THIS_TIME] = False
    port: Annotated[Port, RUN_ONLY] = PORT
    host: Annotated[str, RUN_ONLY] = LOOPBACK
    dry_run: Annotated[bool, RUN_ONLY, THIS_TIME] = False

    def __post_init__(self) -> None:
        if self.frame_clouds.recording:
            raise UsageError(
                "clouds of frames as mcap",
                want="formats of clouds, or none",
                fix="--to mcap is a recording of all frames.",
                where="--frame-clouds",
            )

    @property
    def crew(self) -> CrewPlan:
        """How the frames are matched."""
        return CrewPlan(self.workers, self.timeout)

    @property
    def searching(self) -> Searching:
        """What disparities are looked for."""
        return Searching(self.matcher, self.min_depth)

    @property
    def products(self) -> tuple[str, ...]:
        """Files that belong to no single frame."""
        maps = tuple(f"{WHOLE_NAME}.{kind}" for kind in self.to.clouds)
        film = (ODOMETRY_FILM,) if self.debug_video else ()
        meshes = self.mesh_to.files if self.mesh else ()
        robots = OCCUPANCY_FILES if self.occupancy else ()
        path = (TUM_NAME, KITTI_NAME, FRAME_TABLE, RIG_NAME)
        return (*path, *maps, *meshes, *robots, *film, FINISHED_FILE)

    @property
    def folders(self) -> tuple[str, ...]:
        """Folders that are written to."""
        frames = (FRAME_FOLDER,) if self.frame_clouds.clouds else ()
        return (WORK_FOLDER, TILE_FOLDER, *frames)


def run(job: Map) -> MapReport | FinishedReport | MapRehearsal:
    """Match every frame, chain them in order; then the map, along the path as known at the end."""
    source = opened(job)
    check_usable(job.out)
    match_once = matcher_of(job, source)
    if job.dry_run:
        return rehearsed(job, source, match_once)
    recording = plan_recording(job, source, wanted=job.to.recording)
    products = (*recording.names, *job.products)
    check_apart(job.out, paths_read(job.source), (*job.folders, *products), overwrite=job.overwrite)
    with (
        run_page(job, source, onlooking()) as onlooker,
        Run.open(job.out, job, source, products=products, networks=networks_of(match_once)) as run,
        contextlib.ExitStack() as closing,
    ):
        finished = Finished(run, [*products, *job.frame_clouds.kinds, to_json(job.map)])
        if (told := told_before(job, run, finished)) is not None:
            forget_work(job, run)  # of an earlier run that was killed at its end, or kept it
            return told
        places = closing.enter_context(places_of(job))
        known = run.committed
        more = len(known) < len(source.ids)
        run.check(wanted=job.check and more, crew=job.crew, searching=job.searching)
        match_once = replace(match_once, known=known)
        checkpoints = Checkpoints(
            job.out, run.decided_by, places, drawn=job.debug_video, crew=job.crew
        )
        walk = checkpoints.last(run, match_once) or begun(job, source, places)
        passed, begun_s = frozenset(one.id for one in walk.placed), time.monotonic()
        film = OdometryFilm(job.out) if job.debug_video else None
        outcomes = stream(source, match_once, crew=job.crew, skip=passed, in_flight=run.in_flight)
        for frame in run.good(outcomes, again=len(known - passed)):
            matched = frame.value
            registered = walk.step(matched.frame, matched.disparity, matched.movable)
            if frame.id not in known:
                run.commit(Done(frame.id, frame.index, matched.product, frame.cpu_s))
            if film is not None:
                film.add(matched, registered, walk.placed[0].id)
            if onlooker is not None:
                seen = Glimpse.of(matched.frame, matched.disparity, registered.state)
                onlooker.show(frame.index, seen)
            walk = checkpoints.after(walk)
        seconds = time.monotonic() - begun_s
        walked = walk.walked()
        rig = source.rig.with_correction(walk.correction or source.rig.correction)
        files = path_files(job, run, walk, walked, rig)
        if film is not None:
            files = (*files, film.finish(run, source))
        made = mapped(job, source, walked.pieces, rig, recording)
        if onlooker is not None:
            onlooker.lay(WHOLE_NAME, made.shown)
            onlooker.lay_mesh(made.mesh)
    if run.result().ended_early:
        return MapReport.stopped(run.result(), job.out)
    steps = len(walk.placed) - len(passed)
    pace_s, errors = seconds / steps if steps else None, errors_of(walked.pieces)
    files, result = (*files, *made.files), run.result()
    report = MapReport(result, job.out, walked, errors, pace_s, files, made.figures)
    report = write_map_page(report, source, made, settings=chosen(job))
    finished.keep(report)
    forget_work(job, run)
    return report


def rehearsed(job: Map, source: FrameSource, match_once: MatchOnce) -> MapRehearsal:
    """What a run would take."""
    preflight(source, wanted=job.check, crew=job.crew, searching=job.searching)
    recording = plan_recording(job, source, wanted=job.to.recording)
    walk = begun(job, source, None)

    def make(folder: Path, pieces: Sequence[Piece]) -> Made:
        rig = source.rig.with_correction(walk.correction or source.rig.correction)
        return mapped(replace(job, out=folder), source, pieces, rig, recording)

    loops = () if job.loops is None else ("closing loops",)
    besides = (*loops, REPORT_NAME, *((ODOMETRY_FILM,) if job.debug_video else ()))
    return rehearse_map(
        source, match_once, walk, make, folder=job.out, crew=job.crew, besides=besides
    ).checked()


def told_before(job: Map, run: Run, finished: Finished) -> FinishedReport | None:
    """What an earlier run told; None where something is left to do, or to be looked at."""
    work_is_missing = len(run.committed) < len(run.source.ids)
    return None if job.view or (job.keep_work and work_is_missing) else finished.report()


def places_of(job: Map) -> AbstractContextManager[PlaceFile | None]:
    """Where the finder of loops keeps places; None where returns are not looked for."""
    if job.loops is None:
        return contextlib.nullcontext()
    return PlaceFile(job.out / PLACES_FILE)


def begun(job: Map, source: FrameSource, places: PlaceFile | None) -> Walk:
    """A walk before its first frame."""
    loops = None if job.loops is None else job.loops.start(source.rig, places)
    return Walk(job.odometry.start(source.rig), source.rig, loops)


def onlooking() -> Callable[[Glimpse], Moment]:
    """A frame on its way to what there is to see of it."""
    reproject = Reprojector(Reproject())
    return lambda glimpse: Moment.of(glimpse.converted(reproject))


def path_files(job: Map, run: Run, walk: Walk, walked: Walked, rig: StereoRig) -> tuple[Path, ...]:
    """Write the path, how each pose came about, and the rig with what its motion told of it."""
    files = write_trajectories(job.out, walked.pieces, rig)
    table = write_frame_table(job.out, walked, run.source.ids, run.result().skipped)
    files = (*files, table)
    if walk.correction is None:
        return files
    write_rig(job.out / RIG_NAME, rig)
    return (*files, job.out / RIG_NAME)


def mapped(
    job: Map,
    source: FrameSource,
    pieces: Sequence[Piece],
    rig: StereoRig,
    recording: RecordingPlan,
) -> Made:
    """The map of the longest piece of path, and its recording; nothing where none is wanted."""
    kinds = job.frame_clouds.clouds
    if not pieces or not (job.to.kinds or kinds or job.mesh or job.occupancy):
        return Made()
    builder = built(
        job.out,
        source,
        pieces[0],
        rig,
        job.map,
        frame_kinds=kinds,
        meshed=job.mesh,
        occupied=job.occupancy,
    )
    made = write_map(job.out, builder.clouds(), job.to.clouds)
    if builder.mesh is not None:
        mesh = builder.mesh.extract()
        files = job.mesh_to.write(job.out, mesh)
        made = made.also(files, {"mesh": mesh_figures(mesh, builder.mesh.voxel_m)})
        made = replace(made, mesh=max(files, default=None))  # a PLY, where it is one of them
    if builder.occupancy is not None:
        files, figures, grid = write_occupancy(job.out, builder.occupancy)
        made = replace(made.also(files, {"occupancy": figures}), grid=grid)
    if kinds:
        made = made.also((job.out / FRAME_FOLDER,))
    if job.to.recording:
        files = write_recording(
            job.out,
            source,
            pieces[0],
            rig,
            made.shown,
            plan=recording,
            content=job.mcap,
            crew=job.crew,
        )
        made = made.also(files)
    return made


def forget_work(job: Map, run: Run) -> None:
    """Remove what a run that is done works with, unless it is to be kept."""
    if not job.keep_work and run.result().exit_code in (ALL_DONE, SOME_SKIPPED):
        shutil.rmtree(job.out / WORK_FOLDER, ignore_errors=True)


def matcher_of(job: Map, source: FrameSource) -> MatchOnce:
    """What each frame passes, with everything heavy loaded."""
    match = MatchFrame.load(
        source,
        job.matcher,
        Refining(),
        job.clean,
        eyes=Eyes(job.rows, job.balance),
        min_depth_m=job.min_depth,
    )
    if job.detector is None:
        return MatchOnce(match, job.out)
    sight = SightFrame.of(match, GroundFit(), searched_px=job.searching.searched_px(source))
    return MatchOnce(match, job.out, sight=sight, detect=detector_for(job.detector.load(), source))


def chosen(job: Map) -> dict[str, str]:
    """What was chosen, for the reader of the report."""
    parts = {"odometry": job.odometry, "matcher": job.matcher, "detector": job.detector}
    return {name: described(part) for name, part in parts.items() if part is not None}


def opened(job: Map) -> FrameSource:
    """The source with the selection and the rig that the job asks for.

    Raises:
        NoPairs: it has no rectified pairs.
    """
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
    return pairs_of(source)
