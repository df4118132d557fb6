"""What `evaluate trajectory` tells, for people and as JSON."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np

from pseudolidar.errors import ALL_DONE
from pseudolidar.evaluation.trajectory.judge import (
    OPEN_TURN_DEG,
    Alignment,
    RelativeErrors,
    TrajectoryErrors,
)
from pseudolidar.evaluation.trajectory.statistics import ErrorStatistics, statistics_dict
from pseudolidar.formats.timestamps import NS_PER_S
from pseudolidar.formats.trajectory_file import PoseRecord
from pseudolidar.running.reports.numbers import counted, percent
from pseudolidar.running.table import table_text
from pseudolidar.structures.arrays import Float64

ALIGNED = {
    "none": "not aligned",
    "origin": "first pose laid onto first pose",
    "se3": "aligned by a rigid motion (Umeyama)",
    "sim3": "aligned by a rigid motion and a scale (Umeyama)",
}
PAIRED = {
    "nearest": "paired by nearest time",
    "interpolate": "paired by time, interpolated",
    "index": "paired by their place in the files",
}
OPEN_TURN = "the path is a straight line: a turn about it is open, and rotations mean little"
NEARLY_OPEN = (
    "the path is nearly straight: positions leave a turn of {:.1f} deg about it open, "
    "and rotations of poses are no surer; those of motions are"
)


@dataclass(frozen=True, eq=False)
class TrajectoryReport:
    """Errors of a trajectory against its reference.

    Args:
        estimate: what was judged.
        reference: by what.
        errors: how far it is off.
        align: how it was laid onto the reference.
        files: what was written.
    """

    estimate: PoseRecord
    reference: PoseRecord
    errors: TrajectoryErrors
    align: Alignment
    files: Sequence[Path] = field(default=())

    @property
    def exit_code(self) -> int:
        """0."""
        return ALL_DONE

    @property
    def notes(self) -> tuple[str, ...]:
        """What is odd, or was assumed."""
        still = ("the reference does not move",) if not self.errors.length_m else ()
        every = (
            *self.estimate.notes,
            *self.reference.notes,
            *self.errors.pairs.notes,
            *((self.open_turn,) if self.turn_is_open else ()),
            *still,
        )
        return tuple(dict.fromkeys(every))  # a source may be both

    @property
    def fitted(self) -> bool:
        """Whether positions alone say how the estimate is laid onto the reference."""
        return self.align in ("se3", "sim3")

    @property
    def turn_sigma_deg(self) -> float | None:
        """One standard deviation of the turn about the path; None where open, or not fitted."""
        return self.errors.turn_sigma_deg if self.fitted else None

    @property
    def turn_is_open(self) -> bool:
        """Whether rotations of poses may be off by a turn about the path that nobody made."""
        sigma_deg = self.turn_sigma_deg
        return self.fitted and (sigma_deg is None or sigma_deg > OPEN_TURN_DEG)

    @property
    def open_turn(self) -> str:
        """Why rotations of poses mean little, in a line."""
        sigma_deg = self.turn_sigma_deg
        return OPEN_TURN if sigma_deg is None else NEARLY_OPEN.format(sigma_deg)

    @property
    def subject(self) -> str:
        """One line."""
        return (
            f"{self.estimate.path} ({self.estimate.form}) against "
            f"{self.reference.path} ({self.reference.form})"
        )

    @property
    def duration_s(self) -> float | None:
        """From the first pair to the last; None without times."""
        times_ns = self.errors.pairs.times_ns
        return None if times_ns is None else int(times_ns[-1] - times_ns[0]) / NS_PER_S

    def as_dict(self) -> dict[str, Any]:
        """Absolute errors, relative ones, drift; then how they came about."""
        errors, drift = self.errors, self.errors.segments
        rows = [_relative_dict(each) for each in errors.relative]
        return {
            "ape": _both(errors.ape_m, errors.ape_rad),
            "rpe": {**(rows[0] if rows else {}), "by_step": rows},
            "kitti": {
                "t_rel": drift.mean_t_rel,
                "r_rel_deg_per_m": drift.mean_r_rel_deg_per_m,
                "segments_m": list(drift.lengths_m) or [errors.length_m],
                "n": len(drift),
                "by_length": [dict(vars(row)) for row in drift.by_length()],
            },
            "end_error_rel": errors.end_error_rel,
            "align": self.align,
            "turn_sigma_deg": self.turn_sigma_deg,
            "scale": errors.alignment.scale,
            "T_reference_estimate": _matrix(errors).tolist(),
            "frames": len(errors.pairs),
            "length_m": errors.length_m,
            "duration_s": self.duration_s,
            "paired_by": errors.pairs.by,
            "largest_difference_s": errors.pairs.largest_difference_s,
            "estimate": _record_dict(self.estimate),
            "reference": _record_dict(self.reference),
            "files": [str(file) for file in self.files],
            "notes": list(self.notes),
        }

    def text(self) -> str:
        """Tables for a terminal."""
        errors, drift = self.errors, self.errors.segments
        lines = [self.subject, self.pairing_line, self.alignment_line, self.table, self.drift_line]
        lines += [
            f"  {row.length_m:5.0f} m  {counted(row.n, 'segment'):>14}  {percent(row.t_rel):>8}  "
            f"{degrees(row.r_rel_deg_per_m)} deg/m"
            for row in drift.by_length()
            if row.n
        ]
        if errors.end_error_rel is not None:
            lines.append(f"at the end off by {percent(errors.end_error_rel)} of the path")
        lines += [f"note: {note}" for note in self.notes]
        return "\n".join([*lines, *(f"written: {file}" for file in self.files)])

    @property
    def pairing_line(self) -> str:
        """How many poses, of what path, and how they were paired."""
        pairs = self.errors.pairs
        line = f"{counted(len(pairs), 'pose')}, {self.errors.length_m:.1f} m"
        if self.duration_s is not None:
            line += f", {self.duration_s:.1f} s"
        line += f"; {PAIRED[pairs.by]}"
        if pairs.largest_difference_s is not None:
            line += f", at most {1e3 * pairs.largest_difference_s:.3g} ms apart"
        return line

    @property
    def alignment_line(self) -> str:
        """How the estimate was laid onto the reference."""
        scale = f": scale {self.errors.alignment.scale:.6f}" if self.align == "sim3" else ""
        return f"{ALIGNED[self.align]}{scale}"

    @property
    def table(self) -> str:
        """Absolute and relative errors."""
        header = ("", "n", "rmse", "mean", "median", "largest")
        return table_text(list(self.rows()), header=header)

    def rows(self) -> Iterator[tuple[str, ...]]:
        """Cells of that table."""
        errors = self.errors
        yield _row("position", errors.ape_m, "m")
        yield _row("rotation", np.degrees(errors.ape_rad), "deg")
        for each in errors.relative:
            yield _row(f"motion over {each.steps.words}", each.rpe_m, "m")
            yield _row("its rotation", np.degrees(each.rpe_rad), "deg")

    @property
    def drift_line(self) -> str:
        """KITTI's measure."""
        drift = self.errors.segments
        lengths = drift.lengths_m
        over = f"segments of {lengths[0]}-{lengths[-1]} m" if lengths else "the whole path"
        return (
            f"drift over {over} (KITTI): translation {percent(drift.mean_t_rel)}, rotation "
            f"{degrees(drift.mean_r_rel_deg_per_m)} deg/m"
        )


