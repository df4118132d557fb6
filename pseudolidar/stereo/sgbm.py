"""OpenCV's block matchers behind the same protocol, for comparison."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, ClassVar, Literal

import numpy as np

from pseudolidar.errors import StereoConfig
from pseudolidar.geometry.grey import grey8_pair
from pseudolidar.stereo.disparity_range import check_min_depth, check_range, disparity_range
from pseudolidar.structures.arrays import AnyArray, Float32, UInt8
from pseudolidar.structures.disparity import DEFAULT_MIN_DEPTH_M, DisparityMap
from pseudolidar.structures.frame import StereoFrame

if TYPE_CHECKING:
    import cv2

_SUBPIXEL = 16  # OpenCV's disparities are sixteenths of a pixel
_RANGE_STEP = 16
# StereoBM's own limits.
_SMALLEST_BM_BLOCK, _LARGEST_BM_BLOCK = 5, 255
_LARGEST_BM_CAP = 63


@dataclass(frozen=True)
class Sgbm:
    """OpenCV's semi-global block matching.

    Args:
        mode: `3way` (three paths, fastest), `sgbm` (five), `hh` (eight), `hh4` (four, two passes).
        disparities: range to search, px, a multiple of 16; by default from the nearest depth.
        block_size: odd edge of the cost window.
        p1: cost of a disparity step of one; by default 8 block_size^2.
        p2: cost of any larger step; by default 32 block_size^2.
        uniqueness_percent: by how much the best must beat the second best.
        pre_filter_cap: largest horizontal gradient.
        speckle_pixels: smaller segments are removed.
        speckle_step_px: largest step inside a segment.
        agreement_px: largest left-right difference of OpenCV's own check; -1 leaves it out.
        right_matcher: check against a second run from the right eye instead of OpenCV's check,
            which sees only the winners of the left.
    """

    mode: Literal["3way", "sgbm", "hh", "hh4"] = "3way"
    disparities: int | None = None
    block_size: int = 5
    p1: int | None = None
    p2: int | None = None
    uniqueness_percent: int = 10
    pre_filter_cap: int = 63
    speckle_pixels: int = 100
    speckle_step_px: int = 1
    agreement_px: int = 1
    right_matcher: bool = False
    compares_brightness: ClassVar[bool] = True

    def __post_init__(self) -> None:
        _check_block(self.block_size, 1)
        if self.disparities is not None:
            check_range(self.disparities, 1 << 30, multiple=_RANGE_STEP)
        if not 0 < self.penalties[0] < self.penalties[1]:
            raise StereoConfig(
                f"p1 = {self.penalties[0]}, p2 = {self.penalties[1]}",
                want="0 < p1 < p2",
                fix=f"For block_size {self.block_size} OpenCV suggests "
                f"{8 * self.block_size**2} and {32 * self.block_size**2}.",
                where="p1, p2",
            )

    @property
    def penalties(self) -> tuple[int, int]:
        """(p1, p2), chosen or OpenCV's suggestion."""
        area = self.block_size**2
        return (8 * area if self.p1 is None else self.p1, 32 * area if self.p2 is None else self.p2)

    def load(self, *, min_depth_m: float = DEFAULT_MIN_DEPTH_M) -> OpenCvMatcher:
        """The matcher."""
        check_min_depth(min_depth_m)
        return OpenCvMatcher(self, min_depth_m)

    def build(self, disparities: int) -> cv2.StereoMatcher:
        """OpenCV's own object; not safe to share between threads."""
        import cv2

        modes = {
            "3way": cv2.STEREO_SGBM_MODE_SGBM_3WAY,
            "sgbm": cv2.STEREO_SGBM_MODE_SGBM,
            "hh": cv2.STEREO_SGBM_MODE_HH,
            "hh4": cv2.STEREO_SGBM_MODE_HH4,
        }
        return cv2.StereoSGBM.create(
            minDisparity=0,
            numDisparities=disparities,
            blockSize=self.block_size,
            P1=self.penalties[0],
            P2=self.penalties[1],
            disp12MaxDiff=-1 if self.right_matcher else self.agreement_px,
            preFilterCap=self.pre_filter_cap,
            uniquenessRatio=self.uniqueness_percent,
            speckleWindowSize=self.speckle_pixels,
            speckleRange=self.speckle_step_px,
            mode=modes[self.mode],
        )


