"""What a calibration is worth, in words, and what would make it better."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

import numpy as np

from pseudolidar.calibration.boards.corners import Corners
from pseudolidar.calibration.boards.coverage import Coverage
from pseudolidar.calibration.solving.choose import Candidate
from pseudolidar.calibration.solving.uncertainty import Uncertainty
from pseudolidar.structures.arrays import Float64

Grade = Literal["good", "fair", "poor"]
GRADES: tuple[Grade, ...] = ("good", "fair", "poor")
# Limits of good, and of fair. Rows on held-out views: below half a pixel a matcher does not suffer,
# above one it loses matches (a write-up of such rigs: 0.393 px good, 3.6 px uncalibrated).
ROWS_PX, STEREO_PX = (0.5, 1.0), (0.5, 1.0)
VIEWS = (15, 8)
COVERED = (0.6, 0.35)
# Standard deviations as shares of the value: a focal length that is 1 % wrong makes all depths 1 %
# wrong.
FOCAL, BASELINE = (0.005, 0.015), (0.005, 0.02)
# Spread of the board's tilt, degrees: without it focal length and distance cannot be told apart.
TILT_DEG = (20.0, 10.0)
LEFT_OUT = (0.2, 0.4)
AGREEING = (0.8, 0.5)
# How a standard deviation is told that is a share of the value.
SHARE = "to {:.2%}"


@dataclass(frozen=True)
class Judgement:
    """One thing that a calibration is judged by.

    Args:
        name: what.
        value: in words.
        grade: good, fair or poor.
        step: what would make it better; "" where it is good.
    """

    name: str
    value: str
    grade: Grade
    step: str = ""

    def as_dict(self) -> dict[str, str]:
        """For `--json`."""
        return {"name": self.name, "value": self.value, "grade": self.grade, "step": self.step}


@dataclass(frozen=True, eq=False)
class Verdict:
    """All of them together: as good as the worst.

    Args:
        judgements: by what it was judged.
        coverage: of the left and the right picture.
    """

    judgements: tuple[Judgement, ...]
    coverage: tuple[Coverage, Coverage]

    @property
    def grade(self) -> Grade:
        """The worst of all."""
        return max((judgement.grade for judgement in self.judgements), key=GRADES.index)

    @property
    def steps(self) -> tuple[str, ...]:
        """What to do next, the worst first."""
        bad = [judgement for judgement in self.judgements if judgement.grade != "good"]
        bad.sort(key=lambda judgement: -GRADES.index(judgement.grade))
        return tuple(dict.fromkeys(judgement.step for judgement in bad))

    def __str__(self) -> str:
        why = [f"{j.name} {j.value}" for j in self.judgements if j.grade == self.grade]
        return self.grade if self.grade == "good" else f"{self.grade}: {', '.join(why)}"


def judge(candidate: Candidate, sure: Uncertainty, *, views: int) -> Verdict:
    """Judge a calibration.

    Args:
        candidate: the chosen one.
        sure: its standard deviations.
        views: pairs in which both eyes saw the board.
    """
    solution = candidate.solution
    coverage = _coverage(candidate)
    cameras, sigmas = solution.fit.state.cameras, (sure.left, sure.right)
    focal = max(
        float((s.intrinsics_px[:2] / c[:2]).max()) for s, c in zip(sigmas, cameras, strict=True)
    )
    baseline = sure.baseline_m / solution.baseline_m
    tilt = tilts_deg(candidate)
    tilted = float(np.ptp(tilt)) if len(tilt) else 0.0
    used, covered = len(solution.paired), min(part.share for part in coverage)
    emptiest = min(coverage, key=lambda part: part.share).emptiest
    left_out = 1 - used / max(views, 1)
    sharper = "Take new pictures: the board flat and held still, sharp and lit evenly."
    hold = f"Hold the board into the {emptiest} of the pictures, too." if emptiest else ""
    rows_px = candidate.held_out.row_error_px
    still = "Let nothing move between the two pictures: trigger both eyes at once, or stand still."
    more = "Take more pairs, 20 or more, the board at different distances and tilts."
    tilt_more = "Tilt the board by 30 degrees to all sides, and hold it near and far."
    return Verdict(
        (
            _below("rows of held-out views", rows_px, ROWS_PX, "{:.2f} px", sharper),
            _below("stereo error", solution.rms_stereo_px, STEREO_PX, "{:.2f} px", sharper),
            _above("pairs used", used, VIEWS, "{:.0f}", more),
            _above("covered", covered, COVERED, "{:.0%} of the pictures", hold),
            _above("tilt of the board", tilted, TILT_DEG, "{:.0f} degrees", tilt_more),
            _below("focal length", focal, FOCAL, SHARE, tilt_more),
            _below("baseline", baseline, BASELINE, SHARE, more),
            _below("left out", left_out, LEFT_OUT, "{:.0%} of the pairs", still),
            _above("eyes agree", solution.agreeing, AGREEING, "in {:.0%} of the pairs", still),
        ),
        coverage,
    )


def tilts_deg(candidate: Candidate) -> Float64:
    """(P,) signed tilt of the board in each view, the stronger of the two directions.

    The spread of signed tilts tells more than the largest: boards tilted one way are as one view.
    """
    solution = candidate.solution
    normals = solution.fit.state.T_first_board[: len(solution.paired), :3, 2]
    normals = normals * np.sign(normals[:, 2:])
    angles = np.rad2deg(np.arctan2(normals[:, :2], normals[:, 2:]))
    widest = int(np.argmax(np.ptp(angles, axis=0))) if len(angles) else 0
    return np.asarray(angles[:, widest])


def _coverage(candidate: Candidate) -> tuple[Coverage, Coverage]:
    solution = candidate.solution
    parts = []
    for eye, size_px in enumerate(solution.views.sizes_px):
        seen, uv = solution.blocks.seen[:, eye], solution.blocks.uv[:, eye]
        corners = Corners(np.flatnonzero(seen.ravel()), uv.reshape(-1, 2)[seen.ravel()])
        parts.append(Coverage.of([corners], size_px))
    return parts[0], parts[1]


def _below(name: str, value: float, limits: tuple[float, float], form: str, step: str) -> Judgement:
    return _graded(name, value, value <= limits[0], value <= limits[1], form, step)


def _above(name: str, value: float, limits: tuple[float, float], form: str, step: str) -> Judgement:
    return _graded(name, value, value >= limits[0], value >= limits[1], form, step)


def _graded(name: str, value: float, good: bool, fair: bool, form: str, step: str) -> Judgement:
    grade: Grade = "good" if good else "fair" if fair else "poor"
    said = "unknown" if form == SHARE and not value < 1 else form.format(value)
    return Judgement(name, said, grade, "" if good else step)
