"""Stereo pairs to point clouds, depth maps and recordings that other tools open."""

from __future__ import annotations

import logging
from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from functools import partial
from pathlib import Path
from typing import Annotated

from pseudolidar.clouds.beams import BeamCount, Beams
from pseudolidar.clouds.correct import Guide, Scan
from pseudolidar.clouds.crop import Box, Range
from pseudolidar.clouds.ground import Label, Remove
from pseudolidar.clouds.normals import Normals
from pseudolidar.clouds.outliers import Lonely
from pseudolidar.clouds.thin import Density, Uniform, Voxel
from pseudolidar.clouds.tool import CloudTools
from pseudolidar.errors import PseudolidarError, UsageError
from pseudolidar.formats.mcap.content import McapContent
from pseudolidar.formats.rigs.rig_reading import RigUnit
from pseudolidar.geometry.cloud_frames import CloudFrame, default_frame, left_in, placed
from pseudolidar.geometry.depth import depth_map
from pseudolidar.geometry.frames import camera_tree
from pseudolidar.running.apart import check_apart, paths_read
from pseudolidar.running.bad_frames import OnError
from pseudolidar.running.body_clouds import joined_on_body
from pseudolidar.running.crew.crew_plan import FRAME_TIMEOUT_S, CrewPlan
from pseudolidar.running.field_markers import POSITIONAL, RUN_ONLY, THIS_TIME, Recognised
from pseudolidar.running.folder import check_usable
from pseudolidar.running.frame_checks import (
    check_points,
    scale_notes,
)
from pseudolidar.running.given import GivenSettings, given_maps
from pseudolidar.running.live.newest import Newest
from pseudolidar.running.matching import MatchFrame, Refining
from pseudolidar.running.nearness import Searching
from pseudolidar.running.networks import networks_of
from pseudolidar.running.preflight import preflight
from pseudolidar.running.products.colmap_model import ColmapModel
from pseudolidar.running.products.converted import Converted
from pseudolidar.running.products.encoders import FrameEncoder
from pseudolidar.running.products.kitti_tree import KittiTree
from pseudolidar.running.products.outputs import Outputs
from pseudolidar.running.products.preview import PREVIEW_NAME, Preview, PreviewArtist, write_preview
from pseudolidar.running.products.product import Product
from pseudolidar.running.products.recording import RecordingPlan
from pseudolidar.running.products.trees import Trees
from pseudolidar.running.rehearsal import Rehearsal, fitting, rehearse
from pseudolidar.running.reports.conversion_page import write_conversion_page
from pseudolidar.running.reports.conversion_report import ConvertReport
from pseudolidar.running.reports.samples import sampled_frames
from pseudolidar.running.run import Run
from pseudolidar.running.settings_schema import described
from pseudolidar.running.stream import stream
from pseudolidar.sources.body import parts_of
from pseudolidar.sources.other_rig import opened_with_rig
from pseudolidar.sources.recognise import Source, recognise
from pseudolidar.sources.rectified import Rectify
from pseudolidar.sources.scans_put_right import Scans, possible, put_right
from pseudolidar.sources.selection import FrameSelection, select
from pseudolidar.sources.source import FrameSequence, pairs_of, tell
from pseudolidar.stereo.balance import BalanceWhen
from pseudolidar.stereo.census import Census
from pseudolidar.stereo.eyes import Eyes
from pseudolidar.stereo.filters.clean import Clean
from pseudolidar.stereo.filters.filled_map import Surfaces
from pseudolidar.stereo.filters.smoothed_map import Fgs
from pseudolidar.stereo.filters.temporal import Kalman
from pseudolidar.stereo.given_maps import StoredSteps
from pseudolidar.stereo.neural import Onnx
from pseudolidar.stereo.reproject import Reproject, Reprojector
from pseudolidar.stereo.row_alignment import RowsWhen
from pseudolidar.stereo.sgbm import Bm, Sgbm
from pseudolidar.structures.body import BodyFrame
from pseudolidar.structures.frame import StereoFrame
from pseudolidar.structures.recorded import DepthFrame, Frame, RecordedCloud
from pseudolidar.viewer.address import LOOPBACK, PORT, Port
from pseudolidar.viewer.moment import Moment
from pseudolidar.viewer.run_page import run_page

