"""Point clouds of two cameras while they look: captured, matched, written, told how fast."""

from __future__ import annotations

import math
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Annotated, Any

# The package path of pipelines/ is made at run time; mypy checks the file itself.
from pseudolidar.pipelines.convert import ConvertFrame  # type: ignore[import-untyped]

from pseudolidar.calibration.boards.board import Board, BoardName, Dictionary
from pseudolidar.clouds.beams import BeamCount, Beams
from pseudolidar.clouds.correct import Guide
from pseudolidar.clouds.crop import Box, Range
from pseudolidar.clouds.ground import Label, Remove
from pseudolidar.clouds.normals import Normals
from pseudolidar.clouds.outliers import Lonely
from pseudolidar.clouds.thin import Density, Uniform, Voxel
from pseudolidar.clouds.tool import CloudTools
from pseudolidar.errors import UsageError
from pseudolidar.formats.mcap.content import McapContent
from pseudolidar.formats.rigs.rig_reading import RigUnit
from pseudolidar.geometry.cloud_frames import CloudFrame, default_frame, left_in
from pseudolidar.running.bad_frames import OnError
from pseudolidar.running.crew.crew_plan import CrewPlan
from pseudolidar.running.field_markers import POSITIONAL, RUN_ONLY, THIS_TIME
from pseudolidar.running.folder import check_usable
from pseudolidar.running.live.eye_watch import EyeWatch, Watched
from pseudolidar.running.live.new_views import NewViews
from pseudolidar.running.live.newest import Newest
from pseudolidar.running.live.opening import bare_eyes, opened_bare, opened_cameras, opened_pairs
from pseudolidar.running.live.preview import (
    LIVE_NAME,
    CloudPicture,
    LivePreview,
    PairPicture,
    ShownWhenAsked,
)
from pseudolidar.running.live.record import Choice, record, words_of
from pseudolidar.running.live.rehearsed import rehearsed
from pseudolidar.running.live.saving import EYES, SavePair
from pseudolidar.running.matching import MatchFrame, Refining
from pseudolidar.running.nearness import Searching
from pseudolidar.running.products.encoders import FrameEncoder
from pseudolidar.running.products.outputs import Outputs
from pseudolidar.running.products.recording import RecordingPlan
from pseudolidar.running.products.trees import Trees
from pseudolidar.running.reports.live_report import LiveReport
from pseudolidar.running.unclaimed import check_unclaimed
from pseudolidar.sources.capture.cameras import CameraSettings
from pseudolidar.sources.capture.live_pairs import EveryInterval, LivePairs, OnRequest
from pseudolidar.sources.folder_layout import list_pictures
from pseudolidar.sources.rectified import Rectify
from pseudolidar.sources.source import pairs_of, tell
from pseudolidar.stereo.balance import BalanceWhen
from pseudolidar.stereo.census import Census
from pseudolidar.stereo.eyes import Eyes
from pseudolidar.stereo.filters.clean import Clean
from pseudolidar.stereo.filters.filled_map import Surfaces
from pseudolidar.stereo.filters.smoothed_map import Fgs
from pseudolidar.stereo.neural import Onnx
from pseudolidar.stereo.reproject import Reproject
from pseudolidar.stereo.row_alignment import RowsWhen
from pseudolidar.stereo.sgbm import Bm, Sgbm
from pseudolidar.viewer.address import LOOPBACK, PORT, Port
from pseudolidar.viewer.moment import Moment
from pseudolidar.viewer.run_page import run_page

# A frame that takes longer is skipped; waiting for the cameras is no part of it.
FRAME_S = 120.0


