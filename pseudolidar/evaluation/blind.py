"""What a pair itself says of its disparities: the other eye, the pictures, the next frame."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from pseudolidar.evaluation.matching_loss import Judgement
from pseudolidar.geometry.gaps import filled
from pseudolidar.geometry.grey import grey8_pair
from pseudolidar.structures.arrays import AnyArray, Bool, Float32, Float64, Int64, UInt8
from pseudolidar.structures.frame import StereoFrame

# Pictures get the same mean and contrast around each pixel: side of the neighbourhood, px, and
# contrast that is taken for noise, grey levels. Differences of them are means of PATCH_PX squared.
EVEN_PX, EVEN_NOISE, PATCH_PX = 15, 3.0, 3
# Contrast from which a neighbourhood has texture, grey levels.
TEXTURE = 6.0
# Other surfaces are looked for so far around a pixel, px; nearer to its own it is the same surface.
AROUND_PX, SAME_PX = 7, 0.75
# The next frame shows the same where the flow there and back ends within a pixel for this share of
# the pixels: KITTI raw and rendered worlds have 0.67 to 0.95, pairs of two scenes 0.00 to 0.04.
BACK_PX, BACK_SHARE = 1.0, 0.4

# Edges of the bins of each kind of evidence. Left-right: difference of the eyes, px (then: the
# right eye has none). Photometric: difference of the evened pictures. Texture: yes or no. Temporal:
# difference of what the flow of both eyes expects, px (then: not seen, or no next frame). Surfaces:
# how much worse the pictures agree than with the disparity of a surface around, or one px beside.
LEFT_RIGHT = (0.2, 0.5, 1.0, 3.0)
PHOTOMETRIC = (0.15, 0.3, 0.5, 0.8)
TEMPORAL = (0.3, 1.0)
SURFACES = (-0.05, 0.02, 0.1, 0.3)
BINS = (len(LEFT_RIGHT) + 2, len(PHOTOMETRIC) + 1, 2, len(TEMPORAL) + 2, len(SURFACES) + 1)
# What a pixel in each bin adds to the loss, and the loss without any of it. Fitted by
# tests/benchmarks/fit_blind_loss.py so that differences between settings are those of the errors of
# matched pixels, in proportion up to 3 px, 2026-11-26; docs/decisions.md has the rank correlations.
WEIGHTS = np.array(
    [
        *(-0.1866, -0.1866, -0.0725, 0.2605, 1.3033, -0.1866),  # left-right
        *(0, 0.0248, 0.0248, 0.0248, 0.0248),  # photometric
        *(0, 0.0708),  # texture
        *(0, 0.1448, 0.1448, 0.1014),  # temporal
        *(0, 0.2081, 0.2081, 0.5075, 0.5075),  # surfaces
    ]
)
USUAL_LOSS = 0.0153
# What a pixel without a disparity adds. The evidence sees less of outliers than the truth does, so
# what is left out must cost more here. Rank correlation with the loss by truth, mean over 18 worlds
# and matchers: at 0.2 0.35 (and -0.5 on KITTI: sparse maps won), at 0.3 0.56, 0.35 0.60, 0.5 0.57.
GAP_COST = 0.35
# No loss is less: differences are told as shares of it.
LEAST_LOSS = 0.01


@dataclass(frozen=True, eq=False)
class PairEvidence:
    """What a pair tells whatever its disparities are: computed once.

    Args:
        left: (H, W) float32, the evened left picture.
        right: (H, W) float32, the evened right one.
        texture: (H, W) 1 where there is texture.
        flow_left: (H, W, 2) px, how left pixels move to the next frame; None without one.
        flow_right: likewise of the right pictures.
    """

    left: Float32
    right: Float32
    texture: UInt8
    flow_left: Float32 | None = None
    flow_right: Float32 | None = None

    @classmethod
    def of(cls, frame: StereoFrame, following: StereoFrame | None = None) -> PairEvidence:
        """Of a pair, and the pair after it, which is used where it shows the same."""
        left, right = grey8_pair(frame.left, frame.right)
        even_left, contrast = _evened(left)
        even_right, _ = _evened(right)
        texture = (contrast > TEXTURE).astype(np.uint8)
        alone = cls(even_left, even_right, texture)
        if following is None or following.left.shape != frame.left.shape:
            return alone
        then_left, then_right = grey8_pair(following.left, following.right)
        flow = _flow(left, then_left)
        if _share_back(flow, _flow(then_left, left)) < BACK_SHARE:
            return alone
        return cls(even_left, even_right, texture, flow, _flow(right, then_right))

    @property
    def follows(self) -> bool:
        """Whether the next frame tells something."""
        return self.flow_left is not None


def judged_by_pair(
    pair: PairEvidence, values: Float32, of_right: Float32, following: Float32 | None, rows: Bool
) -> Judgement:
    """Judge a map by what speaks for it.

    The loss is no error of this map: it is made to differ between settings as the loss by truth
    does.

    Args:
        pair: what the pictures tell.
        values: (H, W) px, disparities of the left picture.
        of_right: (H, W) px, disparities of the right picture's pixels, by the same settings.
        following: (H, W) px, disparities of the next left picture, by the same settings.
        rows: (H,) rows that count.
    """
    density = float(np.isfinite(values[rows]).mean())
    shares = evidence_shares(pair, values, of_right, following, rows)
    loss = USUAL_LOSS + float(shares @ WEIGHTS) + GAP_COST * (1 - density)
    return Judgement(max(loss, LEAST_LOSS), density)


def evidence_shares(
    pair: PairEvidence, values: Float32, of_right: Float32, following: Float32 | None, rows: Bool
) -> Float64:
    """(22,) share of the judged pixels in each bin of each kind of evidence.

    Args:
        pair: what the pictures tell.
        values: (H, W) px, disparities of the left picture.
        of_right: (H, W) px, disparities of the right picture's pixels.
        following: (H, W) px, disparities of the next left picture; None without one.
        rows: (H,) rows that count.
    """
    row, column = np.nonzero(np.isfinite(values) & rows[:, None])
    d = values[row, column]
    nearest = np.rint(column - d).astype(np.int64)
    target = np.maximum(nearest, 0)
    back = np.where(nearest >= 0, of_right[row, target], np.nan)
    dense = filled(values)
    own = _differences(pair, dense)
    kinds: tuple[AnyArray, ...] = (
        _binned(np.abs(back - d), LEFT_RIGHT),
        np.searchsorted(PHOTOMETRIC, own[row, column]),
        pair.texture[row, column],
        _binned(_off_in_time(pair, following, row, column, d, nearest), TEMPORAL),
        np.searchsorted(SURFACES, (own - _others(pair, dense))[row, column]),
    )
    judged = max(1, int(rows.sum()) * values.shape[1])
    counts = [np.bincount(kind, minlength=n) for kind, n in zip(kinds, BINS, strict=True)]
    return np.asarray(np.concatenate(counts) / judged, np.float64)


def _binned(differences: Float32, edges: tuple[float, ...]) -> Int64:
    """Number of the bin; one more than the last for NaN."""
    bins = np.minimum(np.searchsorted(edges, differences), len(edges))
    return np.where(np.isfinite(differences), bins, len(edges) + 1)


def _off_in_time(
    pair: PairEvidence,
    following: Float32 | None,
    row: Int64,
    column: Int64,
    d: Float32,
    target: Int64,
) -> Float32:
    """(N,) px, how far the next frame's disparity is from d + flow of the left - of the right."""
    if pair.flow_left is None or pair.flow_right is None or following is None:
        return np.full(len(d), np.nan, np.float32)
    height, width = following.shape
    move, move_right = pair.flow_left[row, column], pair.flow_right[row, np.maximum(target, 0)]
    x = np.rint(column + move[:, 0]).astype(np.int64)
    y = np.rint(row + move[:, 1]).astype(np.int64)
    seen = (target >= 0) & (x >= 0) & (x < width) & (y >= 0) & (y < height)
    then = following[np.clip(y, 0, height - 1), np.clip(x, 0, width - 1)]
    expected = d + move[:, 0] - move_right[:, 0]
    return np.where(seen, np.abs(then - expected), np.float32(np.nan))


