"""How mapping went: for people, for programs, and what to open."""

from __future__ import annotations

import functools
from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass, field
from pathlib import Path
from typing import Any

from pseudolidar.errors import ALL_DONE, SOME_SKIPPED
from pseudolidar.evaluation.trajectory.consistency import Consistency, consistency_of
from pseudolidar.evaluation.trajectory.judge import TrajectoryErrors, judge_trajectory
from pseudolidar.evaluation.trajectory.pairing import FEWEST_PAIRS, PairedPoses
from pseudolidar.running.mapped.walked import Piece, Placed, Walked
from pseudolidar.running.reports.numbers import counted, percent
from pseudolidar.running.results import RunResult
from pseudolidar.structures.loop import LoopClosure

# Frames that are named one by one.
NAMED_FRAMES = 5


@dataclass(frozen=True, eq=False)
class MapReport:
    """What was made.

    Args:
        result: frames, figures and times.
        out: output folder.
        walked: the path with its loops; frames that were lost are in none of its pieces.
        errors: of the longest against the poses of the source; None where it has none.
        seconds_per_frame: wall time of matching and odometry together.
        files: what there is to open.
        map: figures of the map; none where none was made.
    """

    result: RunResult
    out: Path
    walked: Walked
    errors: TrajectoryErrors | None
    seconds_per_frame: float | None
    files: Sequence[Path] = ()
    map: Mapping[str, Any] = field(default_factory=dict)

    @classmethod
    def stopped(cls, result: RunResult, out: Path) -> MapReport:
        """Of a run that was stopped before it had a path."""
        return cls(result, out, Walked(()), None, None)

    @property
    def exit_code(self) -> int:
        """0 all done, 4 some frames skipped or lost, or a path that ends, 130 or 143 stopped."""
        some_lost = bool(self.lost or self.walked.ended)
        all_done = self.result.exit_code == ALL_DONE
        return SOME_SKIPPED if some_lost and all_done else self.result.exit_code

    @property
    def placed(self) -> Sequence[Placed]:
        """Every frame, in order."""
        return self.walked.placed

    @property
    def pieces(self) -> Sequence[Piece]:
        """Of path, the longest first."""
        return self.walked.pieces

    @property
    def lost(self) -> list[Placed]:
        """Frames of which nobody knows where they were taken."""
        return [one for one in self.placed if one.lost]

    @property
    def extrapolated(self) -> list[Placed]:
        """Frames of which nothing was measured, between others that were."""
        return [one for one in self.placed if one.extrapolated]

    @functools.cached_property
    def consistency(self) -> Consistency | None:
        """Whether the longest piece is as sure as it says; None where its truth is not known.

        Pieces that loops joined each begin without doubt, so they are none to be asked.
        """
        longest = self.pieces[0] if self.pieces else None
        if longest is None or longest.truth is None or longest.joined:
            return None
        return consistency_of(longest.T_odom_camera, longest.covariance, longest.truth)

    @property
    def odd_scans(self) -> str:
        """Which scans say nothing, and points that are none, in a line; empty where all is well."""
        scans = self.walked.scans
        if scans is None:
            return ""
        reasons = {
            "without a usable point": scans.empty,
            "with too few points or planes": scans.few,
            "that lie nowhere on the map": scans.unplaced,
        }
        told = [f"{count} {reason}" for reason, count in reasons.items() if count]
        line = f"{scans.left_out} of {counted(scans.scans, 'scan')} left out: " + ", ".join(told)
        points = f"{counted(scans.dropped_points, 'point')} of scans dropped that are no places"
        return "; ".join([line] * bool(told) + [points] * bool(scans.dropped_points))

    @property
    def corrected(self) -> list[Placed]:
        """Frames whose step of vision was found to be wrong."""
        return [one for one in self.placed if one.wrong]

    def as_dict(self) -> dict[str, Any]:
        """Path with its errors, map, times; then counts and where the results are."""
        return {
            "trajectory": self._trajectory(),
            "map": dict(self.map),
            "seconds_per_frame": self.seconds_per_frame,
            **self.result.as_dict(),
            "out": str(self.out),
            "files": [str(path) for path in self.files],
            "exit_code": self.exit_code,
        }

    def _trajectory(self) -> dict[str, Any]:
        longest = self.pieces[0] if self.pieces else None
        told: dict[str, Any] = {
            "frames": 0 if longest is None else len(longest.frames),
            "frames_judged": 0,
            "length_m": 0.0 if longest is None else longest.length_m,
            "end_error_rel": None,
            "t_rel": None,
            "segments_m": None,
            "r_rel_deg_per_m": None,
            "ape_rmse_m": None,
        }
        if self.errors is not None:
            frames = {"frames": told["frames"], "frames_judged": len(self.errors.pairs)}
            told |= self.errors.summary() | frames
        return told | {
            "nees": None if self.consistency is None else self.consistency.medians,
            "pieces": len(self.pieces),
            "loops": [loop_dict(loop) for loop in self.walked.loops],
            "loops_dropped": [loop_dict(loop) for loop in self.walked.dropped],
            "loops_refused": dict(self.walked.refused),
            "lost": [one.id for one in self.lost],
            "extrapolated": [one.id for one in self.extrapolated],
            "scans": None if self.walked.scans is None else asdict(self.walked.scans),
            "by_sensors": dict(Counter(one.sensors for one in self.placed)),
            "ended": [error.as_dict() for error in self.walked.ended],
            "corrected": [one.id for one in self.corrected],
        }

    def text(self) -> str:
        """The same for people, and what to open."""
        lines = [
            self.result.text(),
            *self._path_lines(),
            *self._trouble_lines(),
            *self._map_lines(),
        ]
        return "\n".join([*lines, *(f"  {path}" for path in self.files if path.exists())])

    def _path_lines(self) -> list[str]:
        if self.result.ended_early or not self.pieces:
            return []
        longest = self.pieces[0]
        line = f"  path of {longest.length_m:.2f} m through {counted(len(longest.frames), 'frame')}"
        if self.seconds_per_frame is not None:
            line += f", {self.seconds_per_frame:.3f} s a frame"
        if self.errors is None:
            return [line]
        told = self.errors.summary()
        segments = ", ".join(f"{length:.0f}" for length in told["segments_m"])
        return [
            line,
            f"  against the source's own poses{self._judged()}: {percent(told['end_error_rel'])} "
            f"of the way at the end, t_rel {percent(told['t_rel'])} ({segments} m), "
            f"APE {told['ape_rmse_m']:.3f} m rmse",
        ]

    def _judged(self) -> str:
        """How many poses errors are of, where some were not measured."""
        if self.errors is None or not self.pieces or self.pieces[0].measured.all():
            return ""
        return f" ({len(self.errors.pairs)} that were measured)"

    def _trouble_lines(self) -> list[str]:
        lines = []
        if len(self.pieces) > 1:
            more = ", ".join(f"{piece.length_m:.1f}" for piece in self.pieces[1:])
            lines.append(f"  {counted(len(self.pieces), 'piece')} of path: others of {more} m")
        lines += [f"  {error}" for error in self.walked.ended]
        blind = [one for one in self.placed if one.blind]
        if blind:
            names = ", ".join(one.id for one in blind[:NAMED_FRAMES])
            lines.append(f"  {counted(len(blind), 'frame')} by scans alone: {names}")
        if self.odd_scans:
            lines.append(f"  {self.odd_scans}")
        lines += _named("extrapolated", self.extrapolated)
        lines += _named("lost", self.lost)
        if self.walked.loops or self.walked.dropped:
            lines.append(
                f"  {counted(len(self.walked.loops), 'loop')} closed, "
                f"{len(self.walked.dropped)} dropped: see the report's pictures"
            )
        if self.corrected:
            names = ", ".join(one.id for one in self.corrected[:NAMED_FRAMES])
            lines.append(
                f"  {counted(len(self.corrected), 'wrong step')} of vision caught: {names}"
            )
        return lines

    def _map_lines(self) -> list[str]:
        points, mesh = self.map.get("points"), self.map.get("mesh")
        lines = [] if points is None else [f"  map of {points:,} points"]
        if mesh is not None:
            lines.append(
                f"  mesh of {mesh['triangles']:,} triangles, {mesh['area_m2']:.0f} m2, "
                f"{counted(mesh['holes'], 'hole')} of {mesh['holes_m2']:.1f} m2"
            )
        return lines


