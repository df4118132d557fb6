"""How many points of a cloud are where a LiDAR found nothing: ghosts, and how many are good."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from pseudolidar.errors import StructureError
from pseudolidar.evaluation.scan_surface import (
    SEEN_COLUMNS_PX,
    SEEN_ROWS_PX,
    ScanSurface,
    pixel_rays,
)
from pseudolidar.geometry.depth import depth_map
from pseudolidar.structures.arrays import Bool, Float64
from pseudolidar.structures.camera import StereoRig
from pseudolidar.structures.cloud import PointCloud
from pseudolidar.structures.disparity import DisparityMap
from pseudolidar.structures.frame import StereoFrame

# A ghost is farther than both together from every surface.
GHOST_M, GHOST_REL = 0.5, 0.05
# Bands of a point's own range, m.
GHOST_BANDS_M = ((0, 30), (30, 80))


@dataclass(frozen=True, eq=False)
class JudgedPoints:
    """Points of one cloud against the surfaces of one scan.

    Args:
        range_m: (N,) of each point from the left camera.
        distance_m: (N,) to the nearest surface of the scan; NaN where the point is not judged.
        along_ray_m: (N,) difference in range to the nearest surface at the point's pixel or the
            beams around it; NaN where the point is not judged.
    """

    range_m: Float64
    distance_m: Float64
    along_ray_m: Float64

    @property
    def judged(self) -> Bool:
        """(N,) points in the commonly seen area."""
        return ~np.isnan(self.distance_m)

    @property
    def ghost(self) -> Bool:
        """(N,) judged points farther than 0.5 m + 5 % of their range from every surface."""
        return self.distance_m > GHOST_M + GHOST_REL * self.range_m  # False for NaN

    @property
    def stray(self) -> Bool:
        """(N,) judged points off by more than that along their ray."""
        return self.along_ray_m > GHOST_M + GHOST_REL * self.range_m

    def counts(self, *, strays: bool = False) -> tuple[GhostCount, ...]:
        """Ghosts and good points of each band of `GHOST_BANDS_M`.

        Args:
            strays: count by the stricter measure, along the ray.
        """
        bad = self.stray if strays else self.ghost
        bands = [(self.range_m >= low) & (self.range_m < high) for low, high in GHOST_BANDS_M]
        return tuple(
            GhostCount(int((bad & band).sum()), int((self.judged & ~bad & band).sum()))
            for band in bands
        )


@dataclass(frozen=True)
class GhostCount:
    """Judged points of a cloud, or of a band of it.

    Args:
        ghosts: farther from every surface than the rule allows.
        good: the others.
    """

    ghosts: int
    good: int

    @classmethod
    def total(cls, counts: Sequence[GhostCount]) -> GhostCount:
        """Pooled over frames: every point counts once."""
        return cls(sum(count.ghosts for count in counts), sum(count.good for count in counts))


def judge_points(cloud: PointCloud, frame: StereoFrame, surface: ScanSurface) -> JudgedPoints:
    """Compare each point of a cloud with the surfaces that the LiDAR saw.

    A point is judged in the commonly seen area only: its pixel has a beam nearby (6 rows, 4
    columns) that came back and that the camera sees, too. So nothing is said about the sky, about
    what lies above the top beam and beside the scan, and about what sends no beam back. Its
    distance is that to the nearest point of the scan or of the surfaces between neighbouring beams,
    in any direction: a point of the background that a matcher drew to the object in front of it
    (some pixels beside its edge) is no ghost, and neither is one that is off along a surface. A
    point is a ghost where the distance exceeds 0.5 m + 5 % of its range.

    A distance in any direction forgives much near the road: a trail from a car to the wall behind
    it is never far from the ground. `along_ray_m` is stricter: what the point's range is off by
    against the surface at its pixel, or any beam around it (the same window, and 0.25 m to each
    side, by which scan and picture of moving things differ: they are taken some 10 ms apart, from
    places 6 cm aside). Where the frame has a ground-truth disparity, its pixels count as beams,
    too: KITTI's is made of several scans and models of the cars. Panes, dark paint and thin things
    that a scan misses remain, before and after cleaning alike.

    Args:
        cloud: of this frame, in the left camera's frame, with `uv`, one point a pixel; rows may be
            NaN.
        frame: with a scan, and a rig that knows where the LiDAR is.
        surface: of its scan.

    Raises:
        StructureError: the cloud is in another frame, or does not know its pixels.
    """
    if cloud.uv is None or cloud.frame != frame.rig.left.frame:
        raise StructureError(
            f"a cloud in {cloud.frame!r}, {'without' if cloud.uv is None else 'with'} pixels",
            want=f"one in {frame.rig.left.frame!r} with uv",
        )
    column, row = np.rint(cloud.uv).astype(np.intp).T
    range_m = np.linalg.norm(cloud.xyz.astype(np.float64), axis=1)
    judged = surface.seen[row, column] & cloud.valid
    distance_m = np.full(len(cloud), np.nan)
    distance_m[judged] = surface.distance_m(cloud.xyz[judged])
    ranges_m = np.full(surface.seen.shape, np.nan)
    ranges_m[row[judged], column[judged]] = range_m[judged]
    off_m = surface.along_ray_m(ranges_m)
    if frame.truth is not None:
        off_m = np.fmin(off_m, _off_truth_m(ranges_m, frame.truth, frame.rig))
    along_ray_m = np.where(judged, off_m[row, column], np.nan)
    return JudgedPoints(range_m, distance_m, along_ray_m)


def _off_truth_m(range_m: Float64, truth: DisparityMap, rig: StereoRig) -> Float64:
    """(H, W) difference to the nearest range of the true disparities around each pixel; or NaN."""
    height, width = range_m.shape
    slant = np.linalg.norm(pixel_rays(rig.left), axis=1).reshape(height, width)
    true_m = np.full((height + 2 * SEEN_ROWS_PX, width + 2 * SEEN_COLUMNS_PX), np.nan)
    inner = (
        slice(SEEN_ROWS_PX, SEEN_ROWS_PX + height),
        slice(SEEN_COLUMNS_PX, SEEN_COLUMNS_PX + width),
    )
    true_m[inner] = depth_map(truth, rig.with_correction(None)).values * slant
    off_m = np.full((height, width), np.nan)
    for dv in range(2 * SEEN_ROWS_PX + 1):
        for du in range(2 * SEEN_COLUMNS_PX + 1):
            off_m = np.fmin(off_m, np.abs(range_m - true_m[dv : dv + height, du : du + width]))
    return off_m
