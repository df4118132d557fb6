"""Stereo against Velodyne: how wrong the metres are by range, and what explains it."""

from __future__ import annotations

import logging
from collections.abc import Iterator
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Annotated, cast, get_args

from pseudolidar.errors import UsageError
from pseudolidar.evaluation.compared import against_scan, against_truth
from pseudolidar.evaluation.comparison.bins import DEFAULT_BINS, DepthBins
from pseudolidar.evaluation.comparison.comparison import compare_frames
from pseudolidar.formats.mcap.content import McapContent
from pseudolidar.formats.rigs.rig_reading import RigUnit
from pseudolidar.running.apart import check_apart, paths_read
from pseudolidar.running.bad_frames import OnError
from pseudolidar.running.comparing.cloud_of_pair import distances_of
from pseudolidar.running.comparing.clouds import OWN_SCANS, holds_clouds, other_clouds
from pseudolidar.running.comparing.compared_clouds import compared_clouds
from pseudolidar.running.comparing.compared_drives import compared_drives
from pseudolidar.running.comparing.drives import Drives, drives_below, recognise_drives
from pseudolidar.running.comparing.gathered import (
    AGAINST,
    Gathered,
    Judged,
    Missing,
    nothing_in_common,
)
from pseudolidar.running.comparing.gathering import (
    Doing,
    ended_well,
    gather,
    gather_into,
    taken_as_pairs,
)
from pseudolidar.running.comparing.other import other_reference
from pseudolidar.running.comparing.references import (
    SCAN,
    OwnKind,
    OwnReference,
    Reference,
    kind_of,
)
from pseudolidar.running.comparing.second_place import check_another, places
from pseudolidar.running.crew.crew_plan import FRAME_TIMEOUT_S, CrewPlan
from pseudolidar.running.field_markers import POSITIONAL, RUN_ONLY, THIS_TIME, Recognised
from pseudolidar.running.folder import check_usable
from pseudolidar.running.given import GivenSettings, given_maps
from pseudolidar.running.matching import MatchFrame, Refining, steps_in_words
from pseudolidar.running.nearness import Searching
from pseudolidar.running.networks import networks_of
from pseudolidar.running.products.compared_outputs import ComparedOutputs
from pseudolidar.running.products.compared_products import ComparedEncoder
from pseudolidar.running.products.encoders import FrameEncoder
from pseudolidar.running.products.product import Product
from pseudolidar.running.products.recording import RecordingPlan
from pseudolidar.running.products.trees import Trees
from pseudolidar.running.reports.clouds_page import write_clouds_page
from pseudolidar.running.reports.clouds_report import CloudsReport
from pseudolidar.running.reports.comparison_files import (
    RESULTS,
    check_results,
    clouds_csv,
    comparison_csv,
    drives_csv,
    write_comparison,
)
from pseudolidar.running.reports.comparison_page import write_comparison_page
from pseudolidar.running.reports.comparison_report import ComparisonReport, rig_note
from pseudolidar.running.reports.drives_page import write_drives_page
from pseudolidar.running.reports.drives_report import DrivesReport
from pseudolidar.running.reports.samples import sampled_frames
from pseudolidar.running.run import Run
from pseudolidar.running.settings_json import result_settings
from pseudolidar.running.settings_schema import described
from pseudolidar.sources.other_rig import opened_with_rig
from pseudolidar.sources.recognise import Source, recognise
from pseudolidar.sources.rectified import Rectify
from pseudolidar.sources.scans_put_right import Scans
from pseudolidar.sources.selection import FrameSelection, select
from pseudolidar.sources.source import FrameSequence, clouds_of, pairs_of, tell
from pseudolidar.sources.synthetic import Synthetic
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
from pseudolidar.structures.frame import StereoFrame
from pseudolidar.structures.recorded import Frame, RecordedCloud

_log = logging.getLogger(__name__)

# Reference points that are kept of all frames together: a scan has some 18 000 in view, so 200
# frames count whole and of longer drives each frame is thinned evenly.
MAX_POINTS = 4_000_000
# A source none of whose first frames has a reference has none: the others need not be read.
FRAMES_TRIED = 100


