"""The default matcher: census cost, semi-global aggregation, and a sigma for every pixel."""

from __future__ import annotations

import contextlib
import math
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any, ClassVar, Literal

from pseudolidar.errors import StereoConfig
from pseudolidar.geometry.grey import grey8_pair
from pseudolidar.stereo.disparity_range import (
    RANGE_STEP_PX,
    check_min_depth,
    check_range,
    disparity_range,
)
from pseudolidar.stereo.sigma_model import SigmaModel
from pseudolidar.structures.disparity import DEFAULT_MIN_DEPTH_M, DisparityMap
from pseudolidar.structures.frame import StereoFrame

if TYPE_CHECKING:
    from pseudolidar.stereo.aggregation import Workspace
    from pseudolidar.stereo.smoothing import Evidence

# Penalties were scanned on KITTI stereo 2015: flat between 5..14 and 60..95 (largest that fits).
_PENALTY_SMALL = {"fast": 12, "fine": 7}
_AGREEMENT_PX = {"fast": 1.0, "fine": 0.75}
_PENALTY_LARGEST = 95
# `fine` searches its lower half, up to this disparity, in half pixels: there they are what depth
# at range is made of.
_HALF_PIXEL_RANGE = 48

# Fitted to the 22 frames of KITTI stereo 2015, disparity correction applied, 2026-11-23, by
# tests/benchmarks/fit_sigma.py.
_SIGMA = {
    "fast": SigmaModel(
        constant=1.83512,
        linear=(8.48669, 1.77007, -1.41372, -0.53287, -0.12516),
        quadratic=(-8.04494, -3.39595, 0.19274, -0.09961, -7e-05),
        low=(0.36735, 0.44444, 1.7295, -4.50442, -6.64386),
        high=(1.0, 1.0, 6.64954, 0.62314, 6.89482),
    ),
    "fine": SigmaModel(
        constant=4.34984,
        linear=(2.68461, 1.85524, -1.88442, -0.55251, -0.1207),
        quadratic=(-4.06051, -3.46495, 0.25371, -0.1033, -0.0001),
        low=(0.34694, 0.46667, 1.66368, -4.64484, -6.64386),
        high=(1.0, 1.0, 6.6507, 0.61277, 5.83289),
    ),
}


@dataclass(frozen=True)
class Census:
    """Census matching with semi-global aggregation over four paths, on the CPU.

    Args:
        quality: `fast` where throughput counts, `fine` where metres count (half-pixel bins below
            48 px).
        disparities: range to search, px, a multiple of 32; by default from the nearest depth.
        penalty_small: cost of a disparity step of one bin; by default by quality.
        penalty_large: cost of any larger step, at most 95.
        uniqueness_percent: by how much the best must beat the second best, unless neighbours
            confirm it; more is sparser.
        agreement_px: largest left-right difference; by default by quality.
        speckle_pixels: smaller segments are removed.
        speckle_step_px: largest step inside a segment.
        threads: 2 halves the latency of one frame; 1 is best where frames run side by side.
    """

    quality: Literal["fast", "fine"] = "fast"
    disparities: int | None = None
    penalty_small: int | None = None
    penalty_large: int = _PENALTY_LARGEST
    uniqueness_percent: float = 10.0
    agreement_px: float | None = None
    speckle_pixels: int = 200
    speckle_step_px: float = 1.0
    threads: Literal[1, 2] = 1
    compares_brightness: ClassVar[bool] = False  # only which of two pixels is brighter

    def load(self, *, min_depth_m: float = DEFAULT_MIN_DEPTH_M) -> CensusMatcher:
        """The matcher.

        Raises:
            StereoConfig: a setting outside its legal values.
        """
        check_min_depth(min_depth_m)
        return CensusMatcher(self, min_depth_m)

    def __post_init__(self) -> None:
        if self.disparities is not None:
            check_range(self.disparities, 1 << 30, multiple=RANGE_STEP_PX)
        if not 0 < self.small < self.penalty_large <= _PENALTY_LARGEST:
            raise StereoConfig(
                f"penalties {self.small} and {self.penalty_large}",
                want=f"0 < small < large <= {_PENALTY_LARGEST}",
                where="penalty_small, penalty_large",
            )
        if not 0 <= self.uniqueness_percent < 100:
            raise StereoConfig(
                f"{self.uniqueness_percent} %", want="0 to 99", where="uniqueness_percent"
            )
        for name in ("agreement_px", "speckle_pixels", "speckle_step_px"):
            value = getattr(self, name)
            if value is not None and not 0 <= value < math.inf:
                raise StereoConfig(f"{value}", want="0 or more", where=name)

    @property
    def small(self) -> int:
        """Penalty of one bin, chosen or by quality."""
        return _PENALTY_SMALL[self.quality] if self.penalty_small is None else self.penalty_small

    @property
    def agreement(self) -> float:
        """Left-right agreement px, chosen or by quality."""
        return _AGREEMENT_PX[self.quality] if self.agreement_px is None else self.agreement_px


@dataclass
class CensusMatcher:
    """A loaded `Census`; keeps its working memory from frame to frame, one set a thread."""

    settings: Census
    min_depth_m: float
    _spare: list[Workspace] = field(default_factory=list, repr=False)

    def __getstate__(self) -> dict[str, Any]:
        return {"settings": self.settings, "min_depth_m": self.min_depth_m, "_spare": []}

    def __call__(self, frame: StereoFrame) -> DisparityMap:
        """Disparity of the left image with sigma.

        Raises:
            StereoConfig: the image is narrower than the range.
        """
        evidence = self.evidence(frame)
        return evidence.with_sigma(_SIGMA[self.settings.quality])

    def evidence(self, frame: StereoFrame) -> Evidence:
        """Smoothed disparity and what sigma is made of."""
        from pseudolidar.stereo.aggregation import aggregate
        from pseudolidar.stereo.smoothing import smoothed

        s = self.settings
        disparities = s.disparities or disparity_range(frame.rig, self.min_depth_m)
        check_range(disparities, frame.size_px[0], multiple=RANGE_STEP_PX)
        half_pixel_range = min(_HALF_PIXEL_RANGE, disparities) if s.quality == "fine" else 0
        left, right = grey8_pair(frame.left, frame.right)
        workspace = self._workspace(left.shape[0], left.shape[1], disparities, half_pixel_range)
        winners = aggregate(
            left,
            right,
            workspace,
            penalties=(s.small, s.penalty_large),
            uniqueness=s.uniqueness_percent / 100,
            agreement_px=s.agreement,
            threads=s.threads,
        )
        self._spare.append(workspace)
        return smoothed(winners, speckle_pixels=s.speckle_pixels, speckle_step_px=s.speckle_step_px)

    def _workspace(self, height: int, width: int, disparities: int, half: int) -> Workspace:
        from pseudolidar.stereo.aggregation import Workspace

        while self._spare:
            with contextlib.suppress(IndexError):  # another thread was faster
                workspace = self._spare.pop()
                if workspace.fits(height, width, disparities, half):
                    return workspace
        return Workspace(height, width, disparities, half)
