"""What `evaluate disparity` tells, for people and as JSON."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

from pseudolidar.errors import ALL_DONE, SOME_SKIPPED
from pseudolidar.evaluation.disparity import BAD_PX, DisparityErrors, DisparityScore
from pseudolidar.evaluation.halves import HalvesJudgement, Residuals
from pseudolidar.evaluation.ranges import RangeErrors
from pseudolidar.evaluation.sigma import SigmaShares


@dataclass(frozen=True, eq=False)
class DisparityReport:
    """Errors of a matcher, or of files, against the truth.

    Args:
        subject: what was judged, one line ("census fast on KITTI stereo 2015: ...").
        score: of the disparities as they came, on the stock rig.
        raw: errors without any correction; None for files, whose rig nobody knows.
        halves: errors with correction and sigma fitted on the other half of the frames.
        seconds_per_frame: median time of matching alone, one frame at a time.
        without_truth: frames that have no true disparity.
        skipped: id and reason of frames that could not be used.
        warnings: what is odd about the pairs.
        notes: what people should know of the figures.
    """

    subject: str
    score: DisparityScore
    raw: Residuals | None = None
    halves: HalvesJudgement | None = None
    seconds_per_frame: float | None = None
    without_truth: int = 0
    skipped: Sequence[tuple[str, str]] = ()
    warnings: Sequence[str] = ()
    notes: Sequence[str] = ()

    @property
    def exit_code(self) -> int:
        """4 if frames were skipped, else 0."""
        return SOME_SKIPPED if self.skipped else ALL_DONE

    @property
    def refined_shares(self) -> SigmaShares | None:
        """Errors within sigma, corrected; None for a single frame or without sigma."""
        return None if self.halves is None else self.halves.residuals.sigma_shares()

    @property
    def raw_shares(self) -> SigmaShares | None:
        """Errors within sigma as it ships, with the systematic error of an unrefined rig."""
        return None if self.raw is None else self.raw.sigma_shares()

    def as_dict(self) -> dict[str, Any]:
        """Headline figures (means over frames) first, then the same pooled, ranges, sigma."""
        refined, raw = self.refined_shares, self.raw_shares
        return {
            "subject": self.subject,
            "frames": len(self.score.frames),
            **_figures(self.score),
            "within_1_sigma": None if refined is None else refined.within_1_sigma,
            "within_95": None if refined is None else refined.within_95,
            "within_1_sigma_raw": None if raw is None else raw.within_1_sigma,
            "within_95_raw": None if raw is None else raw.within_95,
            "seconds_per_frame": self.seconds_per_frame,
            "pooled": _figures(self.score.pooled),
            "depth": None if self.raw is None else _rows(self.raw.by_range()),
            **self._halves_dict(),
            "without_truth": self.without_truth,
            "skipped": [{"id": name, "reason": reason} for name, reason in self.skipped],
            "warnings": list(self.warnings),
            "notes": list(self.notes),
        }

    def _halves_dict(self) -> dict[str, Any]:
        halves = self.halves
        if halves is None:
            names = ("depth_refined", "sigma_by_range", "ause", "systematic_px", "sigma_scale")
            return dict.fromkeys(names)
        return {
            "depth_refined": _rows(halves.residuals.by_range()),
            "sigma_by_range": list(halves.residuals.sigma_by_range()),
            "ause": halves.residuals.sparsification_error(),
            "systematic_px": list(halves.residual_px),
            "sigma_scale": list(halves.scales),
        }

    def text(self) -> str:
        """Tables for a terminal."""
        lines = [self.subject, f"{len(self.score.frames)} frames, means over frames (pooled):"]
        pooled = self.score.pooled
        lines += [
            f"  D1 of matched pixels   {_percent(self.score.d1_est)} ({_percent(pooled.d1_est)})",
            f"  density                {_percent(self.score.density)} ({_percent(pooled.density)})",
            f"  D1 with gaps filled    {_percent(self.score.d1_filled)}"
            f" ({_percent(pooled.d1_filled)})",
            f"  mean error             {_pixels(self.score.epe)} ({_pixels(pooled.epe)})",
        ]
        for threshold in BAD_PX:
            share, all_share = (each.bad_share(threshold) for each in (self.score, pooled))
            lines.append(
                f"  off by more than {threshold:g} px {_percent(share)} ({_percent(all_share)})"
            )
        if self.seconds_per_frame is not None:
            lines.append(f"  matching               {1e3 * self.seconds_per_frame:.0f} ms a frame")
        return "\n".join([*lines, *self._sigma_lines(), *self._range_lines(), *self._notes()])

    def _sigma_lines(self) -> list[str]:
        lines = []
        for shares, name in (
            (self.refined_shares, "fitted on the other half of the frames"),
            (self.raw_shares, "as it ships, on the stock rig"),
        ):
            if shares is not None:
                lines.append(
                    f"  within one sigma {_percent(shares.within_1_sigma)}, within the 95 % radius "
                    f"{_percent(shares.within_95)}: sigma {name}"
                )
        return lines

    def _range_lines(self) -> list[str]:
        if self.raw is None:
            return []
        lines = ["depth error by range: median, 90th percentile, signed median, pixels"]
        lines += [f"  stock   {_range_line(row)}" for row in self.raw.by_range()]
        if self.halves is not None:
            lines += [f"  refined {_range_line(row)}" for row in self.halves.residuals.by_range()]
        return lines

    def _notes(self) -> list[str]:
        lines = [*self.notes, *(f"skipped {name}: {reason}" for name, reason in self.skipped)]
        if self.without_truth:
            lines.append(f"{self.without_truth} frames without truth left out")
        return lines


def _figures(score: DisparityScore | DisparityErrors) -> dict[str, float | None]:
    return {
        "d1_est": score.d1_est,
        "density": score.density,
        "d1_filled": score.d1_filled,
        "epe": score.epe,
        **{f"bad_{threshold:g}": score.bad_share(threshold) for threshold in BAD_PX},
    }


def _rows(rows: Sequence[RangeErrors]) -> list[dict[str, Any]]:
    return [row.as_dict() for row in rows]


def _percent(share: float | None) -> str:
    return "   -   " if share is None else f"{100 * share:6.2f} %"


def _pixels(value: float | None) -> str:
    return "   -   " if value is None else f"{value:5.3f} px"


def _range_line(row: RangeErrors) -> str:
    bias = "   -   " if row.bias_rel is None else f"{100 * row.bias_rel:+6.2f} %"
    name = f"{row.from_m}-{row.to_m} m"
    return f"{name:8} {_percent(row.median_rel)} {_percent(row.p90_rel)} {bias} {row.n:8d}"
