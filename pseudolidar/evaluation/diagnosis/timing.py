"""Whether scans are of another moment than the pictures: errors that grow with the speed."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from pseudolidar.evaluation.compared import ComparedFrame
from pseudolidar.evaluation.diagnosis.blocks import error_blocks
from pseudolidar.evaluation.diagnosis.causes import CAUSES
from pseudolidar.evaluation.diagnosis.fits import CauseFits
from pseudolidar.structures.arrays import Float64, Int64

FORWARD = next(i for i, cause in enumerate(CAUSES) if cause.name == "lidar_forward")
# Frames that a fit needs, and how much their speeds must differ, one standard deviation.
MIN_FRAMES, MIN_SPREAD_M_S = 4, 0.5


@dataclass(frozen=True)
class TimeOffset:
    """How much later than the pictures the scans were taken.

    Args:
        late_s: seconds; negative where scans are earlier. None where the data cannot tell.
        sigma_s: one standard deviation of it.
        reason: why it cannot be told, empty otherwise.
    """

    late_s: float | None
    sigma_s: float | None
    reason: str = ""

    @property
    def text(self) -> str:
        """In words."""
        if self.late_s is None or self.sigma_s is None:
            return f"time offset of the scans: cannot be told, {self.reason}"
        when = "after" if self.late_s >= 0 else "before"
        size = f"{abs(1e3 * self.late_s):.0f} +- {1e3 * self.sigma_s:.0f} ms"
        return f"scans {size} {when} the pictures"

    def as_dict(self) -> dict[str, Any]:
        """The fields, and the words."""
        return {**vars(self), "text": self.text}


def time_offset(frames: Sequence[ComparedFrame], speeds_m_s: Float64) -> TimeOffset:
    """Regress how far ahead scans lie, by frame, on the speed: a late scan is nearer by v dt.

    Args:
        frames: compared with scans.
        speeds_m_s: (N,) forward speed at each frame; NaN where it is not known.
    """
    known = [int(i) for i in np.flatnonzero(np.isfinite(speeds_m_s))]
    if len(known) < MIN_FRAMES:
        return TimeOffset(None, None, f"speeds of {len(known)} frames, {MIN_FRAMES} are needed")
    spread = float(np.std(speeds_m_s[known]))
    if spread < MIN_SPREAD_M_S:
        return TimeOffset(
            None, None, f"speeds differ by {spread:.2f} m/s, {MIN_SPREAD_M_S:g} are needed"
        )
    ahead_m, speeds = [], []
    for number in known:
        blocks = error_blocks([frames[number]])
        if len(blocks) > 1:
            ahead_m.append(CauseFits(blocks, frames[number].rig).sizes((FORWARD,))[0])
            speeds.append(speeds_m_s[number])
    if len(speeds) < MIN_FRAMES:
        return TimeOffset(None, None, f"{len(speeds)} frames have enough points")
    slope, sigma = _slope(np.array(speeds), np.array(ahead_m))
    return TimeOffset(-slope, sigma)


def _slope(x: Float64, y: Float64) -> tuple[float, float]:
    """Slope of a straight line (Theil-Sen), and its standard deviation by jackknife."""

    def median_slope(keep: Int64) -> float:
        i, j = np.triu_indices(len(x[keep]), 1)
        dx, dy = x[keep][j] - x[keep][i], y[keep][j] - y[keep][i]
        far = np.abs(dx) > 1e-9
        return float(np.median(dy[far] / dx[far]))

    index = np.arange(len(x))
    without = np.array([median_slope(index[index != left]) for left in index])
    n = len(x)
    sigma = np.sqrt((n - 1) / n * ((without - without.mean()) ** 2).sum())
    return median_slope(index), float(sigma)
