"""Judge disparities by ground truth, clouds by a LiDAR, obstacles by labels: the usual measures."""

from __future__ import annotations

import time
from dataclasses import dataclass, field
from pathlib import Path
from typing import Annotated, Literal

import numpy as np

from pseudolidar.calibration.refine import fit
from pseudolidar.clouds.ground_fit import GroundFit
from pseudolidar.errors import ReferenceMissing, SourceUnknown, UsageError
from pseudolidar.evaluation.comparison.bins import DEFAULT_BINS, DepthBins
from pseudolidar.evaluation.disparity import DisparityErrors, DisparityScore, disparity_errors
from pseudolidar.evaluation.disparity_report import DisparityReport
from pseudolidar.evaluation.halves import FrameSamples, judge_halves, residuals
from pseudolidar.evaluation.map_files import is_maps, paired_maps, read_map
from pseudolidar.evaluation.obstacles_report import ObstaclesReport
from pseudolidar.evaluation.trajectory.judge import Alignment
from pseudolidar.evaluation.trajectory.pairing import TimePairing
from pseudolidar.evaluation.trajectory.segments import SegmentLengths
from pseudolidar.evaluation.trajectory.steps import DEFAULT_STEPS, RpeChoice
from pseudolidar.formats.rigs.rig_reading import RigUnit
from pseudolidar.formats.trajectory_file import POSE_SUFFIXES, trajectory_form
from pseudolidar.obstacles.detectors import AnyDetector
from pseudolidar.obstacles.labels import Labels
from pseudolidar.running.bad_frames import OnError, good_frames
from pseudolidar.running.comparing.cloud_of_pair import CompareCloudOfPair
from pseudolidar.running.comparing.clouds import OWN_SCANS, other_clouds
from pseudolidar.running.comparing.compared_clouds import Comparing, compared_clouds
from pseudolidar.running.comparing.other import other_scans
from pseudolidar.running.comparing.references import SCAN, WORDS, OwnReference
from pseudolidar.running.crew.attempt import AnyFrame, Skipped
from pseudolidar.running.crew.crew_plan import CrewPlan
from pseudolidar.running.field_markers import POSITIONAL, RUN_ONLY, THIS_TIME, Recognised
from pseudolidar.running.matching import MatchFrame, Refining, steps_in_words
from pseudolidar.running.nearness import Searching
from pseudolidar.running.new_file import check_kind, check_new_file
from pseudolidar.running.obstacle_judging import judge_obstacles
from pseudolidar.running.preflight import preflight
from pseudolidar.running.progress import FrameProgress
from pseudolidar.running.reports.clouds_report import CloudsReport
from pseudolidar.running.reports.trajectory_page import is_page, write_trajectory_page
from pseudolidar.running.reports.trajectory_report import TrajectoryReport
from pseudolidar.running.settings_schema import choice_name, described
from pseudolidar.running.sighting import SMALL_THINGS_KEPT, SightFrame
from pseudolidar.running.stream import stream
from pseudolidar.running.trajectory_judging import BodyChoice, Poses, TrajectoryJudging
from pseudolidar.sources.other_rig import opened_with_rig
from pseudolidar.sources.recognise import Source, recognise
from pseudolidar.sources.rectified import Rectify
from pseudolidar.sources.scans_put_right import Scans
from pseudolidar.sources.selection import FrameSelection, select
from pseudolidar.sources.source import FrameSequence, clouds_of, nearest_depth_m, pairs_of
from pseudolidar.sources.synthetic import Synthetic
from pseudolidar.stereo.balance import BalanceWhen
from pseudolidar.stereo.census import Census
from pseudolidar.stereo.eyes import Eyes
from pseudolidar.stereo.filters.clean import Clean
from pseudolidar.stereo.filters.filled_map import Surfaces
from pseudolidar.stereo.filters.map_filter import FilteredMatcher
from pseudolidar.stereo.filters.smoothed_map import Fgs
from pseudolidar.stereo.filters.temporal import Kalman
from pseudolidar.stereo.matcher import StereoMatcher
from pseudolidar.stereo.neural import Onnx
from pseudolidar.stereo.reproject import Reproject
from pseudolidar.stereo.row_alignment import RowsWhen
from pseudolidar.stereo.sgbm import Bm, Sgbm
from pseudolidar.structures.frame import StereoFrame
from pseudolidar.structures.recorded import Frame, RecordedCloud
from pseudolidar.structures.samples import DisparitySamples

