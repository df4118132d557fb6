"""`evaluate obstacles`: find, measure, and compare with labels, frame by frame."""

from __future__ import annotations

import time
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from pseudolidar.errors import ReferenceMissing
from pseudolidar.evaluation.average_precision import BoxedFrame, average_precisions
from pseudolidar.evaluation.obstacles import JudgedObject, judged_objects
from pseudolidar.evaluation.obstacles_report import ObstaclesReport
from pseudolidar.obstacles.combined import Combined
from pseudolidar.obstacles.detector import Detector, DetectorSettings
from pseudolidar.obstacles.labels import Labels
from pseudolidar.obstacles.measure import measured
from pseudolidar.running.bad_frames import OnError, good_frames
from pseudolidar.running.crew.attempt import Skipped
from pseudolidar.running.crew.crew_plan import CrewPlan
from pseudolidar.running.drawn_frames import detector_for
from pseudolidar.running.networks import networks_of, with_times
from pseudolidar.running.progress import FrameProgress
from pseudolidar.running.sighting import SightFrame
from pseudolidar.running.stream import stream
from pseudolidar.sources.source import FrameSequence
from pseudolidar.structures.frame import StereoFrame


@dataclass(frozen=True, eq=False)
class JudgedFrame:
    """What is kept of one frame.

    Args:
        objects: its labels with what was measured.
        boxes: for average precision.
        seconds: of matching, finding and measuring.
    """

    objects: tuple[JudgedObject, ...]
    boxes: BoxedFrame
    seconds: float


@dataclass(frozen=True)
class JudgeObstacles:
    """Finds and measures the obstacles of a frame: pure, picklable.

    Args:
        sight: frame to sight.
        detect: finds objects.
    """

    sight: SightFrame
    detect: Detector

    def __call__(self, frame: StereoFrame) -> JudgedFrame | None:
        """Its labels with what was measured of them; None if it has no labels."""
        if frame.labels is None:
            return None
        begin_s = time.perf_counter()
        sight = self.sight(frame).sight
        obstacles = measured(sight, self.detect(sight))
        seconds = time.perf_counter() - begin_s
        judged = judged_objects(frame.id, frame.labels, obstacles, sight.camera, sight.depth)
        return JudgedFrame(judged, BoxedFrame.of(frame.labels, obstacles), seconds)


def judge_obstacles(
    source: FrameSequence[StereoFrame],
    sight: SightFrame,
    detectors: Sequence[DetectorSettings],
    *,
    subject: str,
    crew: CrewPlan,
    on_error: OnError,
    tried: int,
    warnings: tuple[str, ...] = (),
) -> ObstaclesReport:
    """Judge every frame that has labels.

    Args:
        source: pairs.
        sight: frame to sight.
        detectors: say where objects are; what two of them see is one object.
        subject: what is judged, one line.
        crew: how frames are done.
        on_error: what a bad frame does.
        tried: a source of which so many first frames have no labels has none.
        warnings: what is odd about the pairs.

    Raises:
        ReferenceMissing: no frame has labels.
    """
    one = detectors[0] if len(detectors) == 1 else Combined(tuple(detectors))
    per_frame = JudgeObstacles(sight, detector_for(one.load(), source))
    skipped: list[Skipped] = []
    judged: list[JudgedFrame] = []
    without: list[str] = []
    outcomes = stream(source, per_frame, crew=crew)
    with FrameProgress(len(source.ids)) as progress:
        for frame in good_frames(
            outcomes, frames=len(source.ids), on_error=on_error, skipped=skipped.append
        ):
            progress.advance()
            if frame.value is not None:
                judged.append(frame.value)
                continue
            without.append(frame.id)
            if not judged and len(without) >= tried:
                break
    if not judged:
        raise ReferenceMissing(
            f"{source.summary.line}: no frame has labels",
            want="such as KITTI object or tracking training data, or a synthetic street",
            fix="Take another source, or see what is found without truth: `pseudolidar obstacles`.",
            path=source.summary.path,
        )
    return ObstaclesReport(
        subject=subject,
        objects=[one for frame in judged for one in frame.objects],
        frames=len(judged),
        precisions=average_precisions([frame.boxes for frame in judged]),
        found_by_labels=any(isinstance(detector, Labels) for detector in detectors),
        networks=with_times(networks_of(per_frame), per_frame),
        without_labels=tuple(without),
        seconds_per_frame=float(np.median([frame.seconds for frame in judged])),
        skipped=[(frame.id, str(frame.error)) for frame in skipped],
        warnings=warnings,
        unpaired=source.summary.unpaired,
    )
