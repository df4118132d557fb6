"""Drift over segments of the path, as KITTI's odometry benchmark measures it."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Self

import numpy as np

from pseudolidar.errors import UsageError
from pseudolidar.evaluation.trajectory.motions import angles_rad, lengths, motions, path_lengths
from pseudolidar.structures.arrays import Float64, Int64

# Lengths and distance of the segments' first frames: KITTI odometry devkit, evaluate_odometry.cpp.
KITTI_M = (100, 200, 300, 400, 500, 600, 700, 800)
KITTI_STEP = 10
# For pieces too short for those, from every frame.
SHORT_M = (10, 20, 30, 40)
SHORT_STEP = 1
NAMES = {"kitti": KITTI_M, "short": SHORT_M}
AUTO, WHOLE = "auto", "whole"


@dataclass(frozen=True)
class SegmentLengths:
    """The segments that drift is measured over, as written on the command line.

    Args:
        text: `auto` (100-800 m where the path is that long, else 10-40 m, else all of it),
            `kitti`, `short`, `whole`, or whole metres such as 10,20,50.
    """

    text: str = AUTO

    def __post_init__(self) -> None:
        if self.text not in (AUTO, WHOLE, *NAMES) and not self._metres:
            raise UsageError(
                f"{self.text!r}",
                want=f"{AUTO}, {', '.join(NAMES)}, {WHOLE}, or metres such as 10,20,50",
            )

    @classmethod
    def parse(cls, text: str) -> Self:
        """From `auto`, `kitti`, `short`, `whole`, `10,20,30`.

        Raises:
            UsageError: none of these.
        """
        return cls(text.strip())

    def __str__(self) -> str:
        return self.text

    @property
    def _metres(self) -> tuple[int, ...]:
        parts = [part.strip() for part in self.text.split(",")]
        legal = all(part.isascii() and part.isdecimal() and 0 < len(part) < 7 for part in parts)
        return tuple(sorted({int(part) for part in parts} - {0})) if legal else ()

    def of(self, path_m: float) -> tuple[int, ...]:
        """Lengths, m; none for the whole path as one segment."""
        if self.text == WHOLE:
            return ()
        if self.text != AUTO:
            return NAMES.get(self.text) or self._metres
        reached = [name for name, metres in NAMES.items() if path_m > metres[0]]
        return NAMES[reached[0]] if reached else ()


ANY_LENGTHS = SegmentLengths()


@dataclass(frozen=True, eq=False)
class Segments:
    """Errors of segments.

    Args:
        lengths_m: that were asked for; none for the whole path.
        length_m: (M,) of each segment: the nominal one, or that of the whole path.
        first: (M,) index of its first pose.
        t_rel: (M,) translation error by metre of path.
        r_rel_rad_per_m: (M,) rotation error by metre of path.
    """

    lengths_m: tuple[int, ...]
    length_m: Float64
    first: Int64
    t_rel: Float64
    r_rel_rad_per_m: Float64

    def __len__(self) -> int:
        return len(self.first)

    @property
    def mean_t_rel(self) -> float | None:
        """Over all segments, whatever their length, as the benchmark's table has it."""
        return float(self.t_rel.mean()) if len(self) else None

    @property
    def mean_r_rel_deg_per_m(self) -> float | None:
        """The same of rotations."""
        return float(np.degrees(self.r_rel_rad_per_m.mean())) if len(self) else None

    def by_length(self) -> list[SegmentRow]:
        """Means of every length that was asked for, also of those that no segment has."""
        wanted: Sequence[float] = self.lengths_m or sorted(set(self.length_m.tolist()))
        rows = []
        for length_m in wanted:
            mine = self.length_m == length_m
            n = int(mine.sum())
            t_rel = float(self.t_rel[mine].mean()) if n else None
            r_rel = float(np.degrees(self.r_rel_rad_per_m[mine].mean())) if n else None
            rows.append(SegmentRow(float(length_m), n, t_rel, r_rel))
        return rows


@dataclass(frozen=True)
class SegmentRow:
    """Segments of one length.

    Args:
        length_m: of the path of the reference.
        n: how many.
        t_rel: mean translation error by metre, a fraction.
        r_rel_deg_per_m: mean rotation error.
    """

    length_m: float
    n: int
    t_rel: float | None
    r_rel_deg_per_m: float | None


def segment_errors(
    T_world_estimate: Float64, T_world_reference: Float64, wanted: SegmentLengths
) -> Segments:
    """Errors of every segment of the reference's path.

    A segment ends at the first pose further along than its length, and its error counts by its
    nominal length. Segments begin at every tenth pose where they are of 100 m or more, as in the
    benchmark (every second of a drive), else at every pose.

    Args:
        T_world_estimate: (N, 4, 4), its world need not be the reference's.
        T_world_reference: (N, 4, 4).
        wanted: which lengths.

    Source: Geiger et al., Are we ready for autonomous driving?, CVPR 2012; KITTI odometry devkit,
        evaluate_odometry.cpp (calcSequenceErrors).
    """
    path_m = path_lengths(T_world_reference)
    metres = wanted.of(float(path_m[-1]))
    if metres:
        step = KITTI_STEP if min(metres) >= KITTI_M[0] else SHORT_STEP
        first, last, length_m = _segments(path_m, metres, step)
    else:
        whole = np.array([0], np.int64) if path_m[-1] > 0 else np.empty(0, np.int64)
        first, last = whole, whole + len(path_m) - 1
        length_m = np.full(len(whole), path_m[-1])
    reference = motions(T_world_reference[first], T_world_reference[last])
    errors = motions(motions(T_world_estimate[first], T_world_estimate[last]), reference)
    return Segments(
        metres, length_m, first, lengths(errors) / length_m, angles_rad(errors) / length_m
    )


def _segments(path_m: Float64, metres: Sequence[int], step: int) -> tuple[Int64, Int64, Float64]:
    begins = np.arange(0, len(path_m), step, dtype=np.int64)
    first, length_m = (
        np.repeat(begins, len(metres)),
        np.tile(np.array(metres, np.float64), len(begins)),
    )
    last = np.searchsorted(path_m, path_m[first] + length_m, side="right").astype(np.int64)
    there = last < len(path_m)
    return first[there], last[there], length_m[there]
