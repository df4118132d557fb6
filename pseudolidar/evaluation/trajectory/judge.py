"""Errors of an estimated trajectory against a reference."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, Literal

import numpy as np

from pseudolidar.evaluation.trajectory.motions import (
    angles_rad,
    inverses,
    lengths,
    motions,
    path_lengths,
)
from pseudolidar.evaluation.trajectory.pairing import PairedPoses
from pseudolidar.evaluation.trajectory.segments import (
    ANY_LENGTHS,
    SegmentLengths,
    Segments,
    segment_errors,
)
from pseudolidar.evaluation.trajectory.steps import DEFAULT_STEPS, RpeSteps
from pseudolidar.geometry.similarity import Similarity, similarity_of, turn_sigma_rad
from pseudolidar.structures.arrays import Float64, Int64

Alignment = Literal["none", "se3", "sim3", "origin"]
# Turns about the path that positions leave less sure than this are told: rotations of odometry are
# off by about a degree on KITTI 00.
OPEN_TURN_DEG = 2.0


@dataclass(frozen=True, eq=False)
class RelativeErrors:
    """How far motions between poses are off.

    Args:
        steps: what the motions are over.
        pairs: (M, 2) first and last pose of each.
        rpe_m: (M,) translation that it is off.
        rpe_rad: (M,) rotation that it is off.
    """

    steps: RpeSteps
    pairs: Int64
    rpe_m: Float64
    rpe_rad: Float64


@dataclass(frozen=True, eq=False)
class TrajectoryErrors:
    """An estimate, laid onto its reference, and how far it is off.

    Args:
        pairs: the poses as they were read.
        aligned: (N, 4, 4) the estimate's in the reference's world.
        alignment: what lays it there.
        path_m: (N,) metres of the reference's path up to each pose.
        ape_m: (N,) distance of each pose from where it should be.
        ape_rad: (N,) angle between its rotation and the right one.
        relative: errors of motions, by what they are over.
        segments: drift by length of path.
    """

    pairs: PairedPoses
    aligned: Float64
    alignment: Similarity
    path_m: Float64
    ape_m: Float64
    ape_rad: Float64
    relative: tuple[RelativeErrors, ...]
    segments: Segments

    @property
    def length_m(self) -> float:
        """Of the reference's path."""
        return float(self.path_m[-1])

    @property
    def end_error_rel(self) -> float | None:
        """How far the whole motion is off, by metre of path, a fraction; None for no path."""
        ends = (np.array([0]), np.array([-1]))
        true, own = (motions(T[ends[0]], T[ends[1]]) for T in (self.reference, self.aligned))
        return float(lengths(motions(true, own))[0] / self.length_m) if self.length_m else None

    @property
    def turn_sigma_deg(self) -> float | None:
        """How unsure the turn about the path is where positions alone say it; None where open."""
        if not self.alignment.determined:
            return None
        places, right = self.aligned[:, :3, 3], self.reference[:, :3, 3]
        return float(np.degrees(turn_sigma_rad(places, right)))

    def summary(self) -> dict[str, Any]:
        """What other commands tell of a trajectory that they made, where its truth is known."""
        return {
            "frames": len(self.pairs),
            "length_m": self.length_m,
            "end_error_rel": self.end_error_rel,
            "t_rel": self.segments.mean_t_rel,
            "segments_m": list(self.segments.lengths_m) or [self.length_m],
            "r_rel_deg_per_m": self.segments.mean_r_rel_deg_per_m,
            "ape_rmse_m": float(np.sqrt(np.mean(self.ape_m**2))),
        }

    @property
    def reference(self) -> Float64:
        """(N, 4, 4) the reference's poses."""
        return self.pairs.T_world_reference


def judge_trajectory(
    pairs: PairedPoses,
    *,
    align: Alignment = "se3",
    steps: Sequence[RpeSteps] = DEFAULT_STEPS.each,
    segments: SegmentLengths = ANY_LENGTHS,
) -> TrajectoryErrors:
    """Align, then compare poses, motions and segments.

    Source: Sturm et al., A benchmark for the evaluation of RGB-D SLAM systems, IROS 2012, for
        absolute and relative errors; the definitions are evo's (translation part, angle).

    Args:
        pairs: poses that belong together.
        align: how the estimate is laid onto the reference.
        steps: what the motions are over that relative errors are of.
        segments: lengths that drift is measured over.
    """
    reference = pairs.T_world_reference
    alignment = alignment_of(pairs, align)
    aligned = alignment.poses(pairs.T_world_estimate)
    absolute = motions(reference, aligned)
    return TrajectoryErrors(
        pairs=pairs,
        aligned=aligned,
        alignment=alignment,
        path_m=path_lengths(reference),
        ape_m=np.asarray(np.linalg.norm(aligned[:, :3, 3] - reference[:, :3, 3], axis=1)),
        ape_rad=angles_rad(absolute),
        relative=tuple(_relative(aligned, reference, each) for each in steps),
        segments=segment_errors(aligned, reference, segments),
    )


def _relative(aligned: Float64, reference: Float64, steps: RpeSteps) -> RelativeErrors:
    pairs = steps.pairs(aligned)
    first, last = pairs[:, 0], pairs[:, 1]
    errors = motions(
        motions(reference[first], reference[last]), motions(aligned[first], aligned[last])
    )
    return RelativeErrors(steps, pairs, lengths(errors), angles_rad(errors))


def alignment_of(pairs: PairedPoses, align: Alignment) -> Similarity:
    """What lays the estimate onto the reference: nothing, first pose on first pose, or a fit."""
    if align == "none":
        return Similarity(np.eye(3), np.zeros(3))
    if align == "origin":
        (T,) = pairs.T_world_reference[:1] @ inverses(pairs.T_world_estimate[:1])
        return Similarity(T[:3, :3], T[:3, 3])
    own, other = (T[:, :3, 3] for T in (pairs.T_world_estimate, pairs.T_world_reference))
    return similarity_of(own, other, scaled=align == "sim3")