def _others(pair: PairEvidence, dense: Float32) -> Float32:
    """(H, W) least difference by disparities of other surfaces around, and of one px beside."""
    import cv2

    square = np.ones((2 * AROUND_PX + 1,) * 2, np.uint8)
    around = (cv2.dilate(dense, square), cv2.erode(dense, square))
    least = np.full(dense.shape, np.inf, np.float32)
    for other in (*around, dense + 1, dense - 1):
        differences = _differences(pair, np.asarray(other, np.float32))
        least = np.where(np.abs(other - dense) > SAME_PX, np.minimum(least, differences), least)
    return least


def _differences(pair: PairEvidence, dense: Float32) -> Float32:
    """(H, W) mean difference of the evened pictures where disparities lead."""
    import cv2

    there = np.zeros((*dense.shape, 2), np.float32)
    there[:, :, 0] = -dense
    off = np.abs(_moved(pair.right, there) - pair.left)
    return np.asarray(cv2.blur(off, (PATCH_PX, PATCH_PX)), np.float32)


def _moved(picture: Float32, flow: Float32) -> Float32:
    """(H, W) the picture as seen from where the flow begins."""
    import cv2

    height, width = picture.shape
    x = np.arange(width, dtype=np.float32)[None, :] + flow[:, :, 0]
    y = np.arange(height, dtype=np.float32)[:, None] + flow[:, :, 1]
    border = cv2.BORDER_REPLICATE
    return np.asarray(cv2.remap(picture, x, y, cv2.INTER_LINEAR, borderMode=border), np.float32)


def _evened(grey: UInt8) -> tuple[Float32, Float32]:
    """The picture with the same mean and contrast around each pixel, and the contrast it had."""
    import cv2

    values, side = grey.astype(np.float32), (EVEN_PX, EVEN_PX)
    mean = np.asarray(cv2.blur(values, side))
    variance = np.asarray(cv2.blur(values * values, side)) - mean * mean
    contrast: AnyArray = np.sqrt(np.maximum(variance, 0.0)).astype(np.float32)
    even: AnyArray = ((values - mean) / (contrast + np.float32(EVEN_NOISE))).astype(np.float32)
    return even, contrast


def _share_back(flow: Float32, back: Float32) -> float:
    """Share of the pixels that the flow back brings to where they were."""
    off = [flow[:, :, axis] + _moved(back[:, :, axis], flow) for axis in (0, 1)]
    return float((np.hypot(*off) < BACK_PX).mean())


def _flow(now: UInt8, then: UInt8) -> Float32:
    import cv2

    dis = cv2.DISOpticalFlow.create(cv2.DISOPTICAL_FLOW_PRESET_MEDIUM)
    start = np.zeros((*now.shape, 2), np.float32)
    return np.asarray(dis.calc(now, then, start), np.float32)