@dataclass(frozen=True)
class Compare:
    """Match every frame of SOURCE and compare its depths with a reference.

    The reference is what the source has: LiDAR scans, else ground-truth disparities. Judged are the
    disparities that `convert` makes clouds of, so without what cleaning removes (`--clean none`
    judges all of them), before clouds are cut off at a range. Figures are pooled over reference
    points and binned by the reference's depth Z; intervals hold 95 % of resamples of the frames.

    With OUT the figures are written there (compare.json, compare.csv, and report.html with plots,
    to be read and printed), with clouds coloured by their error; without it they are only told. A
    run that was killed is continued by the same command.

    The second argument may also be another SOURCE to compare with: clouds, recordings, folders of
    disparity maps, pairs. It is taken for one if it exists and can be read as one, and is not a
    folder that `compare` itself has written to; what it was taken for is said. `--reference B` and
    `--out OUT` leave no doubt. Clouds and clouds are compared by nearest neighbours: how far ours
    are from the reference (accuracy), the reference from ours (completeness), F-score.

        pseudolidar compare 2011_09_26_drive_0002_sync out
        pseudolidar compare training --frames 0::2 --bins 0,10,20,40 --json
        pseudolidar compare drive.mcap other.mcap
        pseudolidar compare KITTI/2011_09_26 out/all --all
        pseudolidar compare training out --reference network_disparities --to pcd,together

    Args:
        source: data with LiDAR scans or ground-truth disparities, as for `convert`.
        out_or_b: output folder, or another source to compare with.
        out: output folder, for certain.
        all: compare every drive, sequence and recording below the folder SOURCE, with one table;
            each has a folder of its own in OUT.
        reference: with what: scan, truth, auto (scans where there are some, else truth), or the
            path of another source or of disparity maps, paired by name, number or time.
        bins: edges of the ranges, whole metres.
        to: clouds to write with OUT, a comma list: pcd, pcd:compressed, pcd:ascii, ply, ply:ascii,
            npz, mcap with the error of each point (error_m, and as colour); together (a PLY of both
            clouds, column source); or none.
        matcher: how disparities are found.
        rows: bring the rows of the right picture to those of the left one before matching: `auto`
            where points that both eyes see show that they differ, `never`.
        balance: give the right picture the brightness, colours, gamma and vignetting of the left
            one before matching: `auto` for matchers that compare brightness (all but census) where
            the eyes differ, `always`, `never`.
        clean: what is removed of the disparities because it is no surface; `none` keeps all.
        temporal: how disparities are fused with those of the frames before; needs poses.
        smooth: how disparities are smoothed before they are judged.
        fill: how holes between matched pixels are filled.
        disparity: disparities that somebody else made, in place of a matcher: a folder of PNG (x
            256), PFM or NPY files named as the frames.
        depth: the same with depth along the optical axis: PNG (x 256), PFM or NPY (m).
        map_scale: steps a px or m of such maps: auto, 256, 16 (OpenCV), 1000 (mm), 5000 (TUM), 1.
        check_maps: look up in the pictures whether that scale is the right one.
        sigma_px: error (68 %) of such maps, px of disparity; unknown by default.
        reproject: which pixels become points of the clouds, and how.
        mcap: what a recording holds.
        frames: only these: slices 100:400:2, ids 13,35, or @FILE with such items.
        exclude: not these.
        rig: calibration that replaces the source's cameras: a rig.json, OpenCV YAML, XML or JSON,
            ROS camera_info, K.txt, calib.txt; a file, a folder, or LEFT,RIGHT.
        rig_unit: unit of lengths in a calibration that does not say it: m, cm, mm.
        rectify: how unrectified pairs are rectified, as they load.
        scale_calibration: scale the calibration where images have another size.
        min_depth: nearest depth that must be found, m; decides how many disparities are searched.
            By default what the data set says of its scenes, or the rig of its board, else 3.
        swap: exchange left and right pictures.
        scans: how LiDAR scans are put right first: moved to one moment, where the data say when
            points were taken; beams raised.
        check: look at the first, the middle and the last pair before the run: swapped eyes, rows
            that are off and a calibration for another size stop it, other oddities are warned of.
        workers: frames worked on at the same time; by default one per core.
        timeout: a frame that takes longer is skipped, s.
        on_error: skip a bad frame (and stop when they become many), or stop at the first.
        overwrite: start anew, even where OUT holds a run with other settings.
    """

    source: Annotated[Source | Drives, Recognised(recognise_drives)]
    out_or_b: Annotated[str | None, POSITIONAL] = None
    out: Annotated[Path | None, RUN_ONLY] = None
    all: bool = False
    reference: str = "auto"
    bins: DepthBins = DEFAULT_BINS
    to: ComparedOutputs = field(default_factory=lambda: ComparedOutputs(("pcd",)))
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
    mcap: McapContent = field(default_factory=McapContent)
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
    timeout: Annotated[float, RUN_ONLY] = FRAME_TIMEOUT_S
    on_error: Annotated[OnError, RUN_ONLY] = "skip"
    overwrite: Annotated[bool, RUN_ONLY, THIS_TIME] = False

    @property
    def crew(self) -> CrewPlan:
        """How the frames are done."""
        return CrewPlan(self.workers, self.timeout)

    @property
    def given(self) -> GivenSettings:
        """Maps in place of a matcher."""
        return GivenSettings(
            self.disparity, self.depth, self.map_scale, self.check_maps, self.sigma_px
        )

    @property
    def owned(self) -> bool:
        """Whether the reference is the source's own."""
        return self.reference in get_args(OwnKind)

    @property
    def read(self) -> Iterator[Path]:
        """What is read, and must not be written over."""
        other = None if self.owned else Path(self.reference)
        if isinstance(self.source, Drives):
            yield Path(self.source.path)
            return
        yield from paths_read(self.source, self.disparity, self.depth, other)

    @property
    def searching(self) -> Searching | None:
        """What disparities are looked for; None where they are given."""
        return None if self.given.text else Searching(self.matcher, self.min_depth)

    @property
    def matched_by(self) -> str:
        """What finds the disparities, and what is done to them, in a few words."""
        if self.given.text:
            return steps_in_words(self.given.text, self.refining, None)
        return steps_in_words(described(self.matcher), self.refining, self.clean)

    @property
    def refining(self) -> Refining:
        """What is done to the disparities."""
        return Refining(self.temporal, self.smooth, self.fill)


