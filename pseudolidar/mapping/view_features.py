"""Points of single pictures that are known again in others."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, Literal

import numpy as np

from pseudolidar.structures.arrays import AnyArray, Float32, UInt8

Kind = Literal["sift", "orb"]
# The best match must be better than the second by this; source: Lowe, Distinctive Image Features
# from Scale-Invariant Keypoints, IJCV 2004, section 7.1.
RATIO = 0.8
# Points of a picture, the strongest.
MOST_POINTS = 8000


@dataclass(frozen=True, eq=False)
class ViewPoints:
    """Points of a picture.

    Args:
        uv: (N, 2) float32 px, centre of the first pixel at (0, 0).
        words: (N, M) float32 or uint8: what tells them.
    """

    uv: Float32
    words: AnyArray


@dataclass(frozen=True)
class ViewFeatures:
    """Which points are looked for.

    Args:
        kind: `sift`, the surest, or `orb`, faster. (OpenCV 5 has AKAZE no more.)
        most: points of a picture, the strongest of them.
    """

    kind: Kind = "sift"
    most: int = MOST_POINTS

    def find(self, picture: UInt8) -> ViewPoints:
        """Points of a picture (H, W) or (H, W, 3)."""
        import cv2

        grey = picture if picture.ndim == 2 else cv2.cvtColor(picture, cv2.COLOR_RGB2GRAY)
        found, words = self._detector().detectAndCompute(np.ascontiguousarray(grey), None)
        if words is None or not len(found):
            return ViewPoints(np.zeros((0, 2), np.float32), np.zeros((0, 1), np.uint8))
        strongest = np.argsort([-point.response for point in found], kind="stable")[: self.most]
        uv = np.array([found[i].pt for i in strongest], np.float32)
        return ViewPoints(uv, words[strongest])

    def match(self, a: ViewPoints, b: ViewPoints) -> AnyArray:
        """(M, 2) uint32 positions in `a` and `b` of points that are each other's best."""
        import cv2

        if len(a.uv) < 2 or len(b.uv) < 2:
            return np.zeros((0, 2), np.uint32)
        norm = cv2.NORM_L2 if self.kind == "sift" else cv2.NORM_HAMMING
        matcher = cv2.BFMatcher(norm)
        there = _better(matcher.knnMatch(a.words, b.words, k=2))
        back = _better(matcher.knnMatch(b.words, a.words, k=2))
        pairs = [(i, j) for i, j in there.items() if back.get(j) == i]
        return np.array(pairs, np.uint32).reshape(-1, 2)

    def _detector(self) -> Any:
        import cv2

        if self.kind == "sift":
            return cv2.SIFT.create(nfeatures=self.most)
        return cv2.ORB.create(nfeatures=self.most)


def _better(matches: Any) -> dict[int, int]:
    """Matches that are better than the second by the ratio."""
    return {
        first.queryIdx: first.trainIdx
        for first, second in (pair for pair in matches if len(pair) == 2)
        if first.distance < RATIO * second.distance
    }
