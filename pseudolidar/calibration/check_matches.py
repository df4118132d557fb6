"""Sparse matches of a pair that do not trust its rows: ORB everywhere, then subpixel by flow."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from pseudolidar.geometry.grey import grey8_pair
from pseudolidar.structures.arrays import Bool, Float32, Float64, UInt8, check_array

if TYPE_CHECKING:
    from pseudolidar.structures.arrays import Image

# Wider pictures are made smaller: it takes less time, and subpixel flow gives back what is lost.
MATCHED_WIDTH_PX = 1400
ORB_FEATURES, ORB_LEVELS, FAST_THRESHOLD = 1500, 6, 10
# Lowe's ratio: how much nearer the best descriptor must be than the second. On KITTI, Middlebury
# and rendered pairs 1 to 4 % of what is left are outliers, of swapped and rolled pairs too.
NEARER = 0.8
# Neighbours whose disparities differ by more than this share of the width lie on two surfaces.
COHERENT_SHARE = 0.01
# Flow takes brightness for constant: both pictures get the same mean and contrast around each pixel
# first (side of that neighbourhood, px; contrast that is taken for noise; grey levels of one
# deviation). Without, a right eye of 0.6 times the brightness stands "1.7 baselines ahead".
EVEN_PX, EVEN_NOISE, EVEN_LEVELS = 31, 2.0, 32.0
# Window of the flow, px; how far it may leave what ORB found (whole pixels of coarse levels).
WINDOW_PX, MOST_MOVED_PX = 15, 4.0


@dataclass(frozen=True, eq=False)
class PairMatches:
    """The same points in both pictures.

    Args:
        left_px: (N, 2) x, y in the left picture.
        right_px: (N, 2) the same in the right one.
        size_px: (width, height) of the pictures.
    """

    left_px: Float64
    right_px: Float64
    size_px: tuple[int, int]

    def __post_init__(self) -> None:
        check_array("PairMatches", "left_px", self.left_px, (None, 2), np.float64)
        check_array("PairMatches", "right_px", self.right_px, (len(self.left_px), 2), np.float64)

    def __len__(self) -> int:
        return len(self.left_px)

    def selected(self, mask: Bool) -> PairMatches:
        """Those of `mask`."""
        return PairMatches(self.left_px[mask], self.right_px[mask], self.size_px)

    @property
    def disparity_px(self) -> Float64:
        """(N,) x_left - x_right."""
        return np.asarray(self.left_px[:, 0] - self.right_px[:, 0])

    @property
    def row_difference_px(self) -> Float64:
        """(N,) y_right - y_left; 0 in a rectified pair."""
        return np.asarray(self.right_px[:, 1] - self.left_px[:, 1])

    @property
    def coherence(self) -> float:
        """Share of the matches that are `coherent`; NaN of few.

        Of a scene most are: they lie on surfaces. A pattern that repeats is found anywhere.
        """
        return float(np.mean(self.coherent)) if len(self) > 1 else float("nan")

    @property
    def coherent(self) -> Bool:
        """(N,) matches whose nearest neighbour has about their disparity."""
        if len(self) < 2:
            return np.zeros(len(self), np.bool_)
        from scipy.spatial import KDTree

        # The first is the point itself.
        nearest = np.asarray(KDTree(self.left_px).query(self.left_px, k=2)[1])[:, 1]
        step_px = np.abs(self.disparity_px - self.disparity_px[nearest])
        return np.asarray(step_px < COHERENT_SHARE * self.size_px[0])


def match_points(left: Image, right: Image) -> PairMatches:
    """Find the same points in two pictures of one size, wherever they are in the other.

    Args:
        left: (H, W) or (H, W, 3).
        right: likewise.

    Returns:
        Matches in pixels of the pictures as given; none where there is nothing to be seen.
    """
    import cv2

    greys = grey8_pair(left, right)
    height, width = greys[0].shape
    shrink = min(1.0, MATCHED_WIDTH_PX / width)
    if shrink < 1.0:
        small = (round(width * shrink), round(height * shrink))
        left, right = (
            np.asarray(cv2.resize(grey, small, interpolation=cv2.INTER_AREA), np.uint8)
            for grey in greys
        )
    else:
        left, right = greys
    points = _refined(left, right, *_described(left, right))
    factors = np.array([width / left.shape[1], height / left.shape[0]])
    # A pixel centre u becomes (u + 0.5) s - 0.5.
    in_left, in_right = ((each.astype(np.float64) + 0.5) * factors - 0.5 for each in points)
    return PairMatches(in_left, in_right, (width, height))


def _described(left: UInt8, right: UInt8) -> tuple[Float32, Float32]:
    """Points whose descriptors are the best of each other, and clearly better than the second."""
    import cv2

    orb = cv2.ORB.create(nfeatures=ORB_FEATURES, nlevels=ORB_LEVELS, fastThreshold=FAST_THRESHOLD)
    (seen, mine), (seen_right, theirs) = (orb.detectAndCompute(eye, None) for eye in (left, right))
    none = np.zeros((0, 2), np.float32)
    if mine is None or theirs is None or len(mine) < 2 or len(theirs) < 2:
        return none, none
    matcher = cv2.BFMatcher(cv2.NORM_HAMMING)
    back = {match.queryIdx: match.trainIdx for match in matcher.match(theirs, mine)}
    pairs = [
        (seen[best.queryIdx].pt, seen_right[best.trainIdx].pt)
        for best, second in matcher.knnMatch(mine, theirs, k=2)
        if best.distance < NEARER * second.distance and back[best.trainIdx] == best.queryIdx
    ]
    both = np.array(pairs, np.float32).reshape(-1, 2, 2)
    return both[:, 0], both[:, 1]


def _refined(
    left: UInt8, right: UInt8, in_left: Float32, in_right: Float32
) -> tuple[Float32, Float32]:
    """The matches with subpixel places in the right picture; without those that flow loses."""
    import cv2

    if not len(in_left):
        return in_left, in_right
    moved, found, _ = cv2.calcOpticalFlowPyrLK(
        _evened(left),
        _evened(right),
        in_left[:, None],
        in_right[:, None].copy(),
        winSize=(WINDOW_PX, WINDOW_PX),
        maxLevel=0,
        flags=cv2.OPTFLOW_USE_INITIAL_FLOW,
    )
    moved = np.asarray(moved, np.float32).reshape(-1, 2)
    step = np.hypot(*(moved - in_right).T)
    kept = (np.asarray(found).ravel() == 1) & (step < MOST_MOVED_PX)
    return in_left[kept], moved[kept]


def _evened(grey: UInt8) -> UInt8:
    """The picture with the same mean and contrast around each pixel."""
    import cv2

    values, side = grey.astype(np.float32), (EVEN_PX, EVEN_PX)
    mean = np.asarray(cv2.blur(values, side))
    variance = np.asarray(cv2.blur(values * values, side)) - mean * mean
    scaled = (values - mean) / (np.sqrt(np.maximum(variance, 0.0)) + EVEN_NOISE)
    return np.asarray(np.clip(128.0 + EVEN_LEVELS * scaled, 0, 255), np.uint8)
