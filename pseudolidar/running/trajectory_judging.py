"""`evaluate trajectory`: read, pair, align, compare."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Literal

from pseudolidar.errors import ReferenceMissing
from pseudolidar.evaluation.trajectory.judge import Alignment, judge_trajectory
from pseudolidar.evaluation.trajectory.pairing import TimePairing, paired
from pseudolidar.evaluation.trajectory.segments import SegmentLengths
from pseudolidar.evaluation.trajectory.steps import DEFAULT_STEPS, RpeChoice
from pseudolidar.formats.trajectory_file import PoseRecord
from pseudolidar.running.pose_reading import PosedBody, read_poses
from pseudolidar.running.reports.trajectory_report import TrajectoryReport

BodyChoice = Literal["auto", "base_link", "camera_left"]


@dataclass(frozen=True)
class Poses:
    """Poses in a file: TUM, KITTI or EuRoC.

    Args:
        path: the file.
    """

    path: Path


@dataclass(frozen=True)
class TrajectoryJudging:
    """How a trajectory is compared with another.

    Args:
        align: how the estimate is laid onto the reference first.
        pair: how poses of both are paired.
        rpe: motions that relative errors are of.
        segments: lengths that drift is measured over.
        times: of the estimate's poses, where its file has none.
        reference_times: of the reference's.
        body: whose poses a source tells, where the reference is one.
    """

    align: Alignment = "se3"
    pair: TimePairing = TimePairing()
    rpe: RpeChoice = DEFAULT_STEPS
    segments: SegmentLengths = SegmentLengths()
    times: Path | None = None
    reference_times: Path | None = None
    body: BodyChoice = "auto"

    def judge(self, estimate: Path, reference: Path | None) -> TrajectoryReport:
        """Errors of an estimate.

        Raises:
            ReferenceMissing: nothing to compare with.
            PoseFileError, SequenceTime, PoseMissing, LimitError, SourceUnknown: a file, or a pair.
        """
        if reference is None:
            raise ReferenceMissing(
                "a trajectory without a reference",
                want="the true one: a file (TUM, KITTI, EuRoC) or a source with poses",
                fix="Add --reference REF.",
                path=estimate,
            )
        body: PosedBody = "base_link" if self.body == "auto" else self.body
        own = read_poses(estimate, body=body, times=self.times)
        other = read_poses(reference, body=self._body(own), times=self.reference_times)
        pairs = paired(own, other, self.pair)
        errors = judge_trajectory(
            pairs, align=self.align, steps=self.rpe.each, segments=self.segments
        )
        return TrajectoryReport(own, other, errors, self.align)

    def _body(self, estimate: PoseRecord) -> PosedBody:
        """KITTI's pose files are of the left camera; of others nobody knows."""
        if self.body != "auto":
            return self.body
        return "camera_left" if estimate.form == "KITTI" else "base_link"
