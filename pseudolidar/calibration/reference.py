"""`refine --by reference`: the rig fitted to depths that are known."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

from pseudolidar.errors import UsageError


@dataclass(frozen=True)
class Reference:
    """From depths that are known: LiDAR scans, or ground truth.

    Args:
        kind: scan, truth, or auto: scans of the frames that have one, else their ground truth.
        most: pixels that are looked at, all frames together.
    """

    kind: Literal["auto", "scan", "truth"] = "auto"
    most: int = 2_000_000

    def __post_init__(self) -> None:
        if self.most < 1:
            raise UsageError(f"most {self.most}", want="1 or more")