@dataclass(frozen=True)
class Live:
    """Capture pairs, match and reproject them, and write the results to OUT, until told to stop.

    A worker that is free takes the newest pair; pairs that no worker is free for are dropped, so
    that results do not lag. Ctrl-C (or q) ends the run, with all that was written whole; the same
    command adds to it. A camera that vanishes is waited for.

        pseudolidar live 0 2 out --rig rig.json
        pseudolidar live /dev/video0 side-by-side out --rig rig.json --camera.size 2560x720
        pseudolidar live left.mp4 right.mp4 out --realtime --scale 0.5 --to pcd,mcap
        pseudolidar live 0 2 out --rig rig.json --view --host 0.0.0.0
        pseudolidar live 0 2 --capture pairs --board chessboard:9x6

    Args:
        left: camera of the left eye, or of both: 0, /dev/video0, a named pipe, rtsp://, http://,
            tcp://, udp://, or with --realtime a video.
        right: camera of the right eye; or how the pictures of `left` hold both eyes, side-by-side
            or top-bottom (left out, the size of the rig tells).
        out: output folder.
        to: what is written of each frame, a comma list: pcd, pcd:compressed, pcd:ascii, ply,
            ply:ascii, bin, npz, disparity, depth, mcap.
        capture: only save pairs into this folder, to calibrate the cameras with: PNGs in left and
            right. Space saves one, q ends; or see --every and --board.
        every: save a pair each time so many seconds have passed.
        board: save a pair each time both eyes see this board held still, sharp, in a new way, and
            tell where to hold it next: `chessboard:9x6`, `charuco:8x6`, as `calibrate` takes it.
        square: side of a square of the board, m; matters for boards with markers.
        marker: side of a ChArUco marker, or gap between the tags of an AprilGrid, m.
        dictionary: of the markers.
        rig: calibration of the cameras: a rig.json, OpenCV YAML, XML or JSON, ROS camera_info,
            K.txt, calib.txt; a file, a folder, or LEFT,RIGHT. By default a rig file beside a video,
            or in the folder that the command is called from.
        rig_unit: unit of lengths in a calibration that does not say it: m, cm, mm.
        scale_calibration: scale the calibration where the cameras give another size.
        rectify: how pictures of cameras that are not rectified become rectified ones.
        scale: size at which pairs are matched, of that of the pictures: 0.5 for small computers.
        realtime: play videos as if live.
        preview: renew OUT/live.jpg about once a second: photo, disparity and cloud from above of
            the newest frame; with --capture both eyes as they are.
        view: show on a page what is made while it is made: the printed address, in a browser. It
            ends with the run.
        port: of that page; 0 or `auto` for any that is free.
        host: of that page; others than 127.0.0.1 let other machines in, with the printed token.
        camera: how cameras are opened and paired.
        matcher: how disparities are found.
        rows: bring the rows of the right picture to those of the left one before matching: `auto`
            where points that both eyes see show that they differ, `never`.
        balance: give the right picture the brightness, colours, gamma and vignetting of the left
            one before matching: `auto` for matchers that compare brightness (all but census) where
            the eyes differ, `always`, `never`.
        clean: what is removed of the disparities because it is no surface; `none` keeps all.
        smooth: how disparities are smoothed before they become points.
        fill: how holes between matched pixels are filled.
        reproject: which pixels become points, and how.
        outliers: which points are removed.
        ground: what happens to the ground's points: label them (column `ground`), or remove them.
        crop: only points in a box, or at some distance.
        normals: add the directions that surfaces face, columns nx, ny, nz.
        beams: only what a spinning LiDAR would measure, an HDL-64E or one with fewer beams.
        thin: fewer points, how.
        mcap: what a recording holds.
        min_depth: nearest depth that must be found, m; decides how many disparities are searched.
        frame: coordinate frame of the clouds: velodyne, camera_left or base_link, by default
            velodyne where that is calibrated, else camera_left. `.bin` is always x forward.
        swap: exchange left and right pictures.
        seconds: end after so many.
        frames_count: end after so many frames.
        check: look at a first pair: swapped eyes and rows that are off stop the run, other oddities
            are warned of.
        workers: frames worked on at the same time; by default one per core.
        on_error: skip a bad frame, or stop at the first.
        overwrite: start anew, even where OUT holds a run with other settings.
    """

    left: Annotated[str, POSITIONAL, RUN_ONLY]
    right: Annotated[str | None, POSITIONAL, RUN_ONLY] = None
    out: Annotated[Path, POSITIONAL, RUN_ONLY] = Path("out")
    to: Outputs = field(default_factory=lambda: Outputs(("mcap",)))
    capture: Annotated[Path | None, RUN_ONLY] = None
    every: Annotated[float | None, RUN_ONLY] = None
    board: Annotated[BoardName | None, RUN_ONLY] = None
    square: Annotated[float, RUN_ONLY] = 0.03
    marker: Annotated[float | None, RUN_ONLY] = None
    dictionary: Annotated[Dictionary | None, RUN_ONLY] = None
    rig: Path | None = None
    rig_unit: RigUnit | None = None
    scale_calibration: bool = False
    rectify: Rectify = field(default_factory=Rectify)
    scale: float = 1.0
    realtime: Annotated[bool, RUN_ONLY] = False
    preview: Annotated[bool, RUN_ONLY] = False
    view: Annotated[bool, RUN_ONLY, THIS_TIME] = False
    port: Annotated[Port, RUN_ONLY] = PORT
    host: Annotated[str, RUN_ONLY] = LOOPBACK
    camera: Annotated[CameraSettings, RUN_ONLY] = field(default_factory=CameraSettings)
    matcher: Census | Sgbm | Bm | Onnx = field(default_factory=Census)
    rows: RowsWhen = "auto"
    balance: BalanceWhen = "auto"
    clean: Clean | None = field(default_factory=Clean)
    smooth: Fgs | None = None
    fill: Surfaces | None = None
    reproject: Reproject = field(default_factory=Reproject)
    outliers: Lonely | None = None
    ground: Label | Remove | None = None
    crop: Box | Range | None = None
    normals: bool = False
    beams: BeamCount | None = None
    thin: Voxel | Uniform | Density | None = None
    mcap: McapContent = field(default_factory=McapContent)
    min_depth: float | None = None
    frame: CloudFrame | None = None
    swap: bool = False
    seconds: Annotated[float | None, RUN_ONLY] = None
    frames_count: Annotated[int | None, RUN_ONLY] = None
    check: Annotated[bool, RUN_ONLY] = True
    workers: Annotated[int | None, RUN_ONLY] = None
    on_error: Annotated[OnError, RUN_ONLY] = "skip"
    overwrite: Annotated[bool, RUN_ONLY, THIS_TIME] = False

    def __post_init__(self) -> None:
        if not 0 < self.scale <= 1:
            raise UsageError(f"{self.scale:g}", want="above 0, at most 1", where="--scale")
        limits = {"seconds": self.seconds, "frames-count": self.frames_count, "every": self.every}
        for name, value in limits.items():
            if value is not None and not (value > 0 and math.isfinite(value)):
                raise UsageError(f"{value:g}", want="a number above 0", where=f"--{name}")
        choosing = [name for name in ("every", "board") if getattr(self, name) is not None]
        if choosing and (self.capture is None or len(choosing) > 1):
            raise UsageError(
                " and ".join(f"--{name}" for name in choosing)
                + ("" if self.capture else " without --capture DIR"),
                want="--capture DIR with one of them, or neither",
            )
        if self.rectify.views != 1:
            raise UsageError(
                f"{self.rectify.views} views of live cameras",
                want="1",
                fix="Record first, --capture DIR --every, then convert the pairs.",
                where="--rectify.views",
            )
        if self.view and self.capture is not None:
            raise UsageError(
                "--view of pairs that are only saved", want="--preview", where="--view"
            )
        if self.to.trees:
            names = ", ".join(self.to.trees)
            raise UsageError(
                f"{names} of a live run",
                want="files or mcap",
                fix="Record first, --to mcap, then convert the recording.",
                where="--to",
            )

    @property
    def crew(self) -> CrewPlan:
        """How the frames are done; to save pairs takes any time, as somebody presses a key."""
        timeout_s = math.inf if self.capture else FRAME_S + self.camera.patience_s
        return CrewPlan(self.workers, timeout_s)


