"""What was odd about the scans of a path."""

from __future__ import annotations

from dataclasses import dataclass


@dataclass
class ScanCounts:
    """What was odd about scans so far.

    Args:
        scans: that were looked at.
        empty: scans without a usable point.
        few: scans with too few points, or planes, to be placed.
        unplaced: scans that fit nowhere.
        dropped_points: points that were not finite.
        deskewed: scans whose points had times of their own, and were moved to one moment.
    """

    scans: int = 0
    empty: int = 0
    few: int = 0
    unplaced: int = 0
    dropped_points: int = 0
    deskewed: int = 0

    @property
    def left_out(self) -> int:
        """Scans that placed nothing."""
        return self.empty + self.few + self.unplaced