# Pixels that correction and sigma are fitted to and judged with, all frames together; a KITTI
# frame has some 90 000, so up to 22 of them count whole and longer sequences are thinned evenly.
MAX_SAMPLES = 2_000_000
UNUSED_CORRECTION = "the correction of the rig is not used here: one is fitted, in halves"
# A source whose first frames have no truth has none: its other pictures need not be read.
FRAMES_TRIED = 20


@dataclass(frozen=True)
class Maps:
    """Disparity maps in files: PNG (px x 256), PFM or NPY.

    Args:
        path: one file, or a folder of them.
    """

    path: Path


def recognise_judged(text: str) -> Source | Maps | Poses:
    """What SOURCE is: pairs, clouds, disparity maps or poses to compare with `--reference`."""
    path = Path(text)
    if path.is_file() and is_maps(path):
        return Maps(path)
    if path.is_file() and trajectory_form(path) is not None:
        return Poses(path)
    try:
        return recognise(text)
    except SourceUnknown:
        if is_maps(path):
            return Maps(path)
        if path.is_file() and path.suffix.lower() in POSE_SUFFIXES:
            return Poses(path)  # whose reader says by line what is wrong with them
        raise


@dataclass(frozen=True)
class Evaluate:
    """Judge disparities by ground truth, clouds by a LiDAR, obstacles by labels, trajectories.

    Of disparities D1, density and mean error are those as they come, on the stock rig. Correction
    and sigma are fitted on even frames and judged on odd ones, and the other way round.

    Of clouds: how far their points are from the reference (accuracy), those of the reference from
    them (completeness), chamfer distance, and F-score at 0.1, 0.2 and 0.5 m, by range, of what both
    sensors see. Pairs become clouds as `convert` makes them, and are compared with their scans, or
    with the clouds of `--reference`.

    Of obstacles: how far their nearest face is off, by range, how many of these errors lie within
    one sigma, their sizes, and how many of the labelled objects are found.

    Of a trajectory, a file of poses (TUM, KITTI, EuRoC): how far its poses are off (absolute), its
    motions (relative), and how it drifts over segments of the path, as evo and KITTI define it.

        pseudolidar evaluate disparity training --matcher census --json
        pseudolidar evaluate disparity EST --reference GT
        pseudolidar evaluate cloud 2011_09_26_drive_0002_sync
        pseudolidar evaluate cloud out/ply --reference drive.mcap --bins 0,20,40 --json
        pseudolidar evaluate obstacles training --rig rig.json --detector labels
        pseudolidar evaluate trajectory est.txt --reference truth.txt --align se3 --report est.html

    Args:
        what: what is judged.
        source: data with ground-truth disparity, or disparity maps: files or folders; to judge
            clouds, pairs with LiDAR scans, or clouds: files, folders, recordings; a file of poses.
        matcher: how disparities are found.
        rows: bring the rows of the right picture to those of the left one before matching: `auto`
            where points that both eyes see show that they differ, `never`.
        balance: give the right picture the brightness, colours, gamma and vignetting of the left
            one before matching: `auto` for matchers that compare brightness (all but census) where
            the eyes differ, `always`, `never`.
        temporal: how disparities are fused with those of the frames before; needs poses.
        smooth: how disparities are smoothed before they are judged.
        fill: how holes between matched pixels are filled.
        clean: what is removed of the disparities before they become clouds, or objects are looked
            for in them (where small things stay by default, as in `obstacles`).
        reproject: which pixels become points of the clouds.
        detector: what says where objects are.
        also: a second one, such as `cloud`; what both see is one obstacle.
        reference: the truth for disparity maps, a file or a folder with the same names; the clouds
            to compare clouds with, where the source's own scans are not meant; the true poses, a
            file or a source that has them.
        align: how a trajectory is laid onto its reference first: a rigid motion (se3), with a scale
            (sim3), first pose on first pose (origin), or not at all.
        pair: how poses of both files are paired.
        rpe: motions that relative errors are of, a comma list: over 1 frame, over 10m of path end
            to end, over 10m:all from every pose.
        segments: path lengths that drift is measured over: auto (100-800 m where the path is that
            long, else 10-40 m, else all of it), kitti, short, whole, or metres such as 10,20.
        times: of the poses, where their file has none; by default NAME_times.txt or times.txt
            beside a KITTI file.
        reference_times: of the reference's poses.
        body: whose poses a reference has that is a source: base_link, or camera_left as in KITTI's
            pose files, which is the default for such a file.
        report: a page (HTML) to write about a trajectory.
        overwrite: replace such a page.
        bins: edges of the ranges that clouds are judged by, whole metres.
        frames: only these: slices 100:400:2, ids 13,35, or @FILE with such items.
        exclude: not these.
        rig: calibration that replaces the source's cameras: a rig.json, OpenCV YAML, XML or JSON,
            ROS camera_info, K.txt, calib.txt; a file, a folder, or LEFT,RIGHT. To judge
            disparities a correction in it is not used, as one is fitted here.
        rig_unit: unit of lengths in a calibration that does not say it: m, cm, mm.
        rectify: how unrectified pairs are rectified, as they load.
        scale_calibration: scale the calibration where images have another size.
        min_depth: nearest depth that must be found, m; decides how many disparities are searched.
            By default what the data set says of its scenes, or the rig of its board, else 3.
        swap: exchange left and right pictures.
        scans: how LiDAR scans are put right first: moved to one moment, where the data say when
            points were taken; beams raised.
        check: look at the first, the middle and the last pair before: swapped eyes, rows that are
            off and a calibration for another size stop it, other oddities are warned of.
        workers: frames worked on at the same time; more than one disturbs the measured time.
        on_error: skip a bad frame (and stop when they become many), or stop at the first.
    """

    what: Annotated[Literal["disparity", "cloud", "obstacles", "trajectory"], POSITIONAL]
    source: Annotated[Source | Maps | Poses, Recognised(recognise_judged)]
    matcher: Census | Sgbm | Bm | Onnx = Census()
    rows: RowsWhen = "auto"
    balance: BalanceWhen = "auto"
    temporal: Kalman | None = None
    smooth: Fgs | None = None
    fill: Surfaces | None = None
    clean: Clean | None = field(default_factory=Clean)
    reproject: Reproject = field(default_factory=Reproject)
    detector: AnyDetector = field(default_factory=Labels)
    also: AnyDetector | None = None
    reference: Path | None = None
    align: Alignment = "se3"
    pair: TimePairing = field(default_factory=TimePairing)
    rpe: RpeChoice = DEFAULT_STEPS
    segments: SegmentLengths = field(default_factory=SegmentLengths)
    times: Path | None = None
    reference_times: Path | None = None
    body: BodyChoice = "auto"
    report: Annotated[Path | None, RUN_ONLY] = None
    overwrite: Annotated[bool, RUN_ONLY, THIS_TIME] = False
    bins: DepthBins = DEFAULT_BINS
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
    workers: Annotated[int, RUN_ONLY] = 1
    on_error: Annotated[OnError, RUN_ONLY] = "skip"


