"""Judge disparities against ground truth: D1, density, depth by range, honesty of sigma."""

from __future__ import annotations

import time
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Literal

import numpy as np

from pseudolidar.calibration.refine import fit
from pseudolidar.errors import ReferenceMissing, SourceUnknown, UsageError
from pseudolidar.evaluation.disparity import DisparityErrors, DisparityScore, disparity_errors
from pseudolidar.evaluation.disparity_report import DisparityReport
from pseudolidar.evaluation.halves import FrameSamples, judge_halves, residuals
from pseudolidar.evaluation.map_files import is_maps, paired_maps, read_map
from pseudolidar.formats.rigs.rig_reading import RigUnit
from pseudolidar.running.bad_frames import OnError, good_frames
from pseudolidar.running.crew.attempt import Skipped
from pseudolidar.running.crew.crew_plan import CrewPlan
from pseudolidar.running.field_markers import POSITIONAL, RUN_ONLY, Recognised
from pseudolidar.running.preflight import preflight
from pseudolidar.running.progress import FrameProgress
from pseudolidar.running.settings_schema import described
from pseudolidar.running.stream import stream
from pseudolidar.sources.other_rig import opened_with_rig
from pseudolidar.sources.recognise import Source, recognise
from pseudolidar.sources.selection import FrameSelection, select, whole
from pseudolidar.sources.source import FrameSequence, nearest_depth_m, pairs_of
from pseudolidar.stereo.census import Census
from pseudolidar.stereo.filters.filled_map import Surfaces
from pseudolidar.stereo.filters.map_filter import FilteredMatcher, MapFilters
from pseudolidar.stereo.filters.smoothed_map import Fgs
from pseudolidar.stereo.filters.temporal import Kalman
from pseudolidar.stereo.matcher import StereoMatcher
from pseudolidar.stereo.neural import Onnx
from pseudolidar.stereo.sgbm import Bm, Sgbm
from pseudolidar.structures.frame import StereoFrame
from pseudolidar.structures.samples import DisparitySamples

# Pixels that correction and sigma are fitted to and judged with, all frames together; a KITTI
# frame has some 90 000, so up to 22 of them count whole and longer sequences are thinned evenly.
MAX_SAMPLES = 2_000_000
# A source whose first frames have no truth has none: its other pictures need not be read.
FRAMES_TRIED = 20


@dataclass(frozen=True)
class Maps:
    """Disparity maps in files: PNG (px x 256), PFM or NPY.

    Args:
        path: one file, or a folder of them.
    """

    path: Path


def recognise_judged(text: str) -> Source | Maps:
    """What SOURCE is: pairs with ground truth, or disparity maps to compare with `--reference`."""
    path = Path(text)
    if path.is_file() and is_maps(path):
        return Maps(path)
    try:
        return recognise(text)
    except SourceUnknown:
        if is_maps(path):
            return Maps(path)
        raise


@dataclass(frozen=True)
class Evaluate:
    """Judge a matcher on the ground truth of SOURCE, or disparity maps against a reference.

    D1, density and mean error are of the disparities as they come, on the stock rig. Correction and
    sigma are fitted on even frames and judged on odd ones, and the other way round.

        pseudolidar evaluate disparity training --matcher census --json
        pseudolidar evaluate disparity EST --reference GT

    Args:
        what: what is judged.
        source: data with ground-truth disparity, or disparity maps: files or folders.
        matcher: how disparities are found.
        temporal: how disparities are fused with those of the frames before; needs poses.
        smooth: how disparities are smoothed before they are judged.
        fill: how holes between matched pixels are filled.
        reference: the truth for disparity maps, a file or a folder with the same names.
        frames: only these: slices 100:400:2, ids 13,35, or @FILE with such items.
        exclude: not these.
        rig: calibration that replaces the source's cameras: a rig.json, OpenCV YAML, XML or JSON,
            ROS camera_info, K.txt, calib.txt; a file, a folder, or LEFT,RIGHT. A disparity
            correction in it is not used, as one is fitted here.
        rig_unit: unit of lengths in a calibration that does not say it: m, cm, mm.
        scale_calibration: scale the calibration where images have another size.
        min_depth: nearest depth that must be found, m; decides how many disparities are searched.
            By default what the data set says of its scenes, else 3.
        swap: exchange left and right pictures.
        check: look at the first, the middle and the last pair before: swapped eyes, rows that are
            off and a calibration for another size stop it, other oddities are warned of.
        workers: frames worked on at the same time; more than one disturbs the measured time.
        on_error: skip a bad frame (and stop when they become many), or stop at the first.
    """

    what: Annotated[Literal["disparity"], POSITIONAL]
    source: Annotated[Source | Maps, Recognised(recognise_judged)]
    matcher: Census | Sgbm | Bm | Onnx = Census()
    temporal: Kalman | None = None
    smooth: Fgs | None = None
    fill: Surfaces | None = None
    reference: Path | None = None
    frames: FrameSelection | None = None
    exclude: FrameSelection | None = None
    rig: Path | None = None
    rig_unit: RigUnit | None = None
    scale_calibration: bool = False
    min_depth: float | None = None
    swap: bool = False
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


def run(job: Evaluate) -> DisparityReport:
    """Match and judge every frame that has a truth; then fit and judge in halves."""
    if isinstance(job.source, Maps) or job.reference is not None:
        return compare_maps(job)
    source = opened(job)
    warnings = preflight(source, wanted=job.check, crew=CrewPlan(job.workers))
    filters = MapFilters.load(job.smooth, job.fill)
    loaded: StereoMatcher = job.matcher.load(min_depth_m=nearest_depth_m(job.min_depth, source))
    if job.temporal is not None:
        fuse = job.temporal.load(loaded, whole(source))
        loaded, filters = fuse.sightings, filters.after(fuse)
    matcher = FilteredMatcher(loaded, filters)
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
    )


def opened(job: Evaluate) -> FrameSequence[StereoFrame]:
    """The frames that are asked for, with the rig that is asked for."""
    assert not isinstance(job.source, Maps)
    whole = opened_with_rig(
        job.source,
        job.rig,
        scale_calibration=job.scale_calibration,
        unit=job.rig_unit,
        swap=job.swap,
    )
    return select(pairs_of(whole), job.frames, job.exclude)


def compare_maps(job: Evaluate) -> DisparityReport:
    """Compare files with files of the same name."""
    estimate = job.source.path
    if job.reference is None:
        raise UsageError(
            "disparity maps without a reference", want="the truth", fix="Add --reference GT."
        )
    pairs = paired_maps(Path(estimate), job.reference)
    errors = [disparity_errors(read_map(mine), read_map(theirs)) for _, mine, theirs in pairs]
    return DisparityReport(f"{estimate} against {job.reference}", DisparityScore(errors))