def run(job: Live) -> LiveReport:
    """Do every pair that a worker is free for: match, reproject, encode; commit in order."""
    if job.capture is not None:
        return save_pairs(replace(job, out=job.capture))
    check_usable(job.out)
    with opened_cameras(job) as cameras:
        source = opened_pairs(job, cameras)
        tell(source)
        recording = RecordingPlan.of(job, source, wanted=job.to.recording)
        written = (*job.to.folders, *recording.names, LIVE_NAME)
        check_unclaimed(job.out, written, overwrite=job.overwrite)
        per_frame = convert_frame(job, source)
        searching = Searching(job.matcher, job.min_depth)
        seen = rehearsed(source, per_frame, check=job.check, searching=searching)
        watch = EyeWatch(swap=job.swap)
        looking = Newest("eyes", watch, idle_s=1.0) if job.check and seen == "unknown" else None
        preview = LivePreview(job.out / LIVE_NAME, CloudPicture()) if job.preview else None
        with run_page(job, source, Moment.of, endless=True) as onlooker:
            seen_by = per_frame.shown_to(preview, onlooker)
            work = seen_by if looking is None else Watched(seen_by, looking)
            shown = [one for one in (preview, looking) if one is not None]
            order = (lambda: watch.order) if looking else (lambda: seen)
            return record(job, cameras, source, work, recording, shown=shown, eyes=order)


def convert_frame(job: Live, source: LivePairs[Any]) -> ConvertFrame:
    """The work on a frame, the same as that of `convert`."""
    rig = pairs_of(source).rig
    left_in(rig, job.frame or default_frame(rig))  # a wrong --frame ends the run here
    refining = Refining(None, job.smooth, job.fill)
    match = MatchFrame.load(
        source,
        job.matcher,
        refining,
        job.clean,
        eyes=Eyes(job.rows, job.balance),
        min_depth_m=job.min_depth,
    )
    normals = Normals() if job.normals else None
    beams = None if job.beams is None else Beams(job.beams)
    tools = CloudTools.load(job.outliers, job.ground, job.crop, normals, beams, job.thin)
    encode = FrameEncoder(job.to, job.mcap, Trees(()), frozenset())
    return ConvertFrame(match, job.reproject.load(), Guide.unused(), job.frame, tools, encode)


def save_pairs(job: Live) -> LiveReport:
    """Only save pairs: by key, by time, or by what is to be seen of a board."""
    check_usable(job.out)
    lying = [path.name for path in list_pictures(job.out)] if job.out.is_dir() else []
    check_unclaimed(job.out, (*EYES, *lying, LIVE_NAME), overwrite=job.overwrite)
    by = chosen_by(job)
    with opened_cameras(job) as cameras:
        picture = PairPicture(bare_eyes(job), words_of(by))
        preview = LivePreview(job.out / LIVE_NAME, picture) if job.preview else None
        wanted = by if preview is None else ShownWhenAsked(by, preview)
        shown = () if preview is None else (preview,)
        source = opened_bare(job, cameras, wanted)
        tell(source)
        return record(job, cameras, source, SavePair(), RecordingPlan(), by=by, shown=shown)


def chosen_by(job: Live) -> Choice:
    """Which pairs are saved."""
    if job.board is None:
        return OnRequest() if job.every is None else EveryInterval(job.every)
    board = Board.of(job.board, job.square, marker_m=job.marker, dictionary=job.dictionary)
    return NewViews(board, bare_eyes(job))