@dataclass(frozen=True, eq=False)
class JudgedFrame:
    """What is kept of one frame.

    Args:
        errors: counts of all its pixels with truth.
        pixels: some of them.
        seconds: of matching.
    """

    errors: DisparityErrors
    pixels: FrameSamples
    seconds: float


@dataclass(frozen=True)
class JudgeFrame:
    """Matches one frame and compares it with its truth.

    Args:
        matcher: what is judged.
        most: samples to keep.
    """

    matcher: StereoMatcher
    most: int

    def __call__(self, frame: StereoFrame) -> JudgedFrame | None:
        """Errors, samples and time of a frame; None if it has no truth."""
        if frame.truth is None:
            return None
        begin_s = time.perf_counter()
        disparity = self.matcher(frame)
        seconds = time.perf_counter() - begin_s
        samples = DisparitySamples.of_maps(
            disparity, frame.truth, frame=frame.index, most=self.most
        )
        errors = disparity_errors(disparity, frame.truth)
        return JudgedFrame(errors, FrameSamples(samples, frame.rig), seconds)


def run(job: Evaluate) -> DisparityReport | CloudsReport | ObstaclesReport | TrajectoryReport:
    """Judge what is asked for."""
    if job.what == "trajectory":
        return judge_poses(job)
    if job.what == "obstacles":
        return judge_labelled(job)
    if job.what == "cloud":
        return judge_clouds(job)
    if isinstance(job.source, Maps) or job.reference is not None:
        return compare_maps(job)
    return judge_disparities(job, pairs_of(opened(job)))


