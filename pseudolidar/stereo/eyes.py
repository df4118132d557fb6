"""What is done to the eyes of a pair before it is matched."""

from __future__ import annotations

from dataclasses import dataclass

from pseudolidar.stereo.balance import BalanceWhen, balanced
from pseudolidar.stereo.matcher import MatcherSettings, StereoMatcher
from pseudolidar.stereo.row_alignment import RowAligned, RowsWhen
from pseudolidar.structures.disparity import DEFAULT_MIN_DEPTH_M


@dataclass(frozen=True)
class Eyes:
    """How the right eye is brought to the left one's rows, and to its brightness.

    Args:
        rows: `auto` where points that both eyes see show that their rows differ; `never`.
        balance: `auto` where they differ by more than a matcher's cost can stand; `always`;
            `never`.
    """

    rows: RowsWhen = "auto"
    balance: BalanceWhen = "auto"

    def load(
        self, settings: MatcherSettings, *, min_depth_m: float = DEFAULT_MIN_DEPTH_M
    ) -> StereoMatcher:
        """The matcher behind both.

        Args:
            settings: of the matcher.
            min_depth_m: nearest depth that must be found, m.
        """
        matcher = balanced(settings, self.balance, min_depth_m=min_depth_m)
        return matcher if self.rows == "never" else RowAligned(matcher)
