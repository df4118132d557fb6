"""A rig put right by depths that are known, judged on frames outside the fit."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from pseudolidar.calibration.reference import Reference
from pseudolidar.calibration.refine import refined
from pseudolidar.errors import PseudolidarError, ReferenceMissing
from pseudolidar.evaluation.compared import ComparedFrame, against_scan, against_truth
from pseudolidar.running.bad_frames import OnError, good_frames
from pseudolidar.running.crew.attempt import Skipped
from pseudolidar.running.crew.crew_plan import CrewPlan
from pseudolidar.running.progress import FrameProgress
from pseudolidar.running.reports.reference_refinement import Judged, ReferenceRefinement
from pseudolidar.running.stream import stream
from pseudolidar.sources.source import FrameSource
from pseudolidar.stereo.matcher import StereoMatcher
from pseudolidar.structures.frame import StereoFrame
from pseudolidar.structures.samples import DisparitySamples

# Frames are left out in so many turns to judge what the correction is worth.
FOLDS = 5
# Points beyond these quantiles of depth are too few to say what the rig does there.
OUTER = (0.01, 0.99)


@dataclass(frozen=True)
class CompareFrame:
    """Matches one frame and compares it with its reference.

    Args:
        matcher: pair to disparity.
        kind: which reference.
        most: points to keep.
    """

    matcher: StereoMatcher
    kind: str
    most: int

    def __call__(self, frame: StereoFrame) -> ComparedFrame | None:
        """The comparison; None where the frame has no such reference."""
        if self.kind != "truth" and frame.scan is not None:
            return against_scan(self.matcher(frame), frame).thinned(self.most)
        if self.kind != "scan" and frame.truth is not None:
            return against_truth(self.matcher(frame), frame, most=self.most)
        return None


def refined_by_reference(
    source: FrameSource,
    by: Reference,
    matcher: StereoMatcher,
    *,
    crew: CrewPlan,
    on_error: OnError = "skip",
) -> ReferenceRefinement:
    """Match and compare every frame, fit, and judge on frames left out of the fit.

    Args:
        source: pairs with scans or ground truth.
        by: which of them.
        matcher: pair to disparity.
        crew: how the frames are done.
        on_error: what happens when frames fail.

    Raises:
        ReferenceMissing: no frame has a reference.
        CalibrationValue: too little of it, or frames of several image sizes.
        CalibrationUnits: the rig's lengths are no metres.
        TooManyBadFrames: as `good_frames`.
    """
    source.rig.check_metric()
    compare = CompareFrame(matcher, by.kind, max(1, by.most // max(1, len(source.ids))))
    compared: list[ComparedFrame] = []
    without = 0
    skipped: list[Skipped] = []
    outcomes = stream(source, compare, crew=crew)
    with FrameProgress(len(source.ids)) as progress:
        for frame in good_frames(
            outcomes, frames=len(source.ids), on_error=on_error, skipped=skipped.append
        ):
            progress.advance()
            if frame.value is None:
                without += 1
            else:
                compared.append(frame.value)
    if not compared:
        raise ReferenceMissing(
            f"{source.summary.line}: no frame has a reference",
            want="frames with LiDAR scans or ground truth",
            fix="Take another source, or fit to the motion of a sequence: --by motion.",
            path=source.summary.path,
        )
    stock = [each.with_correction(None) for each in compared]
    fitted_m = _fitted_m(stock)
    found = refined(_samples(stock), origin=_origin(source, stock), fitted_m=fitted_m)
    rig = source.rig.with_correction(found.correction if found.corrects else None)
    return ReferenceRefinement(
        rig=rig.with_lidar_raised(found.lidar_pitch_rad),
        refinement=found,
        before=Judged.of(compared),
        after=_on_frames_left_out(stock),
        kinds={kind: n for kind, n in _kinds(stock).items() if n},
        without=without,
        skipped=[(frame.id, str(frame.error)) for frame in skipped],
        replaced=source.rig.correction is not None,
    )


def _samples(frames: Sequence[ComparedFrame]) -> DisparitySamples:
    return DisparitySamples.concatenate([frame.samples() for frame in frames])


def _fitted_m(frames: Sequence[ComparedFrame]) -> tuple[float, float]:
    """Nearest and farthest depth of the points, but for one in a hundred; 0, 0 without any."""
    depth_m = np.concatenate([frame.reference_m[frame.matched] for frame in frames])
    if not len(depth_m):
        return 0.0, 0.0
    near_m, far_m = np.quantile(depth_m, OUTER)
    return float(near_m), float(far_m)


def _kinds(frames: Sequence[ComparedFrame]) -> dict[str, int]:
    return {kind: sum(f.kind == kind for f in frames) for kind in ("scan", "truth")}


def _origin(source: FrameSource, frames: Sequence[ComparedFrame]) -> str:
    words = {"scan": "LiDAR scans", "truth": "ground truth"}
    kinds = " and ".join(words[kind] for kind, n in _kinds(frames).items() if n)
    return f"{kinds} of {len(frames)} frames of {source.summary.name}"


def _on_frames_left_out(frames: Sequence[ComparedFrame]) -> Judged | None:
    """Each frame judged by a correction that was fitted to others; None for one frame."""
    turns = min(FOLDS, len(frames))
    if turns < 2:
        return None
    judged: list[ComparedFrame] = []
    for turn in range(turns):
        others = [frame for i, frame in enumerate(frames) if i % turns != turn]
        try:
            found = refined(_samples(others))
        except PseudolidarError:
            return None  # too few points without them
        judged += [
            frame.with_correction(found.correction).raised(found.lidar_pitch_rad)
            for frame in frames[turn::turns]
        ]
    return Judged.of(judged)