def _named(what: str, frames: Sequence[Placed]) -> list[str]:
    """The first frames one by one, with the reason, and how many more there are."""
    lines = [f"  {what}: {one.id}: {one.why}" for one in frames[:NAMED_FRAMES]]
    more = len(frames) - NAMED_FRAMES
    return [*lines, f"  {what}: {more} more"] if more > 0 else lines


def loop_dict(loop: LoopClosure) -> dict[str, float | int]:
    """What a loop rests on, plain JSON values."""
    return {
        "earlier": loop.earlier.index,
        "later": loop.later.index,
        "points": loop.inliers,
        "matches": loop.matches,
        "residual_px": loop.residual_px,
        "overlap": loop.overlap,
        "both_ways_m": loop.both_ways_m,
        "both_ways_deg": loop.both_ways_deg,
        "correction_m": loop.correction_m,
        "correction_deg": loop.correction_deg,
    }


def errors_of(pieces: Sequence[Piece]) -> TrajectoryErrors | None:
    """Errors of the longest piece against the source's poses; None where it has not all of them.

    Poses are judged that were measured. Those between them are none of odometry's doing.
    """
    truth = pieces[0].truth if pieces else None
    if truth is None:
        return None
    longest, measured = pieces[0], pieces[0].measured
    if measured.sum() < FEWEST_PAIRS:
        return None
    poses, times_ns = longest.T_odom_camera[measured], longest.times_ns[measured]
    return judge_trajectory(PairedPoses.of_frames(poses, truth[measured], times_ns))
