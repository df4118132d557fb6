"""What a calibration found and what it is worth, for people and as JSON."""

from __future__ import annotations

import shlex
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from pseudolidar.calibration.solving.calibrated import Calibration
from pseudolidar.calibration.solving.left_out import LeftOut
from pseudolidar.errors import ALL_DONE, SOME_SKIPPED, printable
from pseudolidar.running.board_search import Looked
from pseudolidar.running.table import table_text
from pseudolidar.sources.bare_pairs import BarePairs


@dataclass(frozen=True, eq=False)
class CalibrateReport:
    """What was found, and what it is worth.

    Args:
        pairs: what was looked at.
        calibration: the result.
        unseen: pairs in which an eye does not see the board.
        looked: what was seen of the board, and pairs that cannot be read.
        out: the rig file.
        previous: where the rig file is that `out` replaced; None where there was none.
        page: where the page is, if there is one.
    """

    pairs: BarePairs
    calibration: Calibration
    unseen: tuple[LeftOut, ...]
    looked: Looked
    out: Path
    previous: Path | None
    page: Path | None = None

    @property
    def exit_code(self) -> int:
        """4 if pictures could not be read, else 0."""
        return SOME_SKIPPED if self.looked.skipped else ALL_DONE

    @property
    def left_out(self) -> tuple[LeftOut, ...]:
        """Every pair that does not tie the eyes together, with the reason."""
        unread = tuple(LeftOut(frame.id, str(frame.error)) for frame in self.looked.skipped)
        return (*self.calibration.solution.left_out, *self.unseen, *unread)

    def as_dict(self) -> dict[str, Any]:
        """For `--json`."""
        found, solution = self.calibration, self.calibration.solution
        rig, sure, verdict = found.rig, found.sure, found.verdict
        return {
            "model": solution.model,
            "rms_left": solution.rms_px[0],
            "rms_right": solution.rms_px[1],
            "rms_stereo": solution.rms_stereo_px,
            "baseline_m": solution.baseline_m,
            "baseline_sigma_m": sure.baseline_m,
            "holdout_row_error_px": found.chosen.held_out.row_error_px,
            "views_used": len(solution.paired),
            "views_dropped": len(self.left_out),
            "swapped": solution.swapped,
            "command": self.command,
            "verdict": verdict.grade,
            "next_steps": list(verdict.steps),
            "judgements": [judgement.as_dict() for judgement in verdict.judgements],
            "dropped": [view.as_dict() for view in self.left_out],
            "boards_turned": list(solution.turned),
            "coverage_left": verdict.coverage[0].share,
            "coverage_right": verdict.coverage[1].share,
            "depth_sigma_m": sure.depth_m.tolist(),
            "left": _camera(rig.left.K, rig.left.distortion, rig.left.size_px),
            "right": _camera(rig.right.K, rig.right.distortion, rig.right.size_px),
            "T_right_left": rig.T_right_left.matrix.tolist(),
            "views": self._views(),
            "models": [
                {
                    "model": candidate.solution.model,
                    "prediction_px": candidate.typical_px,
                    "rms_stereo": candidate.solution.rms_stereo_px,
                    "holdout_row_error_px": candidate.held_out.row_error_px,
                }
                for candidate in found.tried
            ],
            "notes": list(self.looked.notes),
            "source": self.pairs.summary.line,
            "path": self.pairs.summary.path,
            "out": str(self.out),
            "previous": None if self.previous is None else str(self.previous),
            "report": None if self.page is None else str(self.page),
        }

    @property
    def command(self) -> str | None:
        """What makes clouds of these pictures; None where more than a folder was given."""
        if not Path(self.pairs.summary.path).is_dir():
            return None
        swap = ["--swap"] if self.calibration.solution.swapped else []
        words = ["convert", self.pairs.summary.path, "clouds", "--rig", str(self.out), *swap]
        return f"pseudolidar {shlex.join(words)}"

    def _views(self) -> list[dict[str, Any]]:
        solution = self.calibration.solution
        squares = (solution.residuals**2).sum(axis=-1)
        rows = self.calibration.chosen.held_out.rows_px
        views = []
        for place, view in enumerate(solution.paired):
            seen = solution.pairs.seen[place]
            known = rows[place][np.isfinite(rows[place])]
            views.append(
                {
                    "id": solution.views.ids[view],
                    "corners": seen.sum(axis=1).tolist(),
                    "rms_left": _rms(squares[place, 0], seen[0]),
                    "rms_right": _rms(squares[place, 1], seen[1]),
                    "holdout_row_error_px": float(np.abs(known).mean()) if len(known) else None,
                }
            )
        return views

    def text(self) -> str:
        """For people."""
        found, solution = self.calibration, self.calibration.solution
        sure, verdict = found.sure, found.verdict
        lines = [self.pairs.summary.line, *self.pairs.summary.notes, *self.looked.notes]
        if solution.swapped:
            lines.append(
                "SWAPPED: what is called left stands right. The rig is written with the eyes "
                "exchanged back: pass --swap to every verb that takes these pictures with it."
            )
        if solution.turned:
            lines.append(f"board read from the other end by one eye, put right: "
                         f"{', '.join(solution.turned)}")  # fmt: skip
        lines += [f"left out: {view.id}: {view.reason}{_off(view)}" for view in self.left_out]
        lines.append(table_text(self._figures()))
        if len(found.tried) > 1:
            rows = [
                (
                    ("* " if candidate is found.chosen else "  ") + candidate.solution.model,
                    f"{candidate.typical_px:.3f}",
                    f"{candidate.solution.rms_stereo_px:.3f}",
                    f"{candidate.held_out.row_error_px:.3f}",
                    str(len(candidate.solution.paired)),
                )
                for candidate in found.tried
            ]
            header = ("model", "held-out views, px", "stereo rms, px", "rows, px", "pairs")
            lines.append(table_text(rows, header=header))
        depths = ", ".join(f"{z:g} m: {s:.2g} m" for z, s in sure.depth_m)
        lines.append(f"depth error to expect from the calibration alone: {depths}")
        lines.append(f"verdict: {verdict}")
        lines += [f"  next: {step}" for step in verdict.steps]
        lines.append(f"  {self.out}")
        if self.command is not None:
            lines.append(f"  clouds: {self.command}")
        if self.previous is not None:
            lines.append(f"  the one before: {self.previous}")
        if self.page is not None:
            lines.append(f"  {self.page}")
        return "\n".join(printable(part) for line in lines for part in line.splitlines())

    def _figures(self) -> list[tuple[str, str]]:
        found, solution = self.calibration, self.calibration.solution
        sure, coverage = found.sure, found.verdict.coverage
        used, given = len(solution.paired), len(self.looked.found) + len(self.looked.skipped)
        cameras = [
            (
                f"{eye} camera",
                f"f {c[0]:.2f} +- {s.intrinsics_px[0]:.2f}, {c[1]:.2f} +- {s.intrinsics_px[1]:.2f} "
                f"px; centre {c[2]:.2f} +- {s.intrinsics_px[2]:.2f}, {c[3]:.2f} +- "
                f"{s.intrinsics_px[3]:.2f}",
            )
            for eye, c, s in zip(
                ("left", "right"), solution.fit.state.cameras, (sure.left, sure.right), strict=True
            )
        ]
        return [
            ("model", solution.model),
            ("pairs", f"{used} used of {given}"),
            ("rms left, right", f"{solution.rms_px[0]:.3f}, {solution.rms_px[1]:.3f} px"),
            ("rms stereo", f"{solution.rms_stereo_px:.3f} px"),
            ("rows of held-out views", f"{found.chosen.held_out.row_error_px:.3f} px"),
            ("baseline", f"{solution.baseline_m:.5f} +- {sure.baseline_m:.5f} m"),
            *cameras,
            ("covered", f"left {coverage[0].share:.0%}, right {coverage[1].share:.0%}"),
        ]


def _rms(squares: Any, seen: Any) -> float | None:
    return float(np.sqrt(squares[seen].mean())) if seen.any() else None


def _off(view: LeftOut) -> str:
    return "" if view.off_px is None else f" ({view.off_px:.2f} px)"


def _camera(K: Any, distortion: Any, size_px: tuple[int, int]) -> dict[str, Any]:
    return {"K": K.tolist(), "distortion": distortion.tolist(), "size_px": list(size_px)}