def run(job: Compare) -> ComparisonReport | CloudsReport | DrivesReport:
    """Compare a source, or all drives of a folder."""
    job = placed(job)
    if not job.owned and not isinstance(job.source, Synthetic):
        check_another(job.source.path, job.reference)
    if job.all:
        return run_all(job)
    source = opened(job)
    if source.yields is RecordedCloud:
        return run_clouds(job, clouds_of(source))
    pairs = pairs_of(source)
    pairs.rig.check_metric()
    return run_pairs(job, pairs)


def run_pairs(job: Compare, source: FrameSequence[StereoFrame]) -> ComparisonReport:
    """Match and compare every frame; then figures, intervals, causes."""
    _log.info("disparities: %s", job.matched_by)
    per_frame = CompareFrame.of(job, source)
    missing = Missing(source.summary.line, source.summary.path, tried=FRAMES_TRIED)
    doing = Doing(job.crew, job.on_error, job.check, job.searching)
    if job.out is None:
        gathered = gather(source, per_frame, missing, doing)
    else:
        check_usable(job.out)
        recording = RecordingPlan.of(job, source, wanted=job.to.coloured.recording)
        products = (*recording.names, *RESULTS)
        check_apart(job.out, job.read, (*job.to.folders, *products), overwrite=job.overwrite)
        networks = networks_of(per_frame)
        with Run.open(job.out, job, source, products=products, networks=networks) as run:
            gather_into(run, source, per_frame, missing, doing, recording)
        gathered = Gathered.read(job.out, ended_well(run.result()))
    if not gathered.frames:
        raise missing.error()
    if not any(map(len, gathered.frames)):
        got = "no point of its references is in the left camera's view"
        raise nothing_in_common(source.summary, got)
    compared = compare_frames(
        gathered.frames,
        subject=f"{job.matched_by} on {source.summary.line}",
        reference=gathered.words if job.owned else job.reference,
        bins=job.bins,
        scanned=job.owned and set(gathered.against) == {SCAN},
    )
    notes = (*source.summary.notes, rig_note(compared.frames[0].rig))
    report = ComparisonReport(compared, gathered.result, gathered.without, notes)
    if job.out is None:
        return report
    facts = {"settings": result_settings(job), **report.facts}
    page = write_comparison_page(job.out, report, settings={"disparities": job.matched_by})
    files = write_comparison(job.out, comparison_csv(compared), facts)
    return replace(report, files=[*files, page])


def run_clouds(job: Compare, source: FrameSequence[RecordedCloud]) -> CloudsReport:
    """Nearest neighbours between every cloud and its reference; then figures, intervals."""
    if job.out is not None:
        check_usable(job.out)
        check_results(job.out, result_settings(job), overwrite=job.overwrite)
    per_frame = OWN_SCANS if job.owned else other_clouds(job.reference, source)
    report = compared_clouds(
        source,
        per_frame,
        subject=source.summary.line,
        reference=per_frame.words,
        bins=job.bins,
        crew=job.crew,
        on_error=job.on_error,
        tried=FRAMES_TRIED,
    )
    if job.out is None:
        return report
    facts = {"settings": result_settings(job), **report.facts}
    page = write_clouds_page(job.out, report)
    files = write_comparison(job.out, clouds_csv(report.comparison), facts)
    return replace(report, files=[*files, page])


