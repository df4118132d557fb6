"""Pairs that must not become clouds, although each of their images is fine."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from pseudolidar.errors import CloudEmpty, LowTexture, PairIdentical
from pseudolidar.running.reports.removed import removed_shares
from pseudolidar.structures.cloud import PointCloud
from pseudolidar.structures.disparity import DepthMap, DisparityMap
from pseudolidar.structures.frame import StereoFrame

# Share of pixels with a disparity below which there is nothing to see. Black, white and evenly
# coloured pairs give 0, the poorest KITTI frame more than 0.5.
MIN_DENSITY = 0.02
# Depths that a stereo rig can have, m, and the share beyond them that says the unit is wrong.
PLAUSIBLE_M, IMPLAUSIBLE_SHARE = (0.5, 500.0), 0.5
# Every n-th row and column tells as much.
PLAUSIBLE_STEP = 8
# What the disparities would be multiplied with, if they were stored in another unit than read.
READINGS = (
    (1 / 16, "as sixteenths"),
    (1 / 256, "as 1/256"),
    (16.0, "x 16"),
    (256.0, "x 256"),
    (1000.0, "with a baseline or depth in mm"),
)


def check_pair(frame: StereoFrame) -> None:
    """Refuse a pair whose images are the same.

    Raises:
        PairIdentical: they are, to the last bit.
    """
    if np.array_equal(frame.left, frame.right):
        raise PairIdentical(
            "left and right are the same image",
            want="two views of the scene",
            fix="Check that both folders are not the same.",
            where=f"frame {frame.id}",
        )


def check_texture(
    frame: StereoFrame, disparity: DisparityMap, *, least: float = MIN_DENSITY
) -> None:
    """Refuse a disparity map with almost nothing in it: black, white, fog, a wall.

    Args:
        frame: the pair.
        disparity: what was found.
        least: share of the pixels that must have one; given maps may be as sparse as they are.

    Raises:
        LowTexture: fewer have one.
    """
    density = disparity.density
    if density < least:
        raise LowTexture(
            f"{density:.2%} of the pixels could be matched",
            want=f"at least {least:.0%}",
            fix="The pair is black, overexposed or without texture; leave it out with --exclude.",
            where=f"frame {frame.id}",
        )


def check_points(frame: StereoFrame, cloud: PointCloud, counts: Mapping[str, float]) -> None:
    """Refuse a cloud of a matched pair in which no point is left.

    Args:
        frame: the pair.
        cloud: what became of its disparities.
        counts: pixels that cleaning kept and removed.

    Raises:
        CloudEmpty: there is none.
    """
    if not len(cloud):
        shares = [f"{share:.0%} {what}" for what, share in removed_shares(counts).items() if share]
        removed = f": removed were {', '.join(shares)}" if shares else ""
        raise CloudEmpty(
            f"of the matched pixels no point is left{removed}",
            want="at least one point",
            fix="Check baseline and unit of the calibration; --clean none keeps all.",
            where=f"frame {frame.id}",
        )


def scale_notes(frame: StereoFrame, disparity: DisparityMap, depth: DepthMap) -> tuple[str, ...]:
    """A warning where most depths are none that stereo can have: a wrong unit of maps or rig."""
    seen = (slice(None, None, PLAUSIBLE_STEP), slice(None, None, PLAUSIBLE_STEP))
    depths = depth.values[seen][np.isfinite(depth.values[seen])]
    if not len(depths):
        return ()
    outside = float(np.mean((depths < PLAUSIBLE_M[0]) | (depths > PLAUSIBLE_M[1])))
    if outside <= IMPLAUSIBLE_SHARE:
        return ()
    median_px = float(np.nanmedian(disparity.values[seen]))
    readings = ", ".join(
        f"{frame.rig.fB_px_m / max(median_px * factor + frame.rig.doffs_px, 1e-6):.3g} m {name}"
        for factor, name in READINGS
    )
    return (
        f"DisparityScale: {outside:.0%} of the depths lie outside {PLAUSIBLE_M[0]:g} to "
        f"{PLAUSIBLE_M[1]:g} m, the median is {float(np.median(depths)):.3g} m; read otherwise it "
        f"would be {readings}",
    )