@dataclass(frozen=True)
class Bm:
    """OpenCV's block matching: fast and sparse.

    Args:
        disparities: range to search, px, a multiple of 16; by default from the nearest depth.
        block_size: odd edge of the window, at least 5.
        texture: smallest sum of gradients in the window.
        uniqueness_percent: by how much the best must beat the second best.
        pre_filter_cap: largest gradient, 1 to 63.
        speckle_pixels: smaller segments are removed.
        speckle_step_px: largest step inside a segment.
        agreement_px: largest left-right difference of OpenCV's own check; -1 leaves it out.
        right_matcher: check against a second run from the right eye instead.
    """

    disparities: int | None = None
    block_size: int = 15
    texture: int = 10
    uniqueness_percent: int = 10
    pre_filter_cap: int = 31
    speckle_pixels: int = 100
    speckle_step_px: int = 1
    agreement_px: int = 1
    right_matcher: bool = False
    compares_brightness: ClassVar[bool] = True

    def __post_init__(self) -> None:
        _check_block(self.block_size, _SMALLEST_BM_BLOCK, _LARGEST_BM_BLOCK)
        if not 1 <= self.pre_filter_cap <= _LARGEST_BM_CAP:
            raise StereoConfig(
                f"pre_filter_cap {self.pre_filter_cap}",
                want=f"1 to {_LARGEST_BM_CAP}",
                where="pre_filter_cap",
            )
        if self.disparities is not None:
            check_range(self.disparities, 1 << 30, multiple=_RANGE_STEP)

    def load(self, *, min_depth_m: float = DEFAULT_MIN_DEPTH_M) -> OpenCvMatcher:
        """The matcher."""
        check_min_depth(min_depth_m)
        return OpenCvMatcher(self, min_depth_m)

    def build(self, disparities: int) -> cv2.StereoMatcher:
        """OpenCV's own object; not safe to share between threads."""
        import cv2

        matcher = cv2.StereoBM.create(disparities, self.block_size)
        matcher.setTextureThreshold(self.texture)
        matcher.setUniquenessRatio(self.uniqueness_percent)
        matcher.setPreFilterCap(self.pre_filter_cap)
        matcher.setSpeckleWindowSize(self.speckle_pixels)
        # unlike StereoSGBM, which multiplies by itself
        matcher.setSpeckleRange(self.speckle_step_px * _SUBPIXEL)
        matcher.setDisp12MaxDiff(-1 if self.right_matcher else self.agreement_px)
        return matcher


@dataclass(frozen=True)
class OpenCvMatcher:
    """A loaded `Sgbm` or `Bm`; makes OpenCV's object anew for each frame."""

    settings: Sgbm | Bm
    min_depth_m: float

    def __call__(self, frame: StereoFrame) -> DisparityMap:
        """Disparity of the left image, without sigma.

        Raises:
            StereoConfig: the image is narrower than the range.
        """
        s = self.settings
        disparities = s.disparities or disparity_range(frame.rig, self.min_depth_m)
        check_range(disparities, frame.size_px[0], multiple=_RANGE_STEP)
        if isinstance(s, Bm):
            shortest = min(frame.size_px)
            _check_block(s.block_size, _SMALLEST_BM_BLOCK, (shortest - 1) // 2 * 2 + 1)
        left, right = grey8_pair(frame.left, frame.right)
        values = _matched(s.build, disparities, left, right)
        if s.right_matcher:
            mirrored = _matched(s.build, disparities, right[:, ::-1], left[:, ::-1])
            _keep_agreed(values, mirrored[:, ::-1], max(s.agreement_px, 0))
        return DisparityMap(values)


def _matched(build: Callable[[int], Any], disparities: int, left: UInt8, right: UInt8) -> Float32:
    pair = np.ascontiguousarray(left), np.ascontiguousarray(right)
    values = build(disparities).compute(*pair).astype(np.float32) / _SUBPIXEL
    values[values <= 0] = np.nan
    return np.asarray(values, np.float32)


def _keep_agreed(values: Float32, right_values: AnyArray, agreement_px: float) -> None:
    """NaN where the right eye's disparity at the matched pixel differs by more."""
    rows, columns = np.nonzero(np.isfinite(values))
    targets = np.rint(columns - values[rows, columns]).astype(np.int64)
    seen = right_values[rows, np.clip(targets, 0, values.shape[1] - 1)]
    disagree = (targets < 0) | ~(np.abs(seen - values[rows, columns]) <= agreement_px)
    values[rows[disagree], columns[disagree]] = np.nan


def _check_block(block_size: int, smallest: int, largest: int | None = None) -> None:
    too_large = largest is not None and block_size > largest
    if block_size < smallest or block_size % 2 == 0 or too_large:
        nearest = max(smallest, block_size // 2 * 2 + 1)
        range_px = f"from {smallest} on, such as {nearest}"
        if largest is not None:
            range_px = f"from {smallest} to {largest}, such as {min(nearest, largest)}"
        raise StereoConfig(
            f"block_size {block_size}", want=f"an odd number {range_px}", where="block_size"
        )