def run_all(job: Compare) -> DrivesReport:
    """Compare every drive of a folder, then all their points together.

    Raises:
        SourceEmpty: there is no drive.
        ReferenceMissing: or none that has a reference.
        UsageError: they shall all be compared with the same other source.
    """
    if not job.owned:
        raise UsageError(
            f"--all with {job.reference} as reference", want="scans or truth of the drives' own"
        )
    if job.out is not None:
        check_results(job.out, result_settings(job), overwrite=job.overwrite)

    def compared(drive: str, source: Source) -> ComparisonReport:
        out = None if job.out is None else job.out / drive
        one = replace(job, source=source, out=out, all=False)
        return run_pairs(one, pairs_of(opened(one)))

    every = compared_drives(drives_below(job.source), compared, job.bins, most=MAX_POINTS)
    if job.out is None:
        return every
    facts = {"settings": result_settings(job), **every.facts}
    settings = {"folder": str(job.source.path), "disparities": job.matched_by}
    page = write_drives_page(job.out, every, settings=settings)
    files = write_comparison(job.out, drives_csv(every.comparisons, every.every), facts)
    return replace(every, files=[*files, page])


@dataclass(frozen=True)
class CompareFrame:
    """One frame with its reference to what is kept of it: pure, picklable, one thread.

    Args:
        match: pair to the disparities that become points.
        reference: what frames are compared with.
        reproject: disparity to points.
        most: reference points to keep.
        encode: what is written of a frame; None where nothing is.
    """

    match: MatchFrame
    reference: Reference
    reproject: Reprojector
    most: int
    encode: ComparedEncoder | None

    @classmethod
    def of(cls, job: Compare, source: FrameSequence[StereoFrame]) -> CompareFrame:
        """With everything heavy loaded."""
        match = matching(job, source)
        most = max(1, MAX_POINTS // max(1, len(source.ids)))
        encode = None
        if job.out is not None:
            sampled = sampled_frames(source.ids)
            frames = FrameEncoder(job.to.coloured, job.mcap, Trees(), sampled)
            encode = ComparedEncoder(frames, job.to.together, most)
        return cls(match, reference_of(job, source, match), job.reproject.load(), most, encode)

    def __call__(self, frame: StereoFrame) -> Judged:
        """Match and compare.

        Raises:
            PairIdentical, LowTexture: there is nothing to be seen.
            CalibrationField: nobody knows where the scan was taken.
        """
        found = self.reference(frame)
        if found is None:
            return Judged(None, None, Product((), figures={AGAINST: None}))
        kind, disparity = kind_of(found), self.match.disparity(found)
        against = against_scan if kind == SCAN else against_truth
        compared = against(disparity, found)
        cloud = self.reproject(found, disparity)
        if kind == SCAN:
            distances = distances_of(cloud, found, self.reproject.settings)
            compared = replace(compared, distances=distances)
        if self.encode is None:
            return Judged(kind, compared.thinned(self.most), Product(()))
        product = self.encode(found, disparity, cloud, compared)
        return Judged(kind, None, replace(product, figures={AGAINST: kind}))


def placed(job: Compare) -> Compare:
    """The job with its second argument where it belongs: as output folder or as reference.

    Raises:
        UsageError: it can only be one of them, and that is given already.
    """
    if job.out_or_b is None:
        return job
    out, reference = places(
        job.out_or_b, out=job.out, reference=None if job.owned else job.reference
    )
    return replace(job, out_or_b=None, out=out, reference=reference or job.reference)


def opened(job: Compare) -> FrameSequence[Frame]:
    """The frames that are asked for, with the rig that is asked for.

    Of a recording the pairs, if it has some, unless its clouds can be compared with clouds.
    """
    settings = job.source
    if isinstance(settings, Drives):
        settings = recognise(settings.path)  # which says what was looked for
    if job.owned or not holds_clouds(job.reference):
        settings = taken_as_pairs(settings)
    every = opened_with_rig(
        settings,
        job.rig,
        scale_calibration=job.scale_calibration,
        unit=job.rig_unit,
        swap=job.swap,
        scans=job.scans,
        rectify=job.rectify,
    )
    source = select(every, job.frames, job.exclude)
    tell(source)
    return source


def matching(job: Compare, source: FrameSequence[StereoFrame]) -> MatchFrame:
    """What finds the disparities that `convert` would make points of."""
    given = given_maps(job.given, source)
    return MatchFrame.load(
        source,
        job.matcher,
        job.refining,
        job.clean,
        given=given,
        eyes=Eyes(job.rows, job.balance),
        min_depth_m=job.min_depth,
    )


def reference_of(job: Compare, source: FrameSequence[StereoFrame], match: MatchFrame) -> Reference:
    """What the frames are compared with.

    Raises:
        SourceUnknown, SourceEmpty: the other source is none, or has no frame of ours.
    """
    if job.owned:
        return OwnReference(cast("OwnKind", job.reference))
    return other_reference(job.reference, source, match.disparity)