def judge_disparities(job: Evaluate, source: FrameSequence[StereoFrame]) -> DisparityReport:
    """Match and judge every frame that has a truth; then fit and judge in halves."""
    searching = Searching(job.matcher, job.min_depth)
    warnings = preflight(source, wanted=job.check, crew=CrewPlan(job.workers), searching=searching)
    nearest_m = nearest_depth_m(job.min_depth, source)
    loaded = Eyes(job.rows, job.balance).load(job.matcher, min_depth_m=nearest_m)
    matcher = FilteredMatcher(*refining(job).load(loaded, source))
    per_frame = JudgeFrame(matcher, most=max(1, MAX_SAMPLES // max(1, len(source.ids))))
    skipped: list[Skipped] = []
    judged: list[JudgedFrame] = []
    without_truth = 0
    outcomes = stream(source, per_frame, crew=CrewPlan(job.workers))
    with FrameProgress(len(source.ids)) as progress:
        for frame in good_frames(
            outcomes, frames=len(source.ids), on_error=job.on_error, skipped=skipped.append
        ):
            progress.advance()
            if frame.value is not None:
                judged.append(frame.value)
                continue
            without_truth += 1
            if not judged and without_truth >= FRAMES_TRIED:
                break
    if not judged:
        raise ReferenceMissing(
            f"{source.summary.line}: no frame has a ground-truth disparity",
            want="such as KITTI stereo 2012 or 2015 training data",
            fix="Take another source, or compare files: `evaluate disparity EST --reference GT`.",
            path=source.summary.path,
        )
    pixels = [frame.pixels for frame in judged]
    return DisparityReport(
        subject=f"{described(job.matcher)} on {source.summary.line}",
        score=DisparityScore([frame.errors for frame in judged]),
        raw=residuals(pixels, correction=None),
        halves=judge_halves(pixels, fit=fit),
        seconds_per_frame=float(np.median([frame.seconds for frame in judged])),
        without_truth=without_truth,
        skipped=[(frame.id, str(frame.error)) for frame in skipped],
        warnings=warnings,
        notes=(UNUSED_CORRECTION,) if source.rig and source.rig.correction else (),
    )


def judge_clouds(job: Evaluate) -> CloudsReport:
    """Nearest neighbours between every cloud and its reference, in what both sensors see."""
    source = opened(job)
    reference = None if job.reference is None else str(job.reference)
    if source.yields is RecordedCloud:
        clouds = clouds_of(source)
        against = OWN_SCANS if reference is None else other_clouds(reference, clouds)
        return told(job, clouds, against, subject=source.summary.line)
    pairs = pairs_of(source)
    match = MatchFrame.load(
        pairs,
        job.matcher,
        refining(job),
        job.clean,
        eyes=Eyes(job.rows, job.balance),
        min_depth_m=job.min_depth,
    )
    scans = OwnReference("scan") if reference is None else other_scans(reference, pairs)
    per_frame = CompareCloudOfPair(match, job.reproject.load(), scans)
    steps = steps_in_words(described(job.matcher), refining(job), job.clean)
    return told(job, pairs, per_frame, subject=f"{steps} on {source.summary.line}")


def judge_labelled(job: Evaluate) -> ObstaclesReport:
    """Find and measure the obstacles of every frame that has labels."""
    pairs = pairs_of(opened(job))
    searching = Searching(job.matcher, job.min_depth)
    crew = CrewPlan(job.workers)
    warnings = preflight(pairs, wanted=job.check, crew=crew, searching=searching)
    clean = SMALL_THINGS_KEPT if job.clean == Clean() else job.clean  # as `obstacles` does
    match = MatchFrame.load(
        pairs,
        job.matcher,
        refining(job),
        clean,
        eyes=Eyes(job.rows, job.balance),
        min_depth_m=job.min_depth,
    )
    steps = steps_in_words(described(job.matcher), refining(job), clean)
    detectors = (job.detector,) if job.also is None else (job.detector, job.also)
    names = " and ".join(choice_name(type(one)) for one in detectors)
    return judge_obstacles(
        pairs,
        SightFrame.of(match, GroundFit()),
        detectors,
        subject=f"{names} measured by {steps} on {pairs.summary.line}",
        crew=crew,
        on_error=job.on_error,
        tried=FRAMES_TRIED,
        warnings=warnings,
    )


def judge_poses(job: Evaluate) -> TrajectoryReport:
    """Pair the poses of two trajectories, align them, and compare.

    Raises:
        UsageError: a source that holds no poses.
    """
    if isinstance(job.source, Maps | Synthetic):
        found = "disparity maps" if isinstance(job.source, Maps) else "a rendered world"
        raise UsageError(
            f"{found} to be judged as a trajectory", want="a file of poses (TUM, KITTI, EuRoC)"
        )
    if job.report is not None:
        check_new_file(job.report, overwrite=job.overwrite, flag="--report")
        check_kind(job.report, is_page, "page (HTML)", flag="--report")
    judging = TrajectoryJudging(
        align=job.align,
        pair=job.pair,
        rpe=job.rpe,
        segments=job.segments,
        times=job.times,
        reference_times=job.reference_times,
        body=job.body,
    )
    report = judging.judge(Path(job.source.path), job.reference)
    return report if job.report is None else write_trajectory_page(job.report, report)


def told(
    job: Evaluate, source: FrameSequence[AnyFrame], per_frame: Comparing[AnyFrame], *, subject: str
) -> CloudsReport:
    """Compare every cloud."""
    return compared_clouds(
        source,
        per_frame,
        subject=subject,
        reference=WORDS[SCAN] if job.reference is None else str(job.reference),
        bins=job.bins,
        crew=CrewPlan(job.workers),
        on_error=job.on_error,
        tried=FRAMES_TRIED,
        check=job.check and source.yields is StereoFrame,
    )


def refining(job: Evaluate) -> Refining:
    """What is done to the matched disparities."""
    return Refining(job.temporal, job.smooth, job.fill)


def opened(job: Evaluate) -> FrameSequence[Frame]:
    """The frames that are asked for, with the rig that is asked for.

    Raises:
        UsageError: disparity maps or poses, where pairs or clouds are wanted.
    """
    if isinstance(job.source, Poses):
        raise UsageError(
            "a file of poses",
            want="pairs, clouds or disparity maps",
            fix="Judge it by `evaluate trajectory EST --reference REF`.",
            path=job.source.path,
        )
    if isinstance(job.source, Maps):
        raise UsageError(
            "disparity maps, which have no points",
            want="pairs with scans or labels, or clouds",
            fix="Make clouds of them: `pseudolidar convert PAIRS OUT --disparity MAPS`.",
            path=job.source.path,
        )
    every = opened_with_rig(
        job.source,
        job.rig,
        scale_calibration=job.scale_calibration,
        unit=job.rig_unit,
        swap=job.swap,
        scans=job.scans,
        rectify=job.rectify,
    )
    return select(every, job.frames, job.exclude)


def compare_maps(job: Evaluate) -> DisparityReport:
    """Compare files with files of the same name."""
    estimate = job.source.path
    if isinstance(job.source, Poses):
        opened(job)  # which says what to do with them
    if job.reference is None:
        raise UsageError(
            "disparity maps without a reference", want="the truth", fix="Add --reference GT."
        )
    pairs = paired_maps(Path(estimate), job.reference)
    errors = [disparity_errors(read_map(mine), read_map(theirs)) for _, mine, theirs in pairs]
    return DisparityReport(f"{estimate} against {job.reference}", DisparityScore(errors))