_log = logging.getLogger(__name__)
MATCHED = (StereoFrame, BodyFrame)


@dataclass(frozen=True)
class Convert:
    """Match every pair of SOURCE, reproject it, and write the results to OUT.

    A run that was stopped or killed is continued by the same command. A frame that cannot be used
    is left out and named in report.json (exit code 4).

        pseudolidar convert synthetic:street out/street
        pseudolidar convert 2011_09_26_drive_0002_sync out --to pcd,mcap
        pseudolidar convert training out --matcher sgbm --frames 0:100:10 --to bin
        pseudolidar convert left.mp4 out --right right.mp4 --rig rig.json
        pseudolidar convert 2011_09_26_drive_0002_sync out --view

    Args:
        source: KITTI raw, object, odometry or stereo data, Middlebury or ETH3D scenes, folders of
            pictures of two eyes or of pictures and depth, videos of two eyes, clouds, recordings,
            several pairs on one body (rig.json and a folder for each pair: their clouds are joined
            in base_link, column `source` says which pair saw a point), synthetic:NAME.
        out: output folder.
        to: what is written of each frame, a comma list: pcd, pcd:compressed, pcd:ascii, ply,
            ply:ascii, bin, npz, disparity, depth, mcap; kitti (training tree of OpenPCDet and
            MMDetection3D), colmap (cameras, poses and points for splatting tools).
        matcher: how disparities are found.
        rows: bring the rows of the right picture to those of the left one before matching: `auto`
            where points that both eyes see show that they differ, `never`.
        balance: give the right picture the brightness, colours, gamma and vignetting of the left
            one before matching: `auto` for matchers that compare brightness (all but census) where
            the eyes differ, `always`, `never`.
        clean: what is removed of the disparities because it is no surface; `none` keeps all. Maps
            given by --disparity and --depth are taken as they are.
        temporal: how disparities are fused with those of the frames before; needs poses.
        smooth: how disparities are smoothed before they become points.
        fill: how holes between matched pixels are filled.
        disparity: disparities that somebody else made, in place of a matcher: a folder of PNG (x
            256), PFM or NPY files named as the frames.
        depth: the same with depth along the optical axis: PNG (x 256), PFM or NPY (m).
        map_scale: steps a px or m of such maps: auto, 256, 16 (OpenCV), 1000 (mm), 5000 (TUM), 1.
        check_maps: look up in the pictures whether that scale is the right one.
        sigma_px: error (68 %) of such maps, px of disparity; unknown by default.
        reproject: which pixels become points, and how.
        guide: correct the metres of each cloud by the LiDAR scan of its frame, or by a few beams
            of it (scan:4, scan:16); adds a column `guided`. Disparities stay as they are.
        scans: how LiDAR scans are put right for `guide`: moved to one moment, where the data say
            when points were taken; beams raised. What is written of scans stays as it is stored.
        outliers: which points are removed of clouds of any origin; `clean` is for disparities.
        ground: what happens to the ground's points: label them (column `ground`), or remove them.
        crop: only points in a box, or at some distance.
        normals: add the directions that surfaces face, columns nx, ny, nz.
        beams: only what a spinning LiDAR would measure, an HDL-64E or one with fewer beams.
        thin: fewer points, how.
        mcap: what a recording holds.
        kitti: pictures and split of a training tree; with --beams its clouds look like a LiDAR's.
        colmap: how many points a COLMAP model has.
        video: make preview.mp4 too: photo, disparity and the cloud from above, H.264.
        preview: how it looks.
        frames: only these: slices 100:400:2, ids 13,35, or @FILE with such items.
        exclude: not these.
        rig: calibration that replaces the source's cameras: a rig.json, OpenCV YAML, XML or JSON,
            ROS camera_info, K.txt, calib.txt; a file, a folder, or LEFT,RIGHT.
        rig_unit: unit of lengths in a calibration that does not say it: m, cm, mm.
        rectify: how unrectified pairs are rectified, as they load.
        scale_calibration: scale the calibration where images have another size.
        min_depth: nearest depth that must be found, m; decides how many disparities are searched.
            By default what the data set says of its scenes, or the rig of its board, else 3.
        frame: coordinate frame of the clouds: velodyne, camera_left or base_link, by default
            velodyne where that is calibrated, else camera_left, of several pairs base_link; of
            recorded clouds any that the source knows, by default their own. `.bin` is always x
            forward.
        swap: exchange left and right pictures.
        check: look at the first, the middle and the last pair before the run: swapped eyes, rows
            that are off and a calibration for another size stop it, other oddities are warned of.
        workers: frames worked on at the same time; by default one per core.
        timeout: a frame that takes longer is skipped, s.
        isolate: do frames in processes of their own: a file that crashes or hangs a library, or
            fills the memory, then costs its frame and not the run.
        memory_limit: what such a process may hold, MB; by default no limit.
        on_error: skip a bad frame (and stop when they become many), or stop at the first.
        overwrite: start anew, even where OUT holds a run with other settings.
        view: show on a page what is made while it is made: the printed address, in a browser. At a
            terminal it stays open after the end, until Ctrl-C.
        port: of that page; 0 or `auto` for any that is free.
        host: of that page; others than 127.0.0.1 let other machines in, with the printed token.
        dry_run: tell frames, bytes, time and free disk, and write nothing.
    """

    source: Annotated[Source, Recognised(recognise)]
    out: Annotated[Path, POSITIONAL, RUN_ONLY] = Path("out")
    to: Outputs = field(default_factory=lambda: Outputs(("pcd",)))
    matcher: Census | Sgbm | Bm | Onnx = field(default_factory=Census)
    rows: RowsWhen = "auto"
    balance: BalanceWhen = "auto"
    clean: Clean | None = field(default_factory=Clean)
    temporal: Kalman | None = None
    smooth: Fgs | None = None
    fill: Surfaces | None = None
    disparity: Path | None = None
    depth: Path | None = None
    map_scale: StoredSteps = field(default_factory=StoredSteps)
    check_maps: Annotated[bool, RUN_ONLY] = True
    sigma_px: float | None = None
    reproject: Reproject = field(default_factory=Reproject)
    guide: Scan | None = None
    scans: Scans = field(default_factory=Scans)
    outliers: Lonely | None = None
    ground: Label | Remove | None = None
    crop: Box | Range | None = None
    normals: bool = False
    beams: BeamCount | None = None
    thin: Voxel | Uniform | Density | None = None
    mcap: McapContent = field(default_factory=McapContent)
    kitti: KittiTree = field(default_factory=KittiTree)
    colmap: ColmapModel = field(default_factory=ColmapModel)
    video: bool = False
    preview: Preview = field(default_factory=Preview)
    frames: FrameSelection | None = None
    exclude: FrameSelection | None = None
    rig: Path | None = None
    rig_unit: RigUnit | None = None
    rectify: Rectify = field(default_factory=Rectify)
    scale_calibration: bool = False
    min_depth: float | None = None
    frame: CloudFrame | None = None
    swap: bool = False
    check: Annotated[bool, RUN_ONLY] = True
    workers: Annotated[int | None, RUN_ONLY] = None
    timeout: Annotated[float, RUN_ONLY] = FRAME_TIMEOUT_S
    isolate: Annotated[bool, RUN_ONLY] = False
    memory_limit: Annotated[float | None, RUN_ONLY] = None
    on_error: Annotated[OnError, RUN_ONLY] = "skip"
    overwrite: Annotated[bool, RUN_ONLY, THIS_TIME] = False
    view: Annotated[bool, RUN_ONLY, THIS_TIME] = False
    port: Annotated[Port, RUN_ONLY] = PORT
    host: Annotated[str, RUN_ONLY] = LOOPBACK
    dry_run: Annotated[bool, RUN_ONLY, THIS_TIME] = False

    def __post_init__(self) -> None:
        if self.view and self.isolate:
            raise UsageError(
                "--view with --isolate",
                want="one of them",
                fix="What other processes make is not shown: look at OUT with `view`.",
            )

    @property
    def crew(self) -> CrewPlan:
        """How the frames are done."""
        return CrewPlan(self.workers, self.timeout, self.isolate, self.memory_limit)

    @property
    def for_pair(self) -> Convert:
        """The same for one pair of a body: points of its left camera, nothing to write."""
        return replace(self, frame="camera_left", to=Outputs(("npz",)), video=False)

    @property
    def given(self) -> GivenSettings:
        """Maps in place of a matcher."""
        return GivenSettings(
            self.disparity, self.depth, self.map_scale, self.check_maps, self.sigma_px
        )

    @property
    def searching(self) -> Searching | None:
        """What disparities are looked for; None where they are given."""
        return None if self.given.text else Searching(self.matcher, self.min_depth)

    @property
    def matched_by(self) -> str:
        """What finds the disparities, in a few words."""
        return self.given.text or described(self.matcher)