def degrees(value: float | None) -> str:
    """Degrees a metre; a dash for none."""
    return "-" if value is None else f"{value:.5f}"


def _row(name: str, errors: Float64, unit: str) -> tuple[str, ...]:
    found = ErrorStatistics.of(errors)
    if found is None:
        return (name, "0", "-", "-", "-", "-")
    values = (found.rmse, found.mean, found.median, found.max)
    return (name, str(found.n), *(f"{value:.4f} {unit}" for value in values))


def _both(errors_m: Float64, errors_rad: Float64) -> dict[str, Any]:
    metres = ErrorStatistics.of(errors_m)
    turned = ErrorStatistics.of(np.degrees(errors_rad))
    return {**statistics_dict(metres, "m"), **statistics_dict(turned, "deg")}


def _relative_dict(errors: RelativeErrors) -> dict[str, Any]:
    """One row; `without_first` is what programs tell that begin at the first pose far enough.

    So did evo before it began at the first pose of all.
    """
    without_first = None
    if errors.steps.unit == "m" and not errors.steps.every:
        without_first = statistics_dict(ErrorStatistics.of(errors.rpe_m[1:]), "m")
    return {
        "delta": errors.steps.delta,
        "unit": errors.steps.unit,
        "from_every_pose": errors.steps.every,
        "n": len(errors.rpe_m),
        **_both(errors.rpe_m, errors.rpe_rad),
        "without_first": without_first,
    }


def _record_dict(record: PoseRecord) -> dict[str, Any]:
    return {
        "path": str(record.path),
        "form": record.form,
        "poses": len(record),
        "times_from": None if record.times_from is None else str(record.times_from),
        "timed": record.times_ns is not None,
    }


def _matrix(errors: TrajectoryErrors) -> Float64:
    matrix = np.eye(4)
    matrix[:3, :3], matrix[:3, 3] = errors.alignment.R, errors.alignment.t_m
    return matrix
