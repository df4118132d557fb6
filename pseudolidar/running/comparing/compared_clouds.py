"""The comparison of a source's clouds with their references, frame by frame."""

from __future__ import annotations

from collections.abc import Callable

from pseudolidar.evaluation.cloud_distances import CloudDistances
from pseudolidar.evaluation.comparison.bins import DepthBins
from pseudolidar.evaluation.comparison.clouds import compare_clouds
from pseudolidar.running.bad_frames import OnError
from pseudolidar.running.comparing.gathered import Missing, bare, nothing_in_common
from pseudolidar.running.comparing.pass_through import pass_through
from pseudolidar.running.comparing.references import SCAN
from pseudolidar.running.crew.attempt import AnyFrame
from pseudolidar.running.crew.crew_plan import CrewPlan
from pseudolidar.running.reports.clouds_report import CloudsReport
from pseudolidar.sources.source import FrameSequence

# Compares the cloud of one frame; None where that has no reference. Pure, picklable.
Comparing = Callable[[AnyFrame], CloudDistances | None]


def compared_clouds(
    source: FrameSequence[AnyFrame],
    per_frame: Comparing[AnyFrame],
    *,
    subject: str,
    reference: str,
    bins: DepthBins,
    crew: CrewPlan,
    on_error: OnError,
    tried: int,
    check: bool = False,
) -> CloudsReport:
    """Distances of every frame, then figures with intervals.

    Args:
        source: the clouds, or pairs that they are made of.
        per_frame: compares the cloud of one frame; None where that has no reference.
        subject: what is compared, one line.
        reference: with what.
        bins: of the points' range.
        crew: how the frames are done.
        on_error: what a bad frame does.
        tried: frames after which a source without any reference is given up.
        check: look at a few pairs first.

    Raises:
        ReferenceMissing: no frame has a reference, or none in its view.
    """
    missing = Missing(
        source.summary.line, source.summary.path, tried=tried, want="LiDAR scans of its frames"
    )
    frames: list[CloudDistances] = []

    def keep(distances: CloudDistances | None) -> str | None:
        against = None if distances is None else SCAN
        missing.see(against)
        frames.extend([] if distances is None else [distances])
        return against

    result = pass_through(source, per_frame, keep, crew=crew, on_error=on_error, check=check)
    if not frames:
        raise missing.error()
    if not any(len(each.accuracy_m) or len(each.completeness_m) for each in frames):
        raise nothing_in_common(source.summary, "the clouds of no frame have a view in common")
    compared = compare_clouds(frames, subject=subject, reference=reference, bins=bins)
    return CloudsReport(compared, result, len(bare(result.records)), source.summary.notes)