def run(job: Convert) -> ConvertReport | Rehearsal:
    """Convert every frame of the source: match, reproject, encode; commit in order."""
    source = opened(job)
    check_usable(job.out)
    per_frame = ConvertFrame.of(job, source)
    if job.dry_run:
        preflight(source, wanted=job.check, crew=job.crew, searching=job.searching)
        return rehearse(source, per_frame, folder=job.out, crew=job.crew).checked()
    recording = RecordingPlan.of(job, source, wanted=job.to.recording)
    trees = per_frame.encode.trees
    products = (*recording.names, *trees.products, *([PREVIEW_NAME] if job.video else []))
    read = paths_read(job.source, job.disparity, job.depth)
    check_apart(job.out, read, (*job.to.folders, *products), overwrite=job.overwrite)
    with (
        run_page(job, source, Moment.of) as onlooker,
        Run.open(job.out, job, source, products=products, networks=networks_of(per_frame)) as run,
        recording.open(job.out, run.expected(per_frame, crew=job.crew)) as log,
    ):
        settled = run.settled(log.held)
        run.check(
            wanted=job.check and len(settled) < len(source.ids),
            crew=job.crew,
            searching=job.searching,
        )
        shown = per_frame.shown_to(onlooker)
        outcomes = stream(source, shown, crew=job.crew, skip=settled, in_flight=run.in_flight)
        left = len(source.ids) - len(settled)
        for frame in run.good(fitting(outcomes, frames=left, folder=job.out)):
            log.append(frame.id, frame.value.parts)
            run.commit(frame)
        trees.finish(job.out, run.records())
        if job.video:
            write_preview(run, source, job.preview)
    result = run.result()
    chosen = {"matcher": job.matched_by} if source.yields in MATCHED else {}
    page = write_conversion_page(job.out, result, source.rig, settings=chosen)
    return ConvertReport(result, job.out, job.to, page)


@dataclass(frozen=True)
class ConvertFrame:
    """One frame to the bytes of its outputs: pure, picklable, one thread.

    Args:
        match: pair to disparity, refined and cleaned.
        reproject: disparity to points.
        guide: points corrected by the scan of their frame.
        frame: coordinate frame of the clouds, None for the usual one of what a frame knows.
        tools: what is done to clouds in that frame.
        encode: all that to the bytes of files and recording.
        of_pair: the same for each pair of a body, by its name.
    """

    match: MatchFrame
    reproject: Reprojector
    guide: Guide
    frame: CloudFrame | None
    tools: CloudTools
    encode: FrameEncoder
    of_pair: Mapping[str, ConvertFrame] = field(default_factory=dict)

    @classmethod
    def of(cls, job: Convert, source: FrameSequence[Frame]) -> ConvertFrame:
        """With everything heavy loaded.

        Raises:
            CalibrationField: the rig does not say where the wanted frame is.
        """
        if source.rig is not None:  # a wrong --frame ends the run here, and not at each frame
            left_in(source.rig, job.frame or default_frame(source.rig))
        given = given_maps(job.given, source)
        refining = Refining(job.temporal, job.smooth, job.fill)
        match = MatchFrame.load(
            source,
            job.matcher,
            refining,
            job.clean,
            given=given,
            eyes=Eyes(job.rows, job.balance),
            min_depth_m=job.min_depth,
        )
        paired = source.yields is StereoFrame  # else no kernel is needed, which take a second
        reproject = job.reproject.load() if paired else Reprojector(job.reproject)
        guide = Guide.unused()
        if job.guide is not None and source.yields is not BodyFrame:  # that is guided pair by pair
            guide = job.guide.load(
                pairs_of(source).rig, put_right=partial(put_right, scans=job.scans)
            )
        normals = Normals() if job.normals else None
        beams = None if job.beams is None else Beams(job.beams)
        tools = CloudTools.load(job.outliers, job.ground, job.crop, normals, beams, job.thin)
        trees = Trees.of(job.to.trees, job.kitti, job.colmap, source)
        encode = FrameEncoder(job.to, job.mcap, trees, sampled_frames(source.ids))
        of_pair = {name: cls.of(job.for_pair, part) for name, part in parts_of(source).items()}
        plain = cls(match, reproject, guide, job.frame, tools, encode, of_pair)
        if not job.video:
            return plain
        artist = PreviewArtist.of(job.preview, source, plain.converted, crew=job.crew)
        return replace(plain, encode=replace(encode, artist=artist))

    def __call__(self, frame: Frame) -> Product:
        """Convert and encode.

        Raises:
            PseudolidarError: as `converted`.
        """
        return self.encode(self.converted(frame))

    def shown_to(self, *onlookers: Newest[Converted] | None) -> ConvertFrame:
        """The same with those who look on, for threads; the same bytes."""
        looking_on = tuple(one for one in onlookers if one is not None)
        return replace(self, encode=replace(self.encode, onlookers=looking_on))

    def converted(self, frame: Frame) -> Converted:
        """Match and reproject a pair, reproject depth, take a cloud as it is.

        Raises:
            PairIdentical, LowTexture, MapEmpty, CloudEmpty: there is nothing to be seen.
            StereoConfig: the image is too narrow for the disparities searched.
        """
        match frame:
            case StereoFrame():
                converted = self.pair(frame)
            case RecordedCloud():
                converted = Converted(frame, placed(frame.cloud, frame.tree, self.frame))
            case DepthFrame():
                cloud = self.reproject.of_depth(frame)
                cloud = placed(cloud, camera_tree(frame.camera, frame.pose), self.frame)
                converted = Converted(frame, cloud, depth=frame.depth)
            case BodyFrame():
                converted = self.body(frame)
        return converted.tooled(self.tools)

    def body(self, frame: BodyFrame) -> Converted:
        """Every pair of a body, their clouds joined; a pair that shows nothing is noted.

        Raises:
            PseudolidarError: not one pair shows anything.
        """
        parts, faults = dict[str, Converted](), dict[str, PseudolidarError]()
        for name, pair in frame.pairs.items():
            try:
                parts[name] = self.of_pair[name].pair(pair)
            except PseudolidarError as fault:
                faults[name] = fault
        if not parts:
            raise next(iter(faults.values()))
        lost = (f"{name} left out: {fault}" for name, fault in faults.items())
        converted = joined_on_body(frame, parts, lost)
        cloud = placed(converted.cloud, converted.tree, self.frame)
        return replace(converted, cloud=cloud)

    def pair(self, frame: StereoFrame) -> Converted:
        """Match, refine, clean, reproject, guide."""
        self.guide.check(frame)
        matched = self.match(frame)
        disparity = matched.disparity
        depth = depth_map(disparity, frame.rig)
        frame = replace(frame, notes=(*frame.notes, *scale_notes(frame, disparity, depth)))
        T_frame_left = left_in(frame.rig, self.frame or default_frame(frame.rig))
        cloud, depth, guided = self.guide(frame, self.reproject(frame, disparity), depth)
        cloud = cloud.transformed(T_frame_left)
        check_points(frame, cloud, matched.counts)
        figures: dict[str, float] = {**matched.counts, **guided}
        return Converted(frame, cloud, disparity, depth, figures, matched.reason)


def opened(job: Convert) -> FrameSequence[Frame]:
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
    job.to.check_possible(source)
    tell(source)
    if job.guide is not None and (scans := possible(source, job.scans)):
        _log.info("guide: %s", scans.note)
    if source.yields in MATCHED:
        _log.info("matcher: %s", job.matched_by)
    return source
